"""Results folders: tables, figures, saved objects and a record of how they were made."""

from __future__ import annotations

import json
import os
import platform
import sys
import time
import tomllib
from collections.abc import Callable, Mapping
from functools import cached_property, partial
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple
from zipfile import BadZipFile

import numpy as np
import pandas as pd

from .._util.documents import json_text
from .._util.files import atomic_write
from .._util.text import did_you_mean
from ..chain.trajectories import RunTrajectory
from ..errors import CheckpointError, FolderError
from ..planning.guide import Guide
from .serialization import pack, unpack

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from ..comparison import Comparison
    from ..scenario import Scenario
    from .catalogue import FigureCatalogue

COMMANDS = ("plan", "plan-swarm", "simulate", "evaluate", "sweep", "compare")
"""Commands whose folders hold all that their figures need."""

_EXPECTED = f"expected one written by {', '.join(COMMANDS[:-1])} or {COMMANDS[-1]}"
_EXAMPLE = "such as results/simulate-paper-1"
_LIBRARIES = ("casadi", "numpy", "scipy", "pandas", "matplotlib")
_OBJECTS = "results.npz"
_RECORD = "run.json"


class FigureFormat(NamedTuple):
    """File format of figures: suffix, width in the theme's words, dots per inch."""

    suffix: str = "png"
    width: str = "page"
    dpi: int = 200


