"""Results folders: tables, figures, saved objects and a record of how they were made."""

from __future__ import annotations

import json
import logging
import os
import platform
import sys
import time
import tomllib
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, fields, is_dataclass, replace
from enum import Enum
from functools import cached_property, partial
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd

from .._util.documents import json_text
from .._util.files import (
    DAMAGED,
    RECORD,
    arrays_content,
    atomic_write,
    digest,
    listed,
    own_record,
    read_arrays,
    read_record,
    read_table,
    recorded_files,
    remove_partial,
    set_aside,
    time_stamp,
)
from .._util.text import did_you_mean
from ..bounds import AccelerationBound, Certificate, Level, MixtureBound, MixtureLevel, SuccessBound
from ..chain.distribution import OutcomeDistribution
from ..chain.monte_carlo import RunTrajectory
from ..errors import CasswarmError, CheckpointError, FolderError
from ..grid import CostToGoMap
from ..guide.guide import Candidate, Guide
from ..guide.mixture import MixedGuide
from ..joint import MixedPlan, SwarmPlan
from ..motion.step import Motion
from ..nlp.solution import Residuals, Solution, Status
from ..scenario.ambiguity import Ambiguity
from ..typing import Progress
from .drawing import FigureFormat, FigureProcess, drawn_files

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from ..scenario import Scenario
    from .catalogue import FigureCatalogue

LOG = logging.getLogger(__name__)

COMMANDS = ("plan", "plan-swarm", "simulate", "evaluate", "sweep", "compare")
"""Commands whose folders hold all that their figures need."""

_LIBRARIES = ("casadi", "numpy", "scipy", "pandas", "matplotlib")
_EXAMPLE = "such as results/simulate-paper-1"
_OBJECTS = "results.npz"


