"""Ipopt, through CasADi: an interior-point method with exact derivatives."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, ClassVar, Literal

from ..solution import Status
from .base import Capabilities
from .casadi_nlpsol import NlpsolSolver
from .options import NonNegativeInt, Positive, PositiveInt


@dataclass(frozen=True)
class Ipopt(NlpsolSolver):
    """Ipopt (Waechter, Biegler, Math. Program. 106(1), 2006), with MUMPS.

    Parameters
    ----------
    tolerance : float
        Ipopt's ``tol`` and ``constr_viol_tol``.
    max_iter : int
    time_limit : float
        Wall time of one solve, in seconds.
    hessian : {"exact", "limited-memory"}
    memory : int
        Number of steps in the limited-memory approximation.
    mu_strategy : {"monotone", "adaptive"}
    constraint_tolerance : float, optional
        Ipopt's ``constr_viol_tol``; by default that of ``tol``.
    bound_push : float, optional
        Relative distance by which the initial guess is moved away from its bounds: Ipopt's
        ``bound_push``, ``bound_frac`` and their like for slacks, 0.01 by default.
    mu_init : float, optional
        Initial barrier parameter, 0.1 by default: a smaller one stays nearer to a good guess.
    print_level : int
        Ipopt's, from 0: how much it prints on standard output; 5 prints a line per iteration.
    """

    tolerance: Positive = 1e-8
    max_iter: NonNegativeInt = 500
    time_limit: Positive = 60.0
    hessian: Literal["exact", "limited-memory"] = "exact"
    memory: PositiveInt = 6
    mu_strategy: Literal["monotone", "adaptive"] = "monotone"
    constraint_tolerance: Positive | None = None
    bound_push: Positive | None = None
    mu_init: Positive | None = None
    print_level: NonNegativeInt = 0

    name: ClassVar[str] = "ipopt"
    summary: ClassVar[str] = "interior point, exact derivatives; any problem"
    capabilities: ClassVar[Capabilities] = Capabilities(multipliers=True, time_limit=True)
    plugin: ClassVar[str] = "ipopt"
    uses_hessian: ClassVar[bool] = True
    statuses: ClassVar[dict[str, Status]] = {
        "Solve_Succeeded": Status.SOLVED,
        "Solved_To_Acceptable_Level": Status.ACCEPTABLE,
        "Infeasible_Problem_Detected": Status.INFEASIBLE,
        "Maximum_Iterations_Exceeded": Status.ITERATION_LIMIT,
        "Maximum_CpuTime_Exceeded": Status.TIME_LIMIT,
        "Maximum_WallTime_Exceeded": Status.TIME_LIMIT,
        "Diverging_Iterates": Status.DIVERGED,
    }

    def warm(self) -> Ipopt:
        """With a small initial barrier parameter, which keeps it near its initial guess."""
        return self if self.mu_init is not None else replace(self, mu_init=1e-4)

    def from_feasible_guess(self) -> tuple[Ipopt, ...]:
        """See `Solver.from_feasible_guess`: hardly pushed away from bounds, hardly a barrier.

        Whether Ipopt then finds such a set is chance, but rarely for all of these settings.
        """
        return tuple(
            replace(self, bound_push=push, mu_init=barrier)
            for push, barrier in ((1e-10, 1e-8), (1e-4, 1e-6), (1e-8, 1e-9))
        )

    def plugin_options(self) -> dict[str, Any]:
        """See `NlpsolSolver.plugin_options`."""
        pushes = ("bound_push", "bound_frac", "slack_bound_push", "slack_bound_frac")
        pushed = {} if self.bound_push is None else dict.fromkeys(pushes, self.bound_push)
        barrier = {} if self.mu_init is None else {"mu_init": self.mu_init}
        return {
            "ipopt": {
                **pushed,
                **barrier,
                "tol": self.tolerance,
                "constr_viol_tol": self.constraint_tolerance or self.tolerance,
                "max_iter": self.max_iter,
                "max_wall_time": self.time_limit,
                "hessian_approximation": self.hessian,
                "limited_memory_max_history": self.memory,
                "mu_strategy": self.mu_strategy,
                "honor_original_bounds": "yes",
                "print_level": self.print_level,
                "sb": "yes",
            }
        }
