"""Ipopt, through CasADi: an interior-point method with exact derivatives."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar, Literal

from ..solution import Status
from .base import Capabilities, require
from .casadi_nlpsol import NlpsolSolver

STATUS = {
    "Solve_Succeeded": Status.SOLVED,
    "Solved_To_Acceptable_Level": Status.ACCEPTABLE,
    "Infeasible_Problem_Detected": Status.INFEASIBLE,
    "Maximum_Iterations_Exceeded": Status.ITERATION_LIMIT,
    "Maximum_CpuTime_Exceeded": Status.TIME_LIMIT,
    "Maximum_WallTime_Exceeded": Status.TIME_LIMIT,
    "Diverging_Iterates": Status.DIVERGED,
}
"""Ipopt's return_status; every other word is a failure."""

HESSIANS = ("exact", "limited-memory")
BARRIERS = ("monotone", "adaptive")


@dataclass(frozen=True)
class Ipopt(NlpsolSolver):
    """Ipopt (Waechter, Biegler, Math. Program. 106(1), 2006), with MUMPS.

    Parameters
    ----------
    tolerance : float
        Ipopt's ``tol`` and ``constr_viol_tol``.
    max_iterations : int
    max_seconds : float
        Wall time of one solve.
    hessian : {"exact", "limited-memory"}
    memory : int
        Steps that the limited-memory approximation remembers.
    barrier : {"monotone", "adaptive"}
        Ipopt's ``mu_strategy``.
    feasibility : float, optional
        Ipopt's ``constr_viol_tol``, where it is not to be that of ``tol``.
    push : float, optional
        How far, relatively, the start is moved away from its bounds: Ipopt's ``bound_push`` and
        its three relatives, 0.01 by default.
    first_barrier : float, optional
        Ipopt's ``mu_init``, 0.1 by default: less stays nearer to a good start.
    """

    tolerance: float = 1e-8
    max_iterations: int = 500
    max_seconds: float = 60.0
    hessian: Literal["exact", "limited-memory"] = "exact"
    memory: int = 6
    barrier: Literal["monotone", "adaptive"] = "monotone"
    feasibility: float | None = None
    push: float | None = None
    first_barrier: float | None = None

    name: ClassVar[str] = "ipopt"
    summary: ClassVar[str] = "interior point, exact derivatives; any problem"
    capabilities: ClassVar[Capabilities] = Capabilities(multipliers=True, time_limit=True)
    plugin: ClassVar[str] = "ipopt"
    statuses: ClassVar[dict[str, Status]] = STATUS

    def __post_init__(self) -> None:
        require(self, "tolerance", self.tolerance > 0, "above zero")
        require(self, "max_iterations", self.max_iterations >= 0, "zero or above")
        require(self, "max_seconds", self.max_seconds > 0, "above zero")
        require(self, "hessian", self.hessian in HESSIANS, " or ".join(map(repr, HESSIANS)))
        require(self, "barrier", self.barrier in BARRIERS, " or ".join(map(repr, BARRIERS)))
        require(self, "memory", self.memory >= 1, "one or above")
        for name in ("feasibility", "push", "first_barrier"):
            given = getattr(self, name)
            require(self, name, given is None or given > 0, "above zero, or None")

    @property
    def second_derivatives(self) -> bool:
        """Whether Hessians are exact."""
        return self.hessian == "exact"

    def _options(self) -> dict[str, Any]:
        pushes = ("bound_push", "bound_frac", "slack_bound_push", "slack_bound_frac")
        moved = {} if self.push is None else dict.fromkeys(pushes, self.push)
        first = {} if self.first_barrier is None else {"mu_init": self.first_barrier}
        return {
            "ipopt": {
                **moved,
                **first,
                "tol": self.tolerance,
                "constr_viol_tol": self.feasibility or self.tolerance,
                "max_iter": self.max_iterations,
                "max_wall_time": self.max_seconds,
                "hessian_approximation": self.hessian,
                "limited_memory_max_history": self.memory,
                "mu_strategy": self.barrier,
                "honor_original_bounds": "yes",
                "print_level": 0,
                "sb": "yes",
            }
        }
