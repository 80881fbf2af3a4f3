"""CasADi's SQP method: quadratic subproblems by an active-set solver."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar, Literal

from ..solution import Status
from .base import Capabilities
from .casadi_nlpsol import NlpsolSolver
from .options import Positive, PositiveInt

QP_SOLVERS: dict[str, dict[str, Any]] = {
    "qpoases": {"printLevel": "none"},
    "qrqp": {"print_header": False, "print_info": False, "print_iter": False},
    "daqp": {},
    "osqp": {"osqp": {"verbose": False, "eps_abs": 1e-10, "eps_rel": 1e-10, "max_iter": 20000}},
}
"""CasADi's convex solvers that the method works with, and the options that silence each."""


@dataclass(frozen=True)
class Sqp(NlpsolSolver):
    """CasADi's ``sqpmethod``: line search on a merit function, elastic where a QP is infeasible.

    BFGS and the exact Hessian solve about as many problems, BFGS in half the time. The exact one is
    made positive definite by a multiple of the identity, after Gershgorin. CasADi can reflect or
    clip its eigenvalues too, but does not always find them, and then stops without a status.

    Parameters
    ----------
    tolerance : float
        Of primal and dual infeasibility.
    max_iter : int
    hessian : {"limited-memory", "exact"}
        BFGS, or exact and convexified.
    qp_solver : {"qpoases", "qrqp", "daqp", "osqp"}
    """

    tolerance: Positive = 1e-6
    max_iter: PositiveInt = 500
    hessian: Literal["exact", "limited-memory"] = "limited-memory"
    qp_solver: Literal["qpoases", "qrqp", "daqp", "osqp"] = "qpoases"

    name: ClassVar[str] = "sqp"
    summary: ClassVar[str] = "sequential quadratic programming with active-set QPs; any problem"
    capabilities: ClassVar[Capabilities] = Capabilities(multipliers=True)
    plugin: ClassVar[str] = "sqpmethod"
    prints_to_stdout: ClassVar[bool] = True  # qpOASES prints its licence
    # a search direction that became too small is no success
    statuses: ClassVar[dict[str, Status]] = {
        "Solve_Succeeded": Status.SOLVED,
        "Maximum_Iterations_Exceeded": Status.ITERATION_LIMIT,
    }

    def plugin_options(self) -> dict[str, Any]:
        """See `NlpsolSolver.plugin_options`."""
        options: dict[str, Any] = {
            "qpsol": self.qp_solver,
            "qpsol_options": {"error_on_fail": False, **QP_SOLVERS[self.qp_solver]},
            "tol_pr": self.tolerance,
            "tol_du": self.tolerance,
            "max_iter": self.max_iter,
            "elastic_mode": True,
            "max_iter_ls": 8,  # with more, steps that are too short end no cycle
            "beta": 0.5,
            "min_step_size": 0.0,  # multipliers may still change where x does not
            "hessian_approximation": self.hessian,
            "print_header": False,
            "print_iteration": False,
            "print_status": False,
        }
        if self.hessian == "exact":
            options["convexify_strategy"] = "regularize"
        return options
