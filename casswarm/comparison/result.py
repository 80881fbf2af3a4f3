"""The result of a comparison of solvers: its tables, convergence on a problem, and its folder."""

from __future__ import annotations

import math
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from functools import cached_property
from importlib import import_module
from pathlib import Path
from typing import Any, Literal

import numpy as np
import pandas as pd

from .._util.display import Displayed
from .._util.documents import json_text
from .._util.files import (
    DAMAGED,
    RECORD,
    atomic_write,
    digest,
    listed,
    read_record,
    read_table,
    time_stamp,
)
from .._util.text import counted, did_you_mean
from ..errors import ComparisonError, SolverError
from ..nlp.program import Instances, Nlp
from ..solvers import Isolated
from ..typing import FloatArray
from .problem import Problem
from .profiles import performance_profile
from .ranking import Agreement, agreement, pooled_ranking, ranking
from .verification import Tolerances, costs, gap_unit, start_text, summary

NOT_REPORTED = "reports no iterates"
"""Why a solver that took part has no convergence history."""

NOT_RECORDED = "not recorded: a solve takes more than half of the time limit"

COLUMNS = ("family", "problem", "start", "solver", "iteration", "seconds", "objective", "violation")
"""Columns of the table of all iterates: see `iterate_columns`."""


_REPORT = ".report"  # looked up by name when it is needed: it draws figures of comparisons


@dataclass(frozen=True, eq=False, repr=False)
class Convergence(Displayed):
    """Convergence of the solvers to the best known objective of a problem; `plot` draws it.

    Parameters
    ----------
    problem, start : str
    best_objective : float
        The smallest objective of any feasible answer to the problem; NaN if there is none.
    iterates : DataFrame
        A row per iterate, by solver. Columns: solver; iteration; seconds; objective; violation, the
        largest of a bound or constraint, absolute; feasible, whether that is within the tolerance;
        gap, the distance of the objective from the best known one, relative as in
        `casswarm.comparison.verification.verify`. An infeasible iterate can be below it.
    missing : dict
        Solvers without iterates, and why.
    solvers : tuple of str
        All that were compared, in order.
    """

    problem: str
    start: str
    best_objective: float
    iterates: pd.DataFrame = field(repr=False)
    missing: dict[str, str]
    solvers: tuple[str, ...]

    def __repr__(self) -> str:
        solvers = ", ".join(self.iterates["solver"].unique()) or "no solver"
        return f"<Convergence on {self.problem}, {start_text(self.start)}, of {solvers}>"


def iterate_columns(
    problem: Problem, start: str, solver: Isolated, solve_seconds: float
) -> dict[str, list[float]]:
    """Iterates of a solver, from a solve of their own that is not timed; empty if it reports none.

    Columns: iteration, from 0; seconds; objective and violation, recomputed from the problem for
    all solvers alike. Since recording takes time, and the projected gradient method is recorded in
    a slower loop than it is timed in, seconds are those of the recorded solve times a factor: the
    last iterate is at `solve_seconds`.
    """
    nlp, instance = problem.nlp, problem.starts[start]
    iterates = None
    with suppress(SolverError):
        iterates = solver.iterates(nlp, instance)
    if iterates is None:
        return {}
    objective, violation = _evaluated(nlp, instance, iterates.x)
    last = iterates.seconds[-1]
    factor = solve_seconds / last if last > 0 else 1.0
    return {
        "iteration": iterates.numbers.tolist(),
        "seconds": (factor * iterates.seconds).tolist(),
        "objective": objective.tolist(),
        "violation": violation.tolist(),
    }


