"""What the cells of a comparison amount to: who solved what, by casswarm's own residuals."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd

from ..errors import ComparisonError
from ..optimization.solution import Status
from ..optimization.solvers.base import VIOLATION
from .profiles import shifted_geometric_mean

CANNOT = "cannot take"
"""Status of a cell whose solver is not made for the problem; no failure."""

SHIFT = 1e-3
"""Shift of the geometric means of times, in seconds."""


@dataclass(frozen=True)
class Tolerances:
    """What counts as solved. All are held against residuals recomputed from the problem.

    Parameters
    ----------
    violation : float
        Largest violation of a bound or constraint, absolute.
    stationarity : float
        Largest component of the Lagrangian's gradient, in `Instances.scale`.
    complementarity : float
        Largest product of a multiplier and its slack, in units of the objective.
    objective : float
        Gap to the best known objective up to which a solver has found it, relative to it (or to a
        thousandth of the objective's unit, where it is less than that).
    """

    violation: float = VIOLATION
    stationarity: float = 1e-4
    complementarity: float = 1e-4
    objective: float = 1e-4

    def __post_init__(self) -> None:
        for name in ("violation", "stationarity", "complementarity", "objective"):
            value = getattr(self, name)
            if not value > 0:
                raise ComparisonError(f"tolerance {name} = {value!r}; allowed: above zero")


def judged(cells: pd.DataFrame, tolerances: Tolerances) -> pd.DataFrame:
    """Cells with what they amount to.

    Parameters
    ----------
    cells : DataFrame
        A row a (problem, start, solver), as `casswarm.comparison.cells` makes them.
    tolerances : Tolerances

    Returns
    -------
    DataFrame
        With further columns: taken; said (the solver's status is a success); true (the residuals
        are within the tolerances); solved (both); best (least objective of any feasible answer to
        the problem, from whatever solver and start); gap, relative; found (solved, and the gap is
        within its tolerance); reason (why not solved).
    """
    table = cells.copy()
    table["taken"] = table["status"] != CANNOT
    table["said"] = [_success(word) for word in table["claim"]]
    feasible = table["violation"] <= tolerances.violation
    table["true"] = (
        feasible
        & (table["stationarity"] <= tolerances.stationarity)
        & (table["complementarity"] <= tolerances.complementarity)
    )
    table["solved"] = table["said"] & table["true"]
    objectives = table["objective"].where(feasible)
    table["best"] = objectives.groupby(table["problem"]).transform("min")
    scale = np.maximum(table["best"].abs(), 1e-3 * table["unit"])
    table["gap"] = (table["objective"] - table["best"]) / scale
    table["found"] = table["solved"] & (table["gap"] <= tolerances.objective)
    table["reason"] = [_reason(row, tolerances) for row in table.to_dict("records")]
    return table


def summary(table: pd.DataFrame, limit: float) -> pd.DataFrame:
    """A row a (family, start, solver) that can take some of the family's problems.

    Columns: problems; taken; the counts of said and true, said_not_true, true_not_said, neither;
    solved and found as shares of all problems; mean_ms, the shifted geometric mean of the solve
    time with failures counted at `limit` seconds; iterations and evaluations, medians where solved.
    """
    rows = []
    for (family, start, solver), part in table.groupby(["family", "start", "solver"], sort=False):
        if not part["taken"].any():
            continue
        said, true = part["said"], part["true"]
        done = part[part["solved"]]
        times = part["solve_seconds"].where(part["solved"], limit).clip(upper=limit)
        rows.append(
            {
                "family": family,
                "start": start,
                "solver": solver,
                "problems": len(part),
                "taken": int(part["taken"].sum()),
                "said_and_true": int((said & true).sum()),
                "said_not_true": int((said & ~true).sum()),
                "true_not_said": int((~said & true).sum()),
                "neither": int((~said & ~true).sum()),
                "solved": float(part["solved"].mean()),
                "found": float(part["found"].mean()),
                "mean_ms": 1e3 * float(shifted_geometric_mean(times, SHIFT)),
                "build_ms": 1e3 * float(done["build_seconds"].median()),
                "iterations": float(done["iterations"].median()),
                "evaluations": float(done["evaluations"].median()),
            }
        )
    return pd.DataFrame(rows)


def by_problem(table: pd.DataFrame) -> pd.DataFrame:
    """A row a (family, problem, start): how many solved it, the best known, who was fastest."""
    rows = []
    for (family, problem, start), part in table.groupby(["family", "problem", "start"], sort=False):
        done = part[part["solved"]].sort_values("solve_seconds", kind="stable")
        first = done.iloc[0] if len(done) else None
        rows.append(
            {
                "family": family,
                "problem": problem,
                "start": start,
                "taken": int(part["taken"].sum()),
                "solved": len(done),
                "found": int(part["found"].sum()),
                "best": float(part["best"].iloc[0]),
                "worst_gap": float(done["gap"].max()) if len(done) else math.nan,
                "fastest": "" if first is None else str(first["solver"]),
                "fastest_ms": math.nan if first is None else 1e3 * float(first["solve_seconds"]),
            }
        )
    return pd.DataFrame(rows)


def failures(table: pd.DataFrame) -> pd.DataFrame:
    """A row a (family, solver, start, reason) among the cells that were taken and not solved."""
    bad = table[table["taken"] & ~table["solved"]]
    keys = ["family", "solver", "start", "kind"]
    rows = [
        dict(zip(keys, key, strict=True))
        | {"cells": len(part), "example": part["problem"].iloc[0], "reason": part["reason"].iloc[0]}
        for key, part in bad.assign(kind=[_kind(r) for r in bad["reason"]]).groupby(
            keys, sort=False
        )
    ]
    return pd.DataFrame(rows, columns=[*keys, "cells", "example", "reason"])


def not_taken(table: pd.DataFrame) -> pd.DataFrame:
    """A row a (family, solver) with cells that the solver cannot take: how many, and why."""
    rows = [
        {
            "family": family,
            "solver": solver,
            "cells": len(part),
            "reason": part["words"].iloc[0],
        }
        for (family, solver), part in table[~table["taken"]].groupby(
            ["family", "solver"], sort=False
        )
    ]
    return pd.DataFrame(rows, columns=["family", "solver", "cells", "reason"])


def costs(
    table: pd.DataFrame, family: str, start: str, column: str, wanted: str = "solved"
) -> pd.DataFrame:
    """Costs for profiles: a row a problem, a column a solver that takes some of the family.

    Parameters
    ----------
    table : DataFrame
        From `judged`.
    family, start : str
    column : str
        The cost, such as solve_seconds or evaluations; at least 1e-9.
    wanted : {"solved", "found"}
        What is no failure.
    """
    part = table[(table["family"] == family) & (table["start"] == start)]
    cost = part[column].clip(lower=1e-9).where(part[wanted] & part[column].notna(), np.inf)
    wide = part.assign(cost=cost).pivot(index="problem", columns="solver", values="cost")
    order = list(dict.fromkeys(part.loc[part["taken"], "solver"]))
    return wide.reindex(index=list(dict.fromkeys(part["problem"])), columns=order).fillna(np.inf)


def _success(word: object) -> bool:
    return word in (Status.SOLVED, Status.ACCEPTABLE)


def _reason(row: Mapping[Any, Any], tolerances: Tolerances) -> str:
    if row["solved"]:
        return ""
    if not row["said"] or not row["taken"]:
        return f"{row['status']}: {row['words']}"
    worst = f" ({row['worst']})" if row["worst"] else ""
    return f"called {row['claim']}, but " + ", ".join(
        f"{name} {row[name]:.1e}{worst if name == 'violation' else ''} > {limit:g}"
        for name in ("violation", "stationarity", "complementarity")
        for limit in (getattr(tolerances, name),)
        if not row[name] <= limit
    )


def _kind(reason: str) -> str:
    """A reason without its numbers; a limit of time is one, whoever's words tell of it."""
    if reason.startswith(f"{Status.TIME_LIMIT}: "):
        return str(Status.TIME_LIMIT)
    if not reason.startswith("called "):
        return reason
    claim, _, residuals = reason.partition(", but ")
    return f"{claim}, but {', '.join(part.split()[0] for part in residuals.split(', '))} too large"
