"""Convergence of solvers on a problem: objective and violation of their iterates."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd

from .._util.display import Displayed
from .._util.text import did_you_mean
from ..errors import ComparisonError, SolverError
from ..nlp.program import Instances, Nlp
from ..solvers import Isolated
from ..typing import FloatArray
from .problem import Problem
from .verification import gap_unit

if TYPE_CHECKING:
    from .result import Comparison

NOT_REPORTED = "reports no iterates"
"""Why a solver that took part has no convergence history."""

NOT_RECORDED = "not recorded: a solve takes more than half of the time limit"

COLUMNS = ("family", "problem", "start", "solver", "iteration", "seconds", "objective", "violation")
"""Columns of the table of all iterates: see `iterate_rows`."""


@dataclass(frozen=True, eq=False, repr=False)
class Convergence(Displayed):
    """How the solvers approached the best known objective of a problem; `plot` draws it.

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
        return f"<Convergence on {self.problem}, {self.start} start, of {solvers}>"


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


def convergence(
    comparison: Comparison, problem: str | None = None, start: str | None = None
) -> Convergence:
    """See `Comparison.convergence`."""
    runs, iterates = comparison.runs, comparison.iterates
    known = runs["problem"].unique().tolist()
    if problem is None:
        problem = str(iterates["problem"].iloc[0] if len(iterates) else known[0])
    if problem not in known:
        raise ComparisonError(f"problem {problem!r} is unknown{did_you_mean(problem, known)}")
    part = runs[(runs["problem"] == problem) & runs["applicable"] & (runs["copy"] == 0)]
    starts = part["start"].unique().tolist()
    start = starts[0] if start is None else start
    if start not in starts:
        raise ComparisonError(f"start {start!r} is unknown{did_you_mean(start, starts)}")
    part = part[part["start"] == start].set_index("solver")
    best = float(part["best_objective"].iloc[0])
    unit = float(gap_unit(part["best_objective"], part["objective_scale"]).iloc[0])
    mine = iterates[(iterates["problem"] == problem) & (iterates["start"] == start)]
    table = mine.drop(columns=["family", "problem", "start"]).assign(
        feasible=mine["violation"] <= comparison.tolerances.violation,
        gap=(mine["objective"] - best).abs() / unit,
    )
    slow = part["solve_seconds"] > longest(float(comparison.inputs["time_limit"]))
    missing = {
        solver: NOT_RECORDED if slow[solver] else NOT_REPORTED
        for solver in part.index.difference(pd.Index(table["solver"]), sort=False)
    }
    solvers = tuple(comparison.inputs["solvers"])
    return Convergence(problem, start, best, table.reset_index(drop=True), missing, solvers)


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