@dataclass(eq=False)
class ResultsFolder:
    """Folder with the results of a command, to write (`create`) or to read (`open`).

    Every file is written atomically. The tables are CSV files for people; objects that figures
    and reports are made from are saved as arrays in ``results.npz``, and ``run.json`` records the
    command, its inputs, the scenario and the versions. Reading raises a CheckpointError where a
    part of the folder is missing, damaged, or of another command.

    Parameters
    ----------
    path : Path
    command : str
        One of `COMMANDS`.
    record : mapping
        Content of run.json.
    files : dict
        Hashes of the files in the record, by name; while a command runs, of those that it has
        written.
    allow_code : bool
        Whether a function that the scenario names may be imported from the current folder.
    figure_format : FigureFormat
    """

    path: Path
    command: str
    record: Mapping[str, Any]
    files: dict[str, str] = field(default_factory=dict, kw_only=True)
    allow_code: bool = field(default=False, kw_only=True)
    figure_format: FigureFormat = field(default_factory=FigureFormat, kw_only=True)
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
                f"cannot write {path}: {existing} is not a folder that can be written to",
                path=path,
            )
        folder = cls(path, command, {}, figure_format=figure_format or FigureFormat())
        if scenario is not None:
            folder.record = {"scenario": scenario.to_toml()}
            folder.scenario = scenario  # not read back: its hazard may be imported from elsewhere
        return folder

    def write_tables(self, **tables: pd.DataFrame) -> None:
        """Write tables, each as NAME.csv."""
        for name, table in tables.items():
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
        self.write_file(_OBJECTS, arrays_content(pack(objects)))

    def write_report(self) -> None:
        """Write report.html, of a simulation or a sweep, and add it to the record."""
        from .reports import PAGES

        self.write_file("report.html", PAGES[self.command](self))
        self.extend_record()

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
            file = self.path / name
            raise FolderError(f"cannot write {file}: {reason}", path=file) from error

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

    # --- reading

    @classmethod
    def open(
        cls, path: Path, allow_code: bool = False, commands: Sequence[str] = COMMANDS
    ) -> ResultsFolder:
        """Folder with the results of one of `COMMANDS`; messages suggest one of `commands`."""
        alternatives = filter(None, (", ".join(commands[:-1]), commands[-1]))
        expected = f"expected one written by casswarm {' or '.join(alternatives)}"
        if not path.is_dir():
            raise CheckpointError(f"{path} is not a folder: {expected}, {_EXAMPLE}", folder=path)
        file = path / RECORD
        try:
            record = read_record(path)
        except FileNotFoundError:
            raise CheckpointError(
                f"{path} has no {RECORD}, so it is not a results folder of a finished command: "
                f"{expected}, {_EXAMPLE}",
                folder=path,
            ) from None
        except DAMAGED as error:
            raise CheckpointError(
                f"{file} cannot be read ({error}): {expected}", folder=path
            ) from None
        command = record.get("command") if isinstance(record, dict) else None
        if command == "reproduce":
            raise CheckpointError(
                f"{file} is of casswarm reproduce, which does not save the runs that its figures "
                "show; to draw them differently run casswarm reproduce again, which takes "
                "--format, --width and --dpi (and --only figures for the paper's own)",
                folder=path,
            )
        if command not in COMMANDS:
            origin = "an unknown origin" if command is None else f"casswarm {command}"
            message = f"{file} is of {origin}, without figures to draw: {expected}"
            raise CheckpointError(message, folder=path)
        return cls(path, command, record, files=recorded_files(record), allow_code=allow_code)

    def part(self, name: str) -> Any:
        """Part of the record."""
        try:
            return self.record[name]
        except KeyError:
            raise self._error(
                f"{self.path / RECORD} has no {name!r}: it is damaged; {self._advice}"
            ) from None

    def _error(self, message: str) -> CheckpointError:
        return CheckpointError(message, folder=self.path)

    def _missing(self, name: str) -> CheckpointError:
        return self._error(
            f"{self.path} has no {name}: it was removed, or written by an older casswarm; "
            f"{self._advice}"
        )

    @property
    def _advice(self) -> str:
        return f"run casswarm {self.command} again"

    @cached_property
    def scenario(self) -> Scenario:
        """Scenario of the record; a user's hazard is imported from the current folder.

        Raises
        ------
        ScenarioError
            The hazard needs consent, or cannot be imported.
        """
        from ..scenario import Scenario

        try:
            data = tomllib.loads(self.part("scenario"))
        except (AttributeError, TypeError, ValueError, RecursionError):
            raise self._error(
                f"the scenario in {self.path / RECORD} is damaged; {self._advice}"
            ) from None
        source = f"the scenario in {self.path / RECORD}"
        return Scenario.from_data(
            data, source=source, folder=Path.cwd(), allow_code=self.allow_code
        )

    def has_table(self, name: str) -> bool:
        """Return True if the command wrote the table NAME.csv."""
        return f"{name}.csv" in self.files

    def table(self, name: str) -> pd.DataFrame:
        """The table NAME.csv, its numbers equal to the last bit."""
        file = self.path / f"{name}.csv"
        try:
            table = read_table(file)  # only empty cells are missing, not a policy "null"
        except FileNotFoundError:
            raise self._missing(file.name) from None
        except (OSError, ValueError) as error:
            raise self._error(f"{file} cannot be read: {error}") from None
        return table

    @property
    def paired(self) -> pd.DataFrame:
        """The table of paired differences; empty if only one policy was simulated."""
        return self.table("paired") if self.has_table("paired") else pd.DataFrame()

    @cached_property
    def objects(self) -> dict[str, Any]:
        """The objects of `write_objects`, by name."""
        file = self.path / _OBJECTS
        try:
            objects: dict[str, Any] = unpack(read_arrays(file))
        except FileNotFoundError:
            raise self._missing(_OBJECTS) from None
        except DAMAGED as error:
            raise self._error(f"{file} cannot be read ({error}); {self._advice}") from None
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
            raise self._error(
                f"{self.path} was written by casswarm {self.command}, which saves no {name}"
            ) from None

    def trajectory(self, policy: str | None = None, run: int = 0) -> tuple[str, RunTrajectory]:
        """Name of a policy, by default the last one, and the trajectory of one of its runs."""
        if self.command != "simulate":
            raise self._error(
                f"{self.path} was written by casswarm {self.command}, which saves no trajectories: "
                "expected one written by casswarm simulate"
            )
        name = policy or list(self.trajectories)[-1]
        if name not in self.trajectories:
            hint = did_you_mean(name, self.trajectories)
            raise self._error(f"{self.path} has no trajectories of {name!r}{hint}")
        saved = self.trajectories[name]
        if not 0 <= run < len(saved):
            raise self._error(
                f"{self.path} has no trajectory of run {run} of {name}; saved: 0 to "
                f"{len(saved) - 1}. casswarm simulate --save-trajectories {run + 1} saves it"
            )
        return name, saved[run]

    def figures(self, run: int = 0) -> FigureCatalogue:
        """The figures of the command, drawn from what it saved; of simulated runs, number `run`."""
        with self._reading():
            catalogue = self._figures(run)
        return {name: partial(self._drawn, draw) for name, draw in catalogue.items()}

    def _drawn(self, draw: Callable[[], Figure]) -> Figure:
        with self._reading():
            return draw()

    @contextmanager
    def _reading(self) -> Iterator[None]:
        """Raise a CheckpointError for what damaged tables and objects raise."""
        try:
            yield
        except CasswarmError:
            raise
        except KeyError as error:
            raise self._error(
                f"the tables in {self.path} lack {error}: one of them is damaged, or written by an "
                f"older casswarm; {self._advice}"
            ) from error
        except DAMAGED as error:
            reason = f"{type(error).__name__}: {' '.join(str(error).split())}"
            raise self._error(
                f"the figures of {self.path} cannot be drawn ({reason}): a table or {_OBJECTS} is "
                f"damaged; {self._advice}"
            ) from error

    def _figures(self, run: int) -> FigureCatalogue:
        from . import catalogue

        if self.command == "compare":
            from ..comparison import Comparison
            from ..comparison.report import figures

            inputs, no_problems = dict(self.part("inputs")), pd.DataFrame()  # for no figure
            more = {"iterates": self.table("iterates")} if self.has_table("iterates") else {}
            return dict(figures(Comparison(self.table("runs"), no_problems, inputs, **more)))
        scenario, objects = self.scenario, self.objects
        cases = self.table("cases") if self.has_table("cases") else None
        if "mixed" in objects:
            return catalogue.mixture_figures(scenario, **objects)
        if self.command == "plan":
            return catalogue.plan_figures(scenario, **objects)
        if self.command == "plan-swarm":
            return catalogue.swarm_plan_figures(scenario, **objects)
        if self.command == "evaluate":
            successes = self.table("estimates" if self.has_table("estimates") else "distributions")
            distributions = objects["distributions"]
            known = self.table("information") if self.has_table("information") else None
            return catalogue.evaluation_figures(scenario, distributions, successes, cases, known)
        if self.command == "sweep":
            return catalogue.sweep_figures(scenario.name, self.table("sweep"), objects["keys"])
        trajectories = dict(self.trajectory(policy, run) for policy in self.trajectories)
        return catalogue.simulation_figures(
            scenario, self.guide, self.table("summary"), self.paired, trajectories, run, cases
        )


