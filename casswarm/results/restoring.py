"""Laws, runs and solutions made anew of the tables and rows that were written of them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import pandas as pd

from ..chain.distribution import OutcomeDistribution
from ..chain.trajectories import RunTrajectory
from ..optimization.solution import Residuals, Solution, Status

DISTRIBUTION_TABLES = ("laws", "arrival", "survivors", "members", "population")


def distributions_of(
    tables: Mapping[str, pd.DataFrame], tolerance: float
) -> list[OutcomeDistribution]:
    """The laws of the tables that `casswarm.studies.tables` makes of them."""
    found = []
    members = len(tables["members"])
    for row in tables["laws"].to_dict("records"):
        name = str(row["policy"])
        columns = [f"{name}_{k}" for k in range(members + 1)]
        found.append(
            OutcomeDistribution(
                policy=name,
                arrival=tables["arrival"][name].to_numpy(float),
                survivors=tables["survivors"][name].to_numpy(float),
                members=tables["members"][f"{name}_low"].to_numpy(float),
                population=tables["population"][columns].to_numpy(float),
                residual_mass_before=tables["arrival"][f"{name}_residual_mass"].to_numpy(float),
                residual_mass=float(row["residual_mass"]),
                states=int(row["states"]),
                infeasible=float(row["infeasible_mean"]),
                failures=float(row["solver_failures_mean"]),
                tolerance=tolerance,
                aggregation_tol=float(row["aggregation_tol"]),
            )
        )
    return found


def trajectories_of(table: pd.DataFrame) -> dict[str, tuple[RunTrajectory, ...]]:
    """The ways of runs of the table that `casswarm.studies.tables.trace_table` makes of them."""
    found: dict[str, list[RunTrajectory]] = {}
    for (policy, _), part in table.groupby(["policy", "run"], sort=False):
        members = int(part["member"].max()) + 1
        shape = (len(part) // members, members)
        leads = part["leads"].to_numpy(bool).reshape(shape)[:-1]
        leaders = np.where(leads.any(axis=1), leads.argmax(axis=1), -1)
        positions = part[["x", "y"]].to_numpy(float).reshape(*shape, 2)
        alive = part["alive"].to_numpy(bool).reshape(shape)
        found.setdefault(str(policy), []).append(RunTrajectory(positions, alive, leaders))
    return {policy: tuple(traces) for policy, traces in found.items()}


def solution_of(row: Mapping[str, Any] | None) -> Solution:
    """How a guide was solved, without its variables."""
    told = dict(row or {})
    nan = float("nan")
    residuals = Residuals(
        told.get("violation", nan),
        told.get("stationarity", nan),
        told.get("complementarity", nan),
        told.get("violated_row", ""),
    )
    return Solution(
        x=np.empty(0),
        objective=told.get("objective", nan),
        status=Status(told.get("status", Status.FAILED)),
        message=told.get("message", "not kept"),
        solver=told.get("solver", "unknown"),
        residuals=residuals,
        iterations=told.get("iterations", 0),
        evaluations=told.get("evaluations", 0),
        build_seconds=told.get("build_seconds", nan),
        solve_seconds=told.get("solve_seconds", nan),
    )
