"""Results folders: tables, figures, saved objects and a record of how they were made."""

from __future__ import annotations

import logging
import os
import platform
import sys
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cached_property, partial
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pandas as pd

from .._util.documents import json_text
from .._util.files import arrays_content, atomic_write, digest, remove_partial, set_aside
from .._util.record import RECORD, listed, own_record, recorded_files, time_stamp
from ..errors import FolderError
from ..typing import Progress
from .drawing import FigureFormat, FigureProcess, drawn_files
from .reader import OBJECTS, ResultsReader
from .serialization import pack

if TYPE_CHECKING:
    from ..scenario import Scenario
    from .catalogue import FigureCatalogue

LOG = logging.getLogger(__name__)

_LIBRARIES = ("casadi", "numpy", "scipy", "pandas", "matplotlib")


@dataclass(eq=False)
class ResultsFolder(ResultsReader):
    """Folder with the results of a command, to write (`create`) or to read (`open`).

    Every file is written atomically. The tables are CSV files for people; objects that figures
    and reports are made from are saved as arrays in ``results.npz``, and ``run.json`` records the
    command, its inputs, the scenario and the versions.
    """

    figure_format: FigureFormat = field(default_factory=FigureFormat)
    _started: float = field(default_factory=time.perf_counter, init=False)
    _helper: FigureProcess | None = field(default=None, init=False)

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

    def prepare_figures(self) -> None:
        """Start a process that helps `write_figures`, during the work that comes before."""
        self._helper = FigureProcess.if_useful()

    def write_figures(
        self, catalogue: FigureCatalogue | None = None, progress: Progress | None = None
    ) -> None:
        """Draw figures one by one and write them, each as NAME.png or of another format.

        By default those of the command, from the tables and objects that are written already.
        `progress` is told before each of them how many are drawn.
        """
        chosen = self.figure_format
        try:
            figures = self._figures(0) if catalogue is None else catalogue
            for name, content in drawn_files(figures, chosen, self._helper, progress):
                self.write_file(f"{name}.{chosen.suffix}", content)
        finally:
            if self._helper is not None:
                self._helper.close()
                self._helper = None

    def write_objects(self, **objects: Any) -> None:
        """Save objects, which `objects` reads back; a guide without its candidates."""
        self.write_file(OBJECTS, arrays_content(pack(objects)))

    def write_file(self, name: str, content: str | bytes | Callable[[Path], object]) -> None:
        """Write a file of text, bytes, or by a function of a path.

        What a killed process left of the same file is removed.

        Raises
        ------
        FolderError
            The file cannot be written.
        """
        try:
            self.path.mkdir(parents=True, exist_ok=True)
            atomic_write(self.path / name, content, partial(self._before, name))
            remove_partial(self.path / name)
        except OSError as error:
            reason = error.strerror or error
            raise FolderError(f"cannot write {self.path / name}: {reason}") from error

    def _before(self, name: str, part: Path) -> None:
        """Note the hash of a complete file, and set aside a file that it would replace.

        A file that casswarm wrote and nobody changed is replaced; any other is kept as NAME.bak.
        """
        path, new = self.path / name, digest(part)
        own, self.files[name] = self.files.get(name), new
        if not os.path.lexists(path) or path.is_dir():
            return
        present, recorded = digest(path), self._recorded.get(name)
        is_own = bool(own_record(self.path)) if name == RECORD else recorded == ""
        if not is_own and present not in (own, recorded, new):
            LOG.warning("%s is not of casswarm: kept as %s", path, set_aside(path).name)

    def write_record(self, result: Mapping[str, Any], inputs: Mapping[str, Any]) -> dict[str, Any]:
        """Write run.json, the result and all that it depends on, and return this record.

        Files that an earlier run of the same command wrote here and this one did not are removed,
        unless they were changed since.
        """
        from .. import __version__

        if self._earlier.get("command") == self.command:
            for name in self._recorded.keys() - self.files.keys() - {RECORD}:
                path, recorded = self.path / name, self._recorded[name]
                if recorded and digest(path) == recorded:
                    path.unlink()
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
            "files": listed(self.files),
            "finished": time_stamp(),
            "seconds": time.perf_counter() - self._started,
        }
        self.write_file(RECORD, json_text(self.record) + "\n")
        return self.record

    def extend_record(self) -> None:
        """Add the files written here to the run.json of another command, which may remove them."""
        content, written = dict(own_record(self.path)), self.files.copy()
        content["files"] = listed(recorded_files(content) | written)
        self.write_file(RECORD, json_text(content) + "\n")
        self.files = written  # without the record, if it is not this command's
        if self.record.get("files"):
            self.record = {**self.record, "files": content["files"]}

    @cached_property
    def _earlier(self) -> Mapping[str, Any]:
        """Record of the command that wrote here before; empty if there is none."""
        return own_record(self.path)

    @cached_property
    def _recorded(self) -> dict[str, str]:
        """Hashes of the files of that command, by name."""
        return recorded_files(self._earlier)

    def summary(self) -> str:
        """One line: which files were written where."""
        return f"wrote {self.path}: {', '.join(self.files)}"