def iterate_table(rows: Sequence[dict[str, Any]]) -> pd.DataFrame:
    """Table of the iterates in rows of `benchmark`, which they are removed from."""
    tables = [pd.DataFrame(columns=list(COLUMNS))]
    for row in rows:
        columns = row.pop("iterates", {})
        if columns:
            keys = {key: row[key] for key in COLUMNS if key in row and key not in columns}
            tables.append(pd.DataFrame({**keys, **columns})[list(COLUMNS)])
    return pd.concat(tables[1:] or tables, ignore_index=True)


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
        `casswarm.comparison.result.iterate_columns`.
    """

    runs: pd.DataFrame
    problems: pd.DataFrame
    inputs: dict[str, Any]
    iterates: pd.DataFrame = field(default_factory=lambda: pd.DataFrame(columns=list(COLUMNS)))

    @property
    def tolerances(self) -> Tolerances:
        """Tolerances within which an answer counts as solved."""
        return Tolerances(**self.inputs["tolerances"])

    @cached_property
    def summary(self) -> pd.DataFrame:
        """Summary by (family, start, solver); see `casswarm.comparison.verification.summary`."""
        return summary(self.runs, float(self.inputs["time_limit"]))

    @cached_property
    def ranking(self) -> pd.DataFrame:
        """Ranks by (family, start, solver); see `casswarm.comparison.ranking.ranking`."""
        return ranking(self.runs, float(self.inputs["time_limit"]))

    @cached_property
    def pooled_ranking(self) -> pd.DataFrame:
        """Ranks by (family, solver), all starts together, each problem with its starts one unit.

        See `casswarm.comparison.ranking.pooled_ranking`.
        """
        return pooled_ranking(self.runs, float(self.inputs["time_limit"]))

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
        _require_known("family", family, self.runs)
        _require_known("start", start, self.runs)
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
        runs, iterates = self.runs, self.iterates
        if problem is None:
            problem = str((iterates if len(iterates) else runs)["problem"].iloc[0])
        _require_known("problem", problem, runs)
        part = runs[(runs["problem"] == problem) & runs["applicable"] & (runs["copy"] == 0)]
        start = part["start"].iloc[0] if start is None else start
        _require_known("start", start, part)
        part = part[part["start"] == start].set_index("solver")
        best = float(part["best_objective"].iloc[0])
        unit = float(gap_unit(part["best_objective"], part["objective_scale"]).iloc[0])
        mine = iterates[(iterates["problem"] == problem) & (iterates["start"] == start)]
        table = mine.drop(columns=["family", "problem", "start"]).assign(
            feasible=mine["violation"] <= self.tolerances.violation,
            gap=(mine["objective"] - best).abs() / unit,
        )
        slow = part["solve_seconds"] > longest(float(self.inputs["time_limit"]))
        missing = {
            solver: NOT_RECORDED if slow[solver] else NOT_REPORTED
            for solver in part.index.difference(pd.Index(table["solver"]), sort=False)
        }
        solvers = tuple(self.inputs["solvers"])
        return Convergence(problem, start, best, table.reset_index(drop=True), missing, solvers)

    def agreement(self, other: Comparison) -> Agreement:
        """Test if this and another comparison rank the solvers within each other's error bars.

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

    def report(self, path: str | Path) -> None:
        """Write the report of ``casswarm compare``: answer, set-up, tables and figures.

        Parameters
        ----------
        path : str or Path
            A file that ends in .html, a page that contains its figures; or in .md, Markdown with
            the figures beside it as PNG files. Existing files are replaced.

        Raises
        ------
        ComparisonError
            Another ending.
        """
        import_module(_REPORT, __package__).write_report(self, Path(path))

    def save(self, folder: str | Path) -> None:
        """Save the comparison in a folder, from which `load` reads it; existing files are replaced.

        Writes run.json with the inputs and the date, and tables as CSV files, as ``casswarm
        compare`` does.
        """
        folder = Path(folder)
        folder.mkdir(parents=True, exist_ok=True)
        tables = {f"{name}.csv": table for name, table in saved_tables(self).items()}
        for name, table in tables.items():
            atomic_write(folder / name, table.to_csv(index=False))
        record = {
            "command": "compare",
            "inputs": self.inputs,
            "versions": self.inputs["versions"],
            "files": listed({name: digest(folder / name) for name in tables}),
            "finished": time_stamp(),
        }
        atomic_write(folder / RECORD, json_text(record) + "\n")

    @classmethod
    def load(cls, folder: str | Path) -> Comparison:
        """Comparison that `save` or ``casswarm compare`` wrote.

        Raises
        ------
        ComparisonError
            The folder holds none, or a damaged one.
        """
        return _read(Path(folder))

    def __repr__(self) -> str:
        solvers, problems = len(self.inputs["solvers"]), self.runs["problem"].nunique()
        solved = int(self.runs["solved"].sum())
        return (
            f"<Comparison of {counted(solvers, 'solver')} on {counted(problems, 'problem')}: "
            f"{solved} of {counted(len(self.runs), 'run')} solved>"
        )

    def __str__(self) -> str:
        text: str = import_module(_REPORT, __package__).comparison_text(self)
        return text


