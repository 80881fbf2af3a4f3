"""Reading of results folders: the record, tables, saved objects and figures."""

from __future__ import annotations

import tomllib
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import cached_property, partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self

import pandas as pd

from .._util.files import DAMAGED, read_arrays, read_table
from .._util.record import RECORD, read_record, recorded_files
from .._util.text import did_you_mean
from ..chain.monte_carlo import RunTrajectory
from ..errors import CasswarmError, CheckpointError
from ..guide.guide import Guide
from .serialization import unpack

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from ..scenario import Scenario
    from .catalogue import FigureCatalogue

COMMANDS = ("plan", "plan-swarm", "simulate", "evaluate", "sweep", "compare")
"""Commands whose folders hold all that their figures need."""

_EXAMPLE = "such as results/simulate-paper-1"
OBJECTS = "results.npz"


@dataclass(eq=False)
class ResultsReader:
    """What the folder of a finished command holds.

    Reading raises a CheckpointError where a part of the folder is missing, damaged, or of another
    command.

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
    """

    path: Path
    command: str
    record: Mapping[str, Any]
    files: dict[str, str] = field(default_factory=dict, kw_only=True)
    allow_code: bool = field(default=False, kw_only=True)

    @classmethod
    def open(cls, path: Path, allow_code: bool = False, commands: Sequence[str] = COMMANDS) -> Self:
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
            raise CheckpointError(f"{file} cannot be read ({error}): {expected}") from None
        command = record.get("command") if isinstance(record, dict) else None
        if command == "reproduce":
            raise CheckpointError(
                f"{file} is of casswarm reproduce, which does not save the runs that its figures "
                "show; to draw them differently run casswarm reproduce again, which takes "
                "--format, --width and --dpi (and --only figures for the paper's own)"
            )
        if command not in COMMANDS:
            origin = "an unknown origin" if command is None else f"casswarm {command}"
            raise CheckpointError(f"{file} is of {origin}, without figures to draw: {expected}")
        return cls(path, command, record, files=recorded_files(record), allow_code=allow_code)

    def part(self, name: str) -> Any:
        """Part of the record."""
        try:
            return self.record[name]
        except KeyError:
            raise CheckpointError(
                f"{self.path / RECORD} has no {name!r}: it is damaged; {self._advice}"
            ) from None

    def _missing(self, name: str) -> CheckpointError:
        return CheckpointError(
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
            raise CheckpointError(
                f"the scenario in {self.path / RECORD} is damaged; {self._advice}"
            ) from None
        source = f"the scenario in {self.path / RECORD}"
        return Scenario.from_data(
            data, source=source, folder=Path.cwd(), allow_code=self.allow_code
        )

    def has_table(self, name: str) -> bool:
        """Whether the command wrote the table NAME.csv."""
        return f"{name}.csv" in self.files

    def table(self, name: str) -> pd.DataFrame:
        """The table NAME.csv, its numbers equal to the last bit."""
        file = self.path / f"{name}.csv"
        try:
            table = read_table(file)  # only empty cells are missing, not a policy "null"
        except FileNotFoundError:
            raise self._missing(file.name) from None
        except (OSError, ValueError) as error:
            raise CheckpointError(f"{file} cannot be read: {error}") from None
        return table

    @property
    def paired(self) -> pd.DataFrame:
        """The table of paired differences; empty if only one policy was simulated."""
        return self.table("paired") if self.has_table("paired") else pd.DataFrame()

    @cached_property
    def objects(self) -> dict[str, Any]:
        """The objects of `write_objects`, by name."""
        file = self.path / OBJECTS
        try:
            objects: dict[str, Any] = unpack(read_arrays(file))
        except FileNotFoundError:
            raise self._missing(OBJECTS) from None
        except DAMAGED as error:
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
        """Name of a policy, by default the last one, and the trajectory of one of its runs."""
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
            raise CheckpointError(
                f"the tables in {self.path} lack {error}: one of them is damaged, or written by an "
                f"older casswarm; {self._advice}"
            ) from error
        except DAMAGED as error:
            reason = f"{type(error).__name__}: {' '.join(str(error).split())}"
            raise CheckpointError(
                f"the figures of {self.path} cannot be drawn ({reason}): a table or {OBJECTS} is "
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
        if self.command == "plan":
            return catalogue.plan_figures(scenario, **objects)
        if self.command == "plan-swarm":
            return catalogue.swarm_plan_figures(scenario, **objects)
        if self.command == "evaluate":
            successes = self.table("estimates" if self.has_table("estimates") else "distributions")
            return catalogue.evaluation_figures(scenario, objects["distributions"], successes)
        if self.command == "sweep":
            return catalogue.sweep_figures(scenario.name, self.table("sweep"), objects["keys"])
        trajectories = dict(self.trajectory(policy, run) for policy in self.trajectories)
        return catalogue.simulation_figures(
            scenario, self.guide, self.table("summary"), self.paired, trajectories, run
        )
