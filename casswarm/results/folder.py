"""Results that a command left in a folder, read back: what figures and pages are made from."""

from __future__ import annotations

import json
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property, partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd

from ..chain.distribution import OutcomeDistribution
from ..chain.trajectories import RunTrajectory
from ..errors import CheckpointError
from ..planning.bounds import CostToGoMap
from ..planning.guide import Guide
from ..typing import FloatArray
from .restoring import DISTRIBUTION_TABLES, distributions_of, solution_of, trajectories_of

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from ..comparison import Comparison
    from ..scenario import Scenario
    from .catalogue import FigureCatalogue

COMMANDS = ("plan", "plan-swarm", "simulate", "evaluate", "sweep", "compare")
"""Commands whose folders can be drawn again."""


@dataclass(frozen=True, eq=False)
class Saved:
    """The folder of a command and its record, run.json."""

    folder: Path
    record: Mapping[str, Any]

    @classmethod
    def of(cls, folder: Path) -> Saved:
        """The results in a folder.

        Raises
        ------
        CheckpointError
            It is no folder, or none that casswarm left.
        """
        ours = f"give one that {', '.join(COMMANDS[:-1])} or {COMMANDS[-1]} left"
        example = "such as results/simulate-paper-1"
        if not folder.is_dir():
            raise CheckpointError(f"{folder} is no folder: {ours}, {example}")
        try:
            record = json.loads((folder / "run.json").read_text(encoding="utf-8"))
        except FileNotFoundError:
            raise CheckpointError(
                f"{folder} has no run.json, so it holds no finished results of casswarm: "
                f"{ours}, {example}"
            ) from None
        except (OSError, ValueError) as error:
            raise CheckpointError(
                f"{folder / 'run.json'} cannot be read ({error}): {ours}"
            ) from None
        command = record.get("command") if isinstance(record, dict) else None
        if command == "reproduce":
            raise CheckpointError(
                f"{folder / 'run.json'} is of casswarm reproduce, whose figures show runs that it "
                "does not keep; to draw them otherwise run casswarm reproduce again, which takes "
                "--format, --width and --dpi (and --only figures for the paper's own alone)"
            )
        if command not in COMMANDS:
            raise CheckpointError(
                f"{folder / 'run.json'} is of "
                + ("nothing that casswarm knows" if command is None else f"casswarm {command}")
                + f", which has no figures to draw again: {ours}"
            )
        return cls(folder, record)

    @property
    def command(self) -> str:
        """What left the folder."""
        return str(self.record["command"])

    @cached_property
    def scenario(self) -> Scenario:
        """The scenario of the record; a user's rates are imported from the current folder.

        Raises
        ------
        ScenarioError
            The rates cannot be imported.
        """
        from ..scenario import Scenario

        data = tomllib.loads(self._part("scenario"))
        source = f"the scenario in {self.folder / 'run.json'}"
        return Scenario.from_data(data, source=source, folder=Path.cwd())

    def table(self, name: str) -> pd.DataFrame:
        """The table NAME.csv, its numbers as they were written.

        Raises
        ------
        CheckpointError
            It is not there, or cannot be read.
        """
        try:
            table: pd.DataFrame = pd.read_csv(self.folder / f"{name}.csv", **_exactly())
        except FileNotFoundError:
            raise CheckpointError(
                f"{self.folder} has no {name}.csv: an older casswarm left it, or it was removed; "
                f"run casswarm {self.command} again"
            ) from None
        except (OSError, ValueError) as error:
            raise CheckpointError(f"{self.folder / name}.csv cannot be read: {error}") from None
        return table

    def has(self, name: str) -> bool:
        """Whether a file of this name is there."""
        return (self.folder / name).is_file()

    @cached_property
    def guide(self) -> Guide:
        """The guide of guide.csv, without its candidates."""
        table = self.table("guide")
        result = self._part("result")
        told = result if self.command == "plan" else result.get("guide", {})
        return self._guide(
            table[["x", "y"]].to_numpy(float),
            table[["vx", "vy"]].to_numpy(float)[:-1],
            told.get("solution"),
            told.get("risk_bound"),
        )

    @cached_property
    def trajectories(self) -> dict[str, tuple[RunTrajectory, ...]]:
        """The ways of the first runs of every policy."""
        return trajectories_of(self.table("traces"))

    @cached_property
    def laws(self) -> list[OutcomeDistribution]:
        """The exact laws of laws.csv and the tables beside it."""
        tables = {name: self.table(name) for name in DISTRIBUTION_TABLES}
        return distributions_of(tables, float(self.record["inputs"]["tolerance"]))

    @cached_property
    def comparison(self) -> Comparison:
        """The comparison of solvers, without the traits of its problems."""
        from ..comparison import Comparison, Tolerances

        inputs = dict(self._part("inputs"))
        tolerances = Tolerances(**inputs["tolerances"])
        return Comparison(self.table("runs"), pd.DataFrame(), inputs, tolerances)

    def figures(self, run: int = 0) -> FigureCatalogue:
        """The figures that the command left; of simulated runs, number `run`.

        Raises
        ------
        CheckpointError
            A table is missing, or the run was not kept.
        """
        try:
            return self._figures(run)
        except KeyError as error:
            raise CheckpointError(
                f"the tables in {self.folder} lack {error}: one of them is damaged, or an older "
                f"casswarm left them; run casswarm {self.command} again"
            ) from None

    def _figures(self, run: int) -> FigureCatalogue:
        from . import catalogue

        if self.command == "compare":
            from ..comparison.report import figures

            return {name: partial(_same, fig) for name, fig in figures(self.comparison).items()}
        if self.command == "plan":
            return catalogue.plan_figures(self.scenario, self.guide, *self._plan())
        if self.command == "plan-swarm":
            return catalogue.swarm_plan_figures(
                self.scenario, *self._joint(), *self._part("result")["labels"]
            )
        if self.command == "evaluate":
            estimated = self.has("estimates.csv")
            successes = self.table("estimates" if estimated else "laws")
            return catalogue.evaluation_figures(self.scenario, self.laws, successes)
        if self.command == "sweep":
            keys = list(self.record["inputs"]["settings"])
            return catalogue.sweep_figures(self.scenario.name, self.table("sweep"), keys)
        for policy in self.trajectories:
            self.trace(policy, run)
        paired = self.table("paired") if self.has("paired.csv") else pd.DataFrame()
        return catalogue.simulation_figures(
            self.scenario, self.guide, self.table("summary"), paired, self.trajectories, run
        )

    def trace(self, policy: str | None = None, run: int = 0) -> tuple[str, RunTrajectory]:
        """The policy, the last one by default, and the way of one of its runs.

        Raises
        ------
        CheckpointError
            There are no such runs.
        """
        from .._util.text import did_you_mean

        if self.command != "simulate":
            raise CheckpointError(
                f"{self.folder} was left by casswarm {self.command}, which keeps no runs: "
                "give one that casswarm simulate left"
            )
        name = policy or list(self.trajectories)[-1]
        if name not in self.trajectories:
            raise CheckpointError(
                f"no runs of {name!r} are kept in {self.folder}{did_you_mean(name, self.trajectories)}"
            )
        kept = self.trajectories[name]
        if not 0 <= run < len(kept):
            raise CheckpointError(
                f"run {run} of {name} is not kept in {self.folder}; kept: 0 to {len(kept) - 1}. "
                f"casswarm simulate --save-trajectories {run + 1} saves it"
            )
        return name, kept[run]

    def _plan(self) -> tuple[list[FloatArray], dict[str, Guide], CostToGoMap | None]:
        """Other ways, rivals, and the way on from everywhere."""
        paths = self.table("paths")
        groups = {
            kind: {
                str(name): part[["x", "y"]].to_numpy(float)
                for name, part in own.groupby("name", sort=False)
            }
            for kind, own in paths.groupby("kind", sort=False)
        }
        bound = self._part("result").get("risk_bound")
        rivals = {
            name: self._guide(path, np.diff(path, axis=0) / self.scenario.time.dt, None, bound)
            for name, path in groups.get("rival", {}).items()
        }
        outlook = None
        if self.has("cost-to-go.npz"):
            with np.load(self.folder / "cost-to-go.npz", allow_pickle=False) as arrays:
                outlook = CostToGoMap.from_arrays(dict(arrays))
        return list(groups.get("way", {}).values()), rivals, outlook

    def _joint(self) -> tuple[FloatArray, FloatArray | None]:
        """Members' ways (T+1, n, 2) and their survival (T+1, n), where it is known."""
        table = self.table("joint")
        shape = (-1, int(table["member"].max()) + 1)
        survival = table["survival"].to_numpy(float).reshape(shape)
        known = bool(np.isfinite(survival).all())
        return table[["x", "y"]].to_numpy(float).reshape(*shape, 2), survival if known else None

    def _guide(
        self, positions: FloatArray, velocities: FloatArray, solution: Any, bound: float | None
    ) -> Guide:
        scenario = self.scenario
        center = np.asarray(scenario.target.center, float)
        away = float(np.hypot(*(positions[-1] - center)))
        return Guide(
            positions,
            velocities,
            scenario.hazard.single_agent_rates(positions[1:]),
            scenario.time.dt,
            center,
            away <= scenario.target.radius * (1 + 1e-9),
            solution_of(solution),
            risk_bound=bound,
        )

    def _part(self, name: str) -> Any:
        try:
            return self.record[name]
        except KeyError:
            raise CheckpointError(
                f"{self.folder / 'run.json'} has no {name!r}: it is damaged; "
                f"run casswarm {self.command} again"
            ) from None


def _exactly() -> dict[str, Any]:
    """What makes pandas read numbers to the last bit; from 3.1 on it does, and knows no option."""
    version = tuple(map(int, pd.__version__.split(".")[:2]))
    return {} if version >= (3, 1) else {"float_precision": "round_trip"}


def _same(figure: Figure) -> Figure:
    return figure