def _require_known(column: str, value: str | None, table: pd.DataFrame) -> None:
    """Raise ComparisonError for a value that no row has; None is none."""
    known = table[column].unique().tolist()
    if value is not None and value not in known:
        unknown = f"{column} {value!r} is unknown{did_you_mean(value, known)}"
        raise ComparisonError(unknown, **{column: value})


def longest(time_limit: float) -> float:
    """Seconds of a solve up to which it is repeated to record its iterates."""
    return time_limit / 2


def typical_problem(comparison: Comparison, family: str, start: str) -> str | None:
    """Problem of a family whose recorded solves have the median number of iterations in total.

    None if no iterate is recorded.
    """
    table = comparison.iterates
    part = table[(table["family"] == family) & (table["start"] == start)]
    last = part.groupby(["problem", "solver"], sort=False)["iteration"].max()
    totals = last.groupby("problem", sort=False).sum().sort_values(kind="stable")
    return str(totals.index[(len(totals) - 1) // 2]) if len(totals) else None


def _evaluated(nlp: Nlp, instance: Instances, x: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Objective and largest violation at points (K, nx)."""
    f, g = nlp.evaluate(x.T, instance.p[0])
    values = np.hstack([x, np.asarray(g).T.reshape(len(x), -1)])
    lower = np.concatenate([instance.lbx[0], instance.lbg[0]])
    upper = np.concatenate([instance.ubx[0], instance.ubg[0]])
    violations = np.maximum(lower - values, values - upper)
    return np.asarray(f).ravel(), np.maximum(violations.max(axis=1, initial=0.0), 0.0)


_TEXTS = ("message", "violated_row", "reason")
"""Columns of texts that can be empty."""


def saved_tables(comparison: Comparison) -> dict[str, pd.DataFrame]:
    """Tables that a comparison is restored from, by the names of their files."""
    return {
        "runs": comparison.runs,
        "traits": comparison.problems,
        "iterates": comparison.iterates,
    }


def _read(folder: Path) -> Comparison:
    """The comparison in a folder."""
    try:
        record = read_record(folder)
        if record["command"] != "compare":
            command = record["command"]
            raise ComparisonError(f"{folder} was written by casswarm {command}", folder=folder)
        inputs = dict(record["inputs"])
        runs = _table(folder, "runs")
        for name in runs.columns.intersection(list(_TEXTS)):
            runs[name] = ["" if pd.isna(text) else text for text in runs[name]]
        missing = {"family", "problem", "start", "solver", "solved"} - set(runs)
        if missing or "time_limit" not in inputs:
            lacking = ", ".join(sorted(missing)) or "time_limit"
            raise ComparisonError(f"{folder} lacks {lacking}", folder=folder)
        problems, iterates = _table(folder, "traits"), _table(folder, "iterates")
        if problems.empty:  # not saved, so their sizes are unknown
            problems = runs[["family", "problem"]].drop_duplicates(ignore_index=True)
            problems = problems.assign(variables=math.nan, constraints=math.nan)
    except FileNotFoundError as error:
        raise ComparisonError(
            f"{folder} holds no comparison: it has no {Path(str(error.filename)).name}",
            folder=folder,
        ) from None
    except ComparisonError:
        raise
    except DAMAGED as error:
        message = f"the comparison in {folder} cannot be read: {error}"
        raise ComparisonError(message, folder=folder) from error
    return Comparison(runs, problems, inputs, iterates)


def _table(folder: Path, name: str) -> pd.DataFrame:
    """A table; empty if it has no rows, or is of iterates or traits that were not saved."""
    path = folder / f"{name}.csv"
    if name != "runs" and not path.exists():
        return pd.DataFrame(columns=list(COLUMNS) if name == "iterates" else [])
    return read_table(path)
