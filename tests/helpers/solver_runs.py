"""Rows of a table of runs, as solvers would have been compared."""

from __future__ import annotations

from typing import Any

import numpy as np


def run(
    problem: str, solver: str, reported: str = "solved", objective: float = 1.0, **others: Any
) -> dict[str, Any]:
    """One run of a solver on a problem of the family f, with other values by column."""
    row = {"family": "f", "problem": problem, "copy": 0, "start": "cold", "solver": solver}
    row |= {"reported_status": reported, "status": reported, "message": "", "objective": objective}
    row |= dict.fromkeys(("violation", "stationarity", "complementarity", "relative_error"), 0.0)
    row |= {"violated_row": "", "iterations": 5, "evaluations": 6, "build_seconds": 0.01}
    row |= {"solve_seconds": 0.1, "solves": 1, "time_ratio": np.nan}
    return row | {"objective_scale": 1.0, "gradient_seconds": 1e-5} | others
