"""SciPy's SLSQP, with exact derivatives."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from ..solution import Status
from .base import Capabilities, require
from .scipy import Functions, ScipySolver

STATUS = {
    "Optimization terminated successfully": Status.SOLVED,
    "Iteration limit reached": Status.ITERATION_LIMIT,
}
"""OptimizeResult.message; that a quadratic subproblem is incompatible proves nothing."""


@dataclass(frozen=True)
class Slsqp(ScipySolver):
    """SLSQP (Kraft, DFVLR-FB 88-28, 1988): BFGS and least-squares subproblems, dense.

    Parameters
    ----------
    tolerance : float
        SciPy's ``ftol``: of the objective's change and of the constraints.
    max_iterations : int
    max_seconds : float
        Wall time of one solve.
    """

    tolerance: float = 1e-8
    max_iterations: int = 1000
    max_seconds: float = 60.0

    name: ClassVar[str] = "slsqp"
    summary: ClassVar[str] = "SciPy's dense SQP with BFGS, exact gradients; any problem"
    capabilities: ClassVar[Capabilities] = Capabilities(time_limit=True)
    statuses: ClassVar[dict[str, Status]] = STATUS

    def __post_init__(self) -> None:
        require(self, "tolerance", self.tolerance > 0, "above zero")
        require(self, "max_iterations", self.max_iterations >= 1, "whole numbers from 1")
        require(self, "max_seconds", self.max_seconds > 0, "above zero")

    def _minimise(self, functions: Functions) -> Any:
        from scipy.optimize import Bounds, minimize  # slow to import, and seldom needed

        return minimize(
            functions.objective,
            functions.start,
            method="SLSQP",
            jac=functions.gradient,
            bounds=Bounds(functions.lower, functions.upper),
            constraints=_constraints(functions),
            options={"ftol": self.tolerance, "maxiter": self.max_iterations},
        )


def _constraints(functions: Functions) -> list[dict[str, Any]]:
    """Equations as c(x) = 0, and every finite side of the other rows as c(x) >= 0."""
    low, high = functions.lower_g, functions.upper_g
    equal = low == high
    sides = (
        ("eq", 1.0, low, equal),
        ("ineq", 1.0, low, ~equal & np.isfinite(low)),
        ("ineq", -1.0, high, ~equal & np.isfinite(high)),
    )
    return [
        {
            "type": kind,
            "fun": lambda x, s=sign, b=bound, r=rows: s * (functions.rows(x) - b)[r],
            "jac": lambda x, s=sign, r=rows: s * functions.jacobian(x).toarray()[r],
        }
        for kind, sign, bound, rows in sides
        if rows.any()
    ]
