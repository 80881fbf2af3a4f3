"""The result of a comparison of solvers."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any, Literal

import pandas as pd

from .._util.display import Displayed
from .._util.text import counted, did_you_mean
from ..errors import ComparisonError
from .agreement import Agreement, agreement
from .convergence import COLUMNS, Convergence, convergence
from .profiles import performance_profile
from .ranking import ranking
from .saving import read_comparison, write_comparison
from .verification import Tolerances, costs, summary


@dataclass(frozen=True, eq=False, repr=False)
class Comparison(Displayed):
    """Result of comparing solvers.

    Parameters
    ----------
    runs : DataFrame
        A row per (problem, copy, start, solver): see `casswarm.comparison.run.benchmark` and
        `casswarm.comparison.verification.verify`.
    problems : DataFrame
        A row per problem: family, problem, its traits and its size.
    inputs : dict
        All that determines the runs and their verification: families, seed, copies, solvers, time
        limit, machine, versions, a fingerprint of every problem, and tolerances, as plain values.
    iterates : DataFrame
        A row per recorded iterate of the runs on the problems themselves, not their copies. Columns
        family, problem, start, solver, and those of
        `casswarm.comparison.convergence.iterate_columns`.
    """

    runs: pd.DataFrame
    problems: pd.DataFrame
    inputs: dict[str, Any]
    iterates: pd.DataFrame = field(default_factory=lambda: pd.DataFrame(columns=list(COLUMNS)))

    @property
    def tolerances(self) -> Tolerances:
        """What counts as solved."""
        return Tolerances(**self.inputs["tolerances"])

    @cached_property
    def summary(self) -> pd.DataFrame:
        """Summary by (family, start, solver); see `casswarm.comparison.verification.summary`."""
        return summary(self.runs, float(self.inputs["time_limit"]))

    @cached_property
    def ranking(self) -> pd.DataFrame:
        """Ranks by (family, start, solver); see `casswarm.comparison.ranking.ranking`."""
        return ranking(self.runs, float(self.inputs["time_limit"]))

    def profile(
        self,
        family: str | None = None,
        start: str | None = None,
        success: Literal["solved", "best_known"] = "solved",
    ) -> pd.DataFrame:
        """Performance profile of solve times on the problems of a family, from a kind of start.

        Parameters
        ----------
        family, start : str, optional
            By default the first ones.
        success : {"solved", "best_known"}
            Whether solving is enough, or the best known objective is needed.

        Returns
        -------
        DataFrame
            Fraction of problems, a column per solver: see
            `casswarm.comparison.profiles.performance_profile`. The method `plot` draws it.

        Raises
        ------
        ComparisonError
            No such family, or no such start of its problems.
        """
        for column, value in (("family", family), ("start", start)):
            known = self.runs[column].unique().tolist()
            if value is not None and value not in known:
                raise ComparisonError(f"{column} {value!r} is unknown{did_you_mean(value, known)}")
        family = self.runs["family"].iloc[0] if family is None else family
        part = self.runs[self.runs["family"] == family]
        start = part["start"].iloc[0] if start is None else start
        return performance_profile(costs(self.runs, family, start, "solve_seconds", success))

    def convergence(self, problem: str | None = None, start: str | None = None) -> Convergence:
        """Objective and violation of the solvers' iterates on a problem, from a kind of start.

        Parameters
        ----------
        problem, start : str, optional
            By default the first ones.

        Returns
        -------
        Convergence
            Its `plot` draws the gap to the best known objective, its `iterates` are the numbers,
            and its `missing` are the solvers that report none.

        Raises
        ------
        ComparisonError
            No such problem, or no such start.
        """
        return convergence(self, problem, start)

    def agreement(self, other: Comparison) -> Agreement:
        """Whether another comparison ranks the solvers within this one's error bars.

        Parameters
        ----------
        other : Comparison
            Such as one of the same problems on another day, which `load` reads.

        Returns
        -------
        Agreement
            By family, start and every criterion of a ranking. Its `agrees` is the answer, and
            printing it tells what differs.

        Raises
        ------
        ComparisonError
            They have no family in common, or too few problems for error bars.
        """
        return agreement(self, other)

    def save(self, folder: str | Path) -> None:
        """Save the comparison in a folder, from which `load` reads it; existing files are replaced.

        Writes run.json with the inputs and the date, and tables as CSV files, as ``casswarm
        compare`` does.
        """
        write_comparison(self, Path(folder))

    @classmethod
    def load(cls, folder: str | Path) -> Comparison:
        """Comparison that `save` or ``casswarm compare`` wrote.

        Raises
        ------
        ComparisonError
            The folder holds none, or a damaged one.
        """
        return cls(*read_comparison(Path(folder)))

    def __repr__(self) -> str:
        solvers, problems = len(self.inputs["solvers"]), self.runs["problem"].nunique()
        solved = int(self.runs["solved"].sum())
        return (
            f"<Comparison of {counted(solvers, 'solver')} on {counted(problems, 'problem')}: "
            f"{solved} of {counted(len(self.runs), 'run')} solved>"
        )

    def __str__(self) -> str:
        return self.summary.to_string(index=False)
