"""CasADi's SQP method: quadratic subproblems by an active-set solver."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar, Literal

from ..solution import Status
from .base import Capabilities, require
from .casadi_nlpsol import NlpsolSolver

STATUS = {
    "Solve_Succeeded": Status.SOLVED,
    "Maximum_Iterations_Exceeded": Status.ITERATION_LIMIT,
}
"""sqpmethod's return_status; a search direction that became too small is no success."""

HESSIANS = ("exact", "limited-memory")
QP_SOLVERS: dict[str, dict[str, Any]] = {
    "qpoases": {"printLevel": "none"},
    "qrqp": {"print_header": False, "print_info": False, "print_iter": False},
    "daqp": {},
    "osqp": {"osqp": {"verbose": False, "eps_abs": 1e-10, "eps_rel": 1e-10, "max_iter": 20000}},
}
"""CasADi's convex solvers that the method works with, and how each is kept silent."""


@dataclass(frozen=True)
class Sqp(NlpsolSolver):
    """CasADi's ``sqpmethod``: line search on a merit function, elastic where a QP is infeasible.

    BFGS and the exact Hessian solve about as many problems, BFGS in half the time. The exact one is
    made positive definite by a multiple of the identity, after Gershgorin. CasADi can reflect or
    clip its eigenvalues too, but does not always find them, and then gives up without a word.

    Parameters
    ----------
    tolerance : float
        Of primal and dual infeasibility.
    max_iterations : int
    hessian : {"limited-memory", "exact"}
        BFGS, or exact and convexified.
    qp_solver : {"qpoases", "qrqp", "daqp", "osqp"}
    """

    tolerance: float = 1e-6
    max_iterations: int = 500
    hessian: Literal["exact", "limited-memory"] = "limited-memory"
    qp_solver: str = "qpoases"

    name: ClassVar[str] = "sqp"
    summary: ClassVar[str] = "sequential quadratic programming with active-set QPs; any problem"
    capabilities: ClassVar[Capabilities] = Capabilities(multipliers=True)
    plugin: ClassVar[str] = "sqpmethod"
    talks: ClassVar[bool] = True  # qpOASES, of its licence
    statuses: ClassVar[dict[str, Status]] = STATUS

    def __post_init__(self) -> None:
        require(self, "tolerance", self.tolerance > 0, "above zero")
        require(self, "max_iterations", self.max_iterations >= 1, "whole numbers from 1")
        require(self, "hessian", self.hessian in HESSIANS, " or ".join(map(repr, HESSIANS)))
        known = self.qp_solver in QP_SOLVERS
        require(self, "qp_solver", known, " or ".join(map(repr, QP_SOLVERS)))

    def _options(self) -> dict[str, Any]:
        options: dict[str, Any] = {
            "qpsol": self.qp_solver,
            "qpsol_options": {"error_on_fail": False, **QP_SOLVERS[self.qp_solver]},
            "tol_pr": self.tolerance,
            "tol_du": self.tolerance,
            "max_iter": self.max_iterations,
            "elastic_mode": True,
            "max_iter_ls": 8,  # with more, steps that are too short end no cycle
            "beta": 0.5,
            "min_step_size": 0.0,  # where x stands still, its multipliers may still be on their way
            "hessian_approximation": self.hessian,
            "print_header": False,
            "print_iteration": False,
            "print_status": False,
        }
        if self.hessian == "exact":
            options["convexify_strategy"] = "regularize"
        return options
