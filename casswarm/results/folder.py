"""Results folders: tables, figures, saved objects and a record of how they were made."""

from __future__ import annotations

import json
import os
import platform
import sys
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import partial
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
import pandas as pd

from .._util.documents import json_text
from .._util.files import atomic_write
from ..errors import FolderError
from .reader import OBJECTS, RECORD, ResultsReader
from .serialization import pack

if TYPE_CHECKING:
    from ..scenario import Scenario
    from .catalogue import FigureCatalogue

_LIBRARIES = ("casadi", "numpy", "scipy", "pandas", "matplotlib")


class FigureFormat(NamedTuple):
    """File format of figures: suffix, width in the theme's words, dots per inch."""

    suffix: str = "png"
    width: str = "page"
    dpi: int = 200


@dataclass(eq=False)
class ResultsFolder(ResultsReader):
    """Folder with the results of a command, to write (`create`) or to read (`open`).

    Every file is written atomically. The tables are CSV files for people; objects that figures
    and reports are made from are saved as arrays in ``results.npz``, and ``run.json`` records the
    command, its inputs, the scenario and the versions.
    """

    figure_format: FigureFormat = field(default_factory=FigureFormat)
    _started: float = field(default_factory=time.perf_counter, init=False)

    @classmethod
    def create(
        cls,
        command: str,
        scenario: Scenario | None = None,
        path: Path | None = None,
        figure_format: FigureFormat | None = None,
    ) -> ResultsFolder:
        """Folder for new results, by default results/COMMAND-SCENARIO.

        Raises
        ------
        FolderError
            It cannot be written: said before the work rather than after it.
        """
        name = command if scenario is None else f"{command}-{scenario.name}"
        path = path or Path("results") / name
        existing = next(p for p in (path, *path.absolute().parents) if p.exists())
        if not (existing.is_dir() and os.access(existing, os.W_OK | os.X_OK)):
            raise FolderError(
                f"cannot write {path}: {existing} is not a folder that can be written to"
            )
        folder = cls(path, command, {}, figure_format or FigureFormat())
        if scenario is not None:
            folder.record = {"scenario": scenario.to_toml()}
            folder.scenario = scenario  # not read back: its hazard may be imported from elsewhere
        return folder

    def write_table(self, name: str, table: pd.DataFrame) -> None:
        """Write a table as NAME.csv."""
        self.write_file(f"{name}.csv", table.to_csv(index=False))

    def write_figures(self, catalogue: FigureCatalogue | None = None) -> None:
        """Draw figures one by one and write them, each as NAME.png or of another format.

        By default those of the command, from the tables and objects that are written already.
        """
        from ..figures import save, theme

        suffix, width, dpi = self.figure_format
        with theme(width):
            for name, draw in (self._figures(0) if catalogue is None else catalogue).items():
                self.write_file(f"{name}.{suffix}", partial(save, draw(), dpi=dpi))

    def write_objects(self, **objects: Any) -> None:
        """Save objects, which `objects` reads back; a guide without its candidates."""
        arrays = pack(objects)
        self.write_file(
            OBJECTS, lambda path: np.savez_compressed(path, allow_pickle=False, **arrays)
        )

    def write_file(self, name: str, content: str | bytes | Callable[[Path], object]) -> None:
        """Write a file of text, bytes, or by a function of a path.

        Raises
        ------
        FolderError
            The file cannot be written.
        """
        try:
            self.path.mkdir(parents=True, exist_ok=True)
            atomic_write(self.path / name, content)
        except OSError as error:
            reason = error.strerror or error
            raise FolderError(f"cannot write {self.path / name}: {reason}") from error
        self.files.append(name)

    def write_record(self, result: Mapping[str, Any], inputs: Mapping[str, Any]) -> dict[str, Any]:
        """Write run.json, the result and all that it depends on, and return this record.

        Files that an earlier run of a command wrote here and this one did not are removed.
        """
        from .. import __version__

        for name in self._earlier_files() - set(self.files):
            (self.path / name).unlink(missing_ok=True)
        self.record = {
            "command": self.command,
            "inputs": inputs,
            "result": result,
            **self.record,
            "versions": {
                "casswarm": __version__,
                "python": platform.python_version(),
                **{name: version(name) for name in _LIBRARIES},
            },
            "platform": platform.platform(),
            "arguments": sys.argv[1:],
            "files": sorted({*self.files, RECORD}),
            "finished": time.strftime("%Y-%m-%dT%H:%M:%SZ", time.gmtime()),
            "seconds": time.perf_counter() - self._started,
        }
        self.write_file(RECORD, json_text(self.record) + "\n")
        return self.record

    def extend_record(self) -> None:
        """Add the files written here to the run.json of another command, which may remove them."""
        content = json.loads((self.path / RECORD).read_text(encoding="utf-8"))
        content["files"] = sorted({*content.get("files", ()), *self.files})
        self.write_file(RECORD, json_text(content) + "\n")
        self.files.pop()  # the record is not this command's, or listed already
        if self.record.get("files"):
            self.record = {**self.record, "files": content["files"]}

    def _earlier_files(self) -> set[str]:
        """Names of the files of an earlier run, by its record."""
        try:
            names = json.loads((self.path / RECORD).read_text(encoding="utf-8"))["files"]
        except (OSError, ValueError, KeyError, TypeError):
            return set()
        return {name for name in names if isinstance(name, str) and Path(name).name == name}

    def summary(self) -> str:
        """One line: which files were written where."""
        return f"wrote {self.path}: {', '.join(self.files)}"
