"""Verification of benchmark runs: which solver solved which problem, by recomputed residuals."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields
from functools import partial
from typing import Any, Literal, TypeAlias

import numpy as np
import pandas as pd

from .._util.text import shown
from ..errors import ComparisonError
from ..nlp.conversion import START
from ..nlp.solution import Status
from ..solvers.base import VIOLATION
from .profiles import shifted_geometric_mean

NOT_APPLICABLE = "not applicable"
"""Status of a run whose solver does not support the problem, which is no failure."""

Success: TypeAlias = Literal["solved", "best_known", "feasible", "low_accuracy", "high_accuracy"]
"""Columns of `verify` that say which runs succeeded."""

TESTS = ("solved", "low_accuracy", "high_accuracy", "best_known")
COUNTS = ("true_positives", "false_positives", "missed", "unsolved")
"""Columns of `summary`: fractions of the runs that pass a test, and numbers of runs."""

SHIFT = 1e-3
"""Shift of the geometric means of times, in seconds."""


@dataclass(frozen=True)
class Tolerances:
    """Tolerances of solutions; all bound residuals that are recomputed from the problem.

    Answers are tested in two ways: by absolute residuals, which decide whether a problem is solved,
    and by `casswarm.nlp.residuals.relative_error`, which does not depend on units, at two
    tolerances. 1e-4 is enough for most uses. 1e-7 is what Newton-like methods reach with default
    options: they stop at 1e-8 in units of their own, so that less would test their options.

    Parameters
    ----------
    violation : float
        Largest violation of a bound or constraint, absolute.
    stationarity : float
        Largest component of the Lagrangian's gradient, in `Instances.scale`.
    complementarity : float
        Largest product of a multiplier and its slack, relative to the scale of the objective.
    objective : float
        Gap to the best known objective up to which an answer counts as best known, relative to
        that objective (or to a thousandth of the objective's scale, if it is smaller).
    low_accuracy, high_accuracy : float
        Largest relative errors of the two scale-invariant tests.
    """

    violation: float = VIOLATION
    stationarity: float = 1e-4
    complementarity: float = 1e-4
    objective: float = 1e-4
    low_accuracy: float = 1e-4
    high_accuracy: float = 1e-7

    def __post_init__(self) -> None:
        for field in fields(self):
            value = getattr(self, field.name)
            if not value > 0:
                message = f"tolerance {field.name} = {shown(value)}; allowed: above zero"
                raise ComparisonError(message, key=field.name, value=value)


def verify(runs: pd.DataFrame, tolerances: Tolerances) -> pd.DataFrame:
    """Benchmark runs with columns that say which of them solved their problem.

    Parameters
    ----------
    runs : DataFrame
        A row per (problem, copy, start, solver): see `casswarm.comparison.run.benchmark`.
    tolerances : Tolerances

    Returns
    -------
    DataFrame
        With further columns: applicable; reported_success (the solver's own status is a success);
        feasible (no constraint is violated by more than its tolerance); verified (all residuals are
        within the tolerances); solved (reported and verified); low_accuracy and high_accuracy
        (reported, and the relative error is within these tolerances); best_objective (smallest
        objective of any feasible answer to the problem, of any solver, start and copy); gap,
        relative; quality (1 - gap of feasible answers, at least 0, and 0 of others); best_known
        (solved, and the gap is within its tolerance); reason (why not solved).
    """
    table = runs.copy()
    table["applicable"] = table["status"] != NOT_APPLICABLE
    table["reported_success"] = table["reported_status"].isin([Status.SOLVED, Status.ACCEPTABLE])
    table["feasible"] = table["violation"] <= tolerances.violation
    table["verified"] = (
        table["feasible"]
        & (table["stationarity"] <= tolerances.stationarity)
        & (table["complementarity"] <= tolerances.complementarity)
    )
    table["solved"] = table["reported_success"] & table["verified"]
    for name in ("low_accuracy", "high_accuracy"):
        close = table["relative_error"] <= getattr(tolerances, name)
        table[name] = table["reported_success"] & close
    objectives = table["objective"].where(table["feasible"])
    table["best_objective"] = objectives.groupby(table["problem"]).transform("min")
    unit = gap_unit(table["best_objective"], table["objective_scale"])
    table["gap"] = (table["objective"] - table["best_objective"]) / unit
    table["quality"] = (1.0 - table["gap"]).clip(lower=0.0).where(table["feasible"], 0.0)
    table["best_known"] = table["solved"] & (table["gap"] <= tolerances.objective)
    table["reason"] = [_reason(row, tolerances) for row in table.to_dict("records")]
    return table


def gap_unit(best_objective: pd.Series, objective_scale: pd.Series) -> pd.Series:
    """Unit of relative gaps of the objective."""
    return best_objective.abs().clip(lower=1e-3 * objective_scale)


def summary(table: pd.DataFrame, time_limit: float) -> pd.DataFrame:
    """Summary by (family, start, solver), of solvers that apply to some of the family's problems.

    Columns: problems; runs, of the problems and their copies; of the runs, the counts applicable,
    true_positives (reported as solved, and verified), false_positives (reported as solved, but not
    verified), missed (verified, but not reported) and unsolved; solved, low_accuracy, high_accuracy
    and best_known as fractions of all runs; mean_ms, the shifted geometric mean of the solve time
    with failures counted at `time_limit` seconds; build_ms, iterations and evaluations, medians
    over the solved runs.
    """
    reported, verified, solved = table["reported_success"], table["verified"], table["solved"]
    masks = (reported & verified, reported & ~verified, ~reported & verified, ~reported & ~verified)
    medians = {"build_ms": "build_seconds"} | {name: name for name in ("iterations", "evaluations")}
    runs = table.assign(
        mean_ms=table["solve_seconds"].where(solved, time_limit).clip(upper=time_limit),
        **dict(zip(COUNTS, masks, strict=True)),
        **{name: table[column].where(solved) for name, column in medians.items()},
    )
    groups = runs.groupby(["family", "start", "solver"], sort=False).agg(
        problems=("problem", "nunique"),
        runs=("problem", "size"),
        **{name: (name, "sum") for name in ("applicable", *COUNTS)},
        **{name: (name, "mean") for name in TESTS},
        mean_ms=("mean_ms", partial(shifted_geometric_mean, shift=SHIFT)),
        **{name: (name, "median") for name in medians},
    )
    groups[["mean_ms", "build_ms"]] *= 1e3
    return groups[groups["applicable"] > 0].reset_index()


def groups(table: pd.DataFrame) -> list[tuple[str, str]]:
    """Families and starts to which some solver applies, in order."""
    pairs = table.loc[table["applicable"], ["family", "start"]].drop_duplicates()
    return list(pairs.itertuples(index=False, name=None))


def start_text(start: str) -> str:
    """Words for a kind of start; a problem that has a single one was given with it."""
    return "given initial guess" if start == START else f"{start} start"


def by_problem(table: pd.DataFrame) -> pd.DataFrame:
    """Summary by (family, problem, start): how many runs solved it, and the fastest."""
    keys = ["family", "problem", "start"]
    counts = table.groupby(keys, sort=False).agg(
        applicable=("applicable", "sum"),
        solved=("solved", "sum"),
        best_known=("best_known", "sum"),
        best_objective=("best_objective", "first"),
    )
    solved = table[table["solved"]].sort_values("solve_seconds", kind="stable")
    fastest = solved.assign(ms=1e3 * solved["solve_seconds"]).groupby(keys)
    of_solved = fastest.agg(
        largest_gap=("gap", "max"), fastest=("solver", "first"), fastest_ms=("ms", "first")
    )
    return counts.join(of_solved).fillna({"fastest": ""}).reset_index()


def failures(table: pd.DataFrame) -> pd.DataFrame:
    """Runs that apply and did not solve their problem, by (family, solver, start, kind)."""
    failed = table[table["applicable"] & ~table["solved"]]
    groups = failed.assign(kind=failed["reason"].map(_kind)).groupby(
        ["family", "solver", "start", "kind"], sort=False
    )
    return groups.agg(
        runs=("problem", "size"), example=("problem", "first"), reason=("reason", "first")
    ).reset_index()


def not_applicable(table: pd.DataFrame) -> pd.DataFrame:
    """Runs whose solver does not apply, by (family, solver): how many, and why."""
    groups = table[~table["applicable"]].groupby(["family", "solver"], sort=False)
    return groups.agg(runs=("message", "size"), reason=("message", "first")).reset_index()


def costs(
    table: pd.DataFrame,
    family: str,
    start: str,
    column: str,
    success: Success = "solved",
) -> pd.DataFrame:
    """Costs for profiles: a row per run, a column per solver that applies to the family.

    The index has the problem's name, for each of its copies.

    Parameters
    ----------
    table : DataFrame
        From `verify`.
    family, start : str
    column : str
        The cost, such as solve_seconds or evaluations; at least 1e-9.
    success : {"solved", "best_known", "feasible", "low_accuracy", "high_accuracy"}
        The column that says which runs succeeded; the cost of others is infinite.
    """
    cost = table[column].astype(float).clip(lower=1e-9)
    cost = cost.where(table[success] & table[column].notna(), np.inf)
    return by_solver(table.assign(cost=cost), family, start, "cost").fillna(np.inf)


def by_solver(table: pd.DataFrame, family: str, start: str, column: str) -> pd.DataFrame:
    """A column of `verify`'s table as in `costs`, a column per solver that applies; NaN if absent.

    The rows are in the order in which the problems and copies appear.
    """
    part = table[(table["family"] == family) & (table["start"] == start)]
    cases = part[["problem", "copy"]].drop_duplicates()
    wide = part.pivot(index=["problem", "copy"], columns="solver", values=column)
    solvers = part.loc[part["applicable"], "solver"].unique()
    rows = wide.reindex(index=pd.MultiIndex.from_frame(cases), columns=solvers)
    return rows.droplevel("copy")


def _reason(row: Mapping[Any, Any], tolerances: Tolerances) -> str:
    if row["solved"]:
        return ""
    if not row["reported_success"] or not row["applicable"]:
        return f"{row['status']}: {row['message']}"
    violated_row = f" ({row['violated_row']})" if row["violated_row"] else ""
    return f"reported as {row['reported_status']}, but " + ", ".join(
        f"{name} {row[name]:.1e}{violated_row if name == 'violation' else ''} > {limit:g}"
        for name in ("violation", "stationarity", "complementarity")
        for limit in (getattr(tolerances, name),)
        if not row[name] <= limit
    )


def _kind(reason: str) -> str:
    """A reason without its numbers; time limits are one kind, whatever the solver's message."""
    if reason.startswith(f"{Status.TIME_LIMIT}: "):
        return str(Status.TIME_LIMIT)
    if not reason.startswith("reported as "):
        return reason
    status, _, residuals = reason.partition(", but ")
    return f"{status}, but {', '.join(part.split()[0] for part in residuals.split(', '))} too large"