class ResultsFolder:
    """Folder with the results of a command, to write (`create`) or to read (`open`).

    Every file is written atomically. The tables are CSV files for people; objects that figures
    and reports are made from are saved as arrays in ``results.npz``, and ``run.json`` records the
    command, its inputs, the scenario and the versions.
    """

    def __init__(
        self, path: Path, command: str, record: Mapping[str, Any], figure_format: FigureFormat
    ) -> None:
        self.path, self.command, self.record = path, command, record
        self.figure_format = figure_format
        self.files: list[str] = []
        self._started = time.perf_counter()

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
        record = {} if scenario is None else {"scenario": scenario.to_toml()}
        return cls(path, command, record, figure_format or FigureFormat())

    @classmethod
    def open(cls, path: Path) -> ResultsFolder:
        """Folder with the results of one of `COMMANDS`.

        Raises
        ------
        CheckpointError
            Not a folder, or not a results folder of such a command.
        """
        if not path.is_dir():
            raise CheckpointError(f"{path} is not a folder: {_EXPECTED}, {_EXAMPLE}", folder=path)
        file = path / _RECORD
        try:
            record = json.loads(file.read_text(encoding="utf-8"))
        except FileNotFoundError:
            raise CheckpointError(
                f"{path} has no {_RECORD}, so it is not a results folder of a finished command: "
                f"{_EXPECTED}, {_EXAMPLE}",
                folder=path,
            ) from None
        except (OSError, ValueError) as error:
            raise CheckpointError(f"{file} cannot be read ({error}): {_EXPECTED}") from None
        command = record.get("command") if isinstance(record, dict) else None
        if command == "reproduce":
            raise CheckpointError(
                f"{file} is of casswarm reproduce, which does not save the runs that its figures "
                "show; to draw them differently run casswarm reproduce again, which takes "
                "--format, --width and --dpi (and --only figures for the paper's own)"
            )
        if command not in COMMANDS:
            origin = "an unknown origin" if command is None else f"casswarm {command}"
            raise CheckpointError(f"{file} is of {origin}, without figures to draw: {_EXPECTED}")
        return cls(path, command, record, FigureFormat())

    # --- writing

    def write_table(self, name: str, table: pd.DataFrame) -> None:
        """Write a table as NAME.csv."""
        self.write_file(f"{name}.csv", table.to_csv(index=False))

    def write_figures(self, catalogue: FigureCatalogue) -> None:
        """Draw figures one by one and write them, each as NAME.png or of another format."""
        from ..figures import save, theme

        suffix, width, dpi = self.figure_format
        with theme(width):
            for name, draw in catalogue.items():
                self.write_file(f"{name}.{suffix}", partial(_saved_figure, save, draw(), dpi))

    def write_objects(self, **objects: Any) -> None:
        """Save objects, which `objects` reads back; a guide without its candidates."""
        arrays = pack(objects)
        self.write_file(
            _OBJECTS, lambda path: np.savez_compressed(path, allow_pickle=False, **arrays)
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
        """Write run.json: the result, and all that it depends on; return its content.

        Files that an earlier run of a command wrote here and this one did not are removed.
        """
        from .. import __version__

        for name in self._earlier_files() - set(self.files):
            (self.path / name).unlink(missing_ok=True)
        content = {
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
            "files": sorted({*self.files, _RECORD}),
            "finished": time.strftime("%Y-%m-%dT%H:%M:%SZ", time.gmtime()),
            "seconds": time.perf_counter() - self._started,
        }
        self.write_file(_RECORD, json_text(content) + "\n")
        return content

    def extend_record(self) -> None:
        """Add the files written here to the run.json of another command, which may remove them."""
        content = json.loads((self.path / _RECORD).read_text(encoding="utf-8"))
        files = self.files.copy()
        content["files"] = sorted({*content.get("files", ()), *files})
        self.write_file(_RECORD, json_text(content) + "\n")
        self.files = files

    def _earlier_files(self) -> set[str]:
        """Names of the files of an earlier run, by its record."""
        try:
            names = json.loads((self.path / _RECORD).read_text(encoding="utf-8"))["files"]
        except (OSError, ValueError, KeyError):
            return set()
        return {name for name in names if Path(name).name == name}

    def summary(self) -> str:
        """One line: which files were written where."""
        return f"wrote {self.path}: {', '.join(self.files)}"

    # --- reading

    def part(self, name: str) -> Any:
        """Part of the record.

        Raises
        ------
        CheckpointError
            The record lacks it.
        """
        try:
            return self.record[name]
        except KeyError:
            raise CheckpointError(
                f"{self.path / _RECORD} has no {name!r}: it is damaged; {self._advice}"
            ) from None

    @property
    def _advice(self) -> str:
        return f"run casswarm {self.command} again"

    @cached_property
    def scenario(self) -> Scenario:
        """Scenario of the record; a user's hazard is imported from the current folder.

        Raises
        ------
        ScenarioError
            The hazard cannot be imported.
        """
        from ..scenario import Scenario

        data = tomllib.loads(self.part("scenario"))
        source = f"the scenario in {self.path / _RECORD}"
        return Scenario.from_data(data, source=source, folder=Path.cwd())

    def has_table(self, name: str) -> bool:
        """Whether the table NAME.csv exists."""
        return (self.path / f"{name}.csv").is_file()

    def table(self, name: str) -> pd.DataFrame:
        """The table NAME.csv, its numbers equal to the last bit.

        Raises
        ------
        CheckpointError
            It does not exist, or cannot be read.
        """
        file = self.path / f"{name}.csv"
        try:
            table: pd.DataFrame = pd.read_csv(file, **_exact_numbers())
        except FileNotFoundError:
            raise CheckpointError(
                f"{self.path} has no {file.name}: it was removed, or written by an older "
                f"casswarm; {self._advice}"
            ) from None
        except (OSError, ValueError) as error:
            raise CheckpointError(f"{file} cannot be read: {error}") from None
        return table

    @cached_property
    def objects(self) -> dict[str, Any]:
        """The objects of `write_objects`, by name.

        Raises
        ------
        CheckpointError
            They do not exist, or cannot be read.
        """
        file = self.path / _OBJECTS
        try:
            with np.load(file, allow_pickle=False) as arrays:
                objects: dict[str, Any] = unpack(arrays)
        except FileNotFoundError:
            raise CheckpointError(
                f"{self.path} has no {_OBJECTS}: it was removed, or written by an older casswarm; "
                f"{self._advice}"
            ) from None
        except (OSError, ValueError, KeyError, TypeError, EOFError, BadZipFile) as error:
            raise CheckpointError(f"{file} cannot be read ({error}); {self._advice}") from None
        return objects

    @property
    def guide(self) -> Guide:
        """The guide, without its candidates."""
        guide: Guide = self._object("guide")
        return guide

    @property
    def trajectories(self) -> dict[str, tuple[RunTrajectory, ...]]:
        """Trajectories of the first runs of every policy."""
        trajectories: dict[str, tuple[RunTrajectory, ...]] = self._object("trajectories")
        return trajectories

    def _object(self, name: str) -> Any:
        try:
            return self.objects[name]
        except KeyError:
            raise CheckpointError(
                f"{self.path} was written by casswarm {self.command}, which saves no {name}",
                folder=self.path,
            ) from None

    def trajectory(self, policy: str | None = None, run: int = 0) -> tuple[str, RunTrajectory]:
        """Name of a policy, by default the last one, and the trajectory of one of its runs.

        Raises
        ------
        CheckpointError
            The folder has no such trajectory.
        """
        if self.command != "simulate":
            raise CheckpointError(
                f"{self.path} was written by casswarm {self.command}, which saves no trajectories: "
                "expected one written by casswarm simulate"
            )
        name = policy or list(self.trajectories)[-1]
        if name not in self.trajectories:
            hint = did_you_mean(name, self.trajectories)
            raise CheckpointError(f"{self.path} has no trajectories of {name!r}{hint}")
        saved = self.trajectories[name]
        if not 0 <= run < len(saved):
            raise CheckpointError(
                f"{self.path} has no trajectory of run {run} of {name}; saved: 0 to "
                f"{len(saved) - 1}. casswarm simulate --save-trajectories {run + 1} saves it"
            )
        return name, saved[run]

    @cached_property
    def comparison(self) -> Comparison:
        """The comparison of solvers, without the properties of its problems."""
        from ..comparison import Comparison, Tolerances

        inputs = dict(self.part("inputs"))
        tolerances = Tolerances(**inputs["tolerances"])
        return Comparison(self.table("runs"), pd.DataFrame(), inputs, tolerances)

    def figures(self, run: int = 0) -> FigureCatalogue:
        """The figures that the command drew; of simulated runs, number `run`.

        Raises
        ------
        CheckpointError
            A table or object is missing or damaged, or the run was not saved.
        """
        from .catalogue import saved_figures

        try:
            return saved_figures(self, run)
        except KeyError as error:
            raise CheckpointError(
                f"the tables in {self.path} lack {error}: one of them is damaged, or written by an "
                f"older casswarm; {self._advice}"
            ) from None


def _saved_figure(save: Callable[..., object], figure: Figure, dpi: int, path: Path) -> object:
    return save(figure, path, dpi)


def _exact_numbers() -> dict[str, Any]:
    """Option for pandas to read numbers to the last bit; from 3.1 on it always does."""
    release = tuple(map(int, pd.__version__.split(".")[:2]))
    return {} if release >= (3, 1) else {"float_precision": "round_trip"}