# --- objects as arrays and JSON: written once, read back equal to the last bit

_TYPES: dict[str, type[Any]] = {
    kind.__name__: kind
    for kind in (
        AccelerationBound,
        Ambiguity,
        Candidate,
        Certificate,
        CostToGoMap,
        Guide,
        Level,
        MixedGuide,
        MixedPlan,
        MixtureBound,
        MixtureLevel,
        Motion,
        OutcomeDistribution,
        Residuals,
        RunTrajectory,
        Solution,
        Status,
        SuccessBound,
        SwarmPlan,
    )
}
"""Classes whose objects can be saved."""


def pack(value: Any) -> dict[str, np.ndarray]:
    """Convert a value to named arrays, as `numpy.savez` takes them; `unpack` is the inverse.

    Mappings with text keys, lists, tuples, arrays, numbers, texts, None, and
    objects of the classes of this module can be converted. The array ``json`` holds the structure.
    """
    arrays: list[np.ndarray] = []
    structure = json.dumps(_encode(value, arrays))
    return {"json": np.array(structure)} | {f"array{k}": part for k, part in enumerate(arrays)}


def unpack(arrays: Mapping[str, np.ndarray]) -> Any:
    """Convert the arrays of `pack` back to the value."""
    return _decode(json.loads(str(arrays["json"])), arrays)


def _encode(value: Any, arrays: list[np.ndarray]) -> Any:
    if isinstance(value, np.ndarray):
        arrays.append(value)
        return {"array": len(arrays) - 1}
    name = type(value).__name__
    if isinstance(value, Enum):
        return {"type": name, "value": value.value}
    if isinstance(value, Guide):
        value = replace(value, candidates=())  # many, and for no figure
    if isinstance(value, SwarmPlan):
        value = replace(value, outcomes=(), distribution=None, likely=None)  # likewise
    if is_dataclass(value):
        if name not in _TYPES:
            raise TypeError(f"{name} objects cannot be saved")
        parts = {item.name: getattr(value, item.name) for item in fields(value)}
        return {"type": name, "fields": {k: _encode(v, arrays) for k, v in parts.items()}}
    if isinstance(value, Mapping):
        return {"items": {key: _encode(item, arrays) for key, item in value.items()}}
    if isinstance(value, tuple):
        return {"tuple": [_encode(item, arrays) for item in value]}
    if isinstance(value, list):
        return [_encode(item, arrays) for item in value]
    return value.item() if isinstance(value, np.generic) else value


def _decode(value: Any, arrays: Mapping[str, np.ndarray]) -> Any:
    if isinstance(value, list):
        return [_decode(item, arrays) for item in value]
    if not isinstance(value, dict):
        return value
    if "array" in value:
        return arrays[f"array{value['array']}"]
    if "tuple" in value:
        return tuple(_decode(item, arrays) for item in value["tuple"])
    if "items" in value:
        return {key: _decode(item, arrays) for key, item in value["items"].items()}
    kind = _TYPES[value["type"]]
    if "value" in value:
        return kind(value["value"])
    return kind(**{key: _decode(item, arrays) for key, item in value["fields"].items()})
