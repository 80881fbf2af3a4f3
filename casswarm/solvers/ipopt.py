"""Ipopt, through CasADi: an interior-point method with exact derivatives."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, ClassVar, Literal

import casadi as ca
import numpy as np

from ..nlp import Instances, Nlp
from ..solution import Status
from .base import Answer, Solver, require

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


@dataclass(frozen=True)
class Ipopt(Solver):
    """Ipopt (Waechter, Biegler, Math. Program. 106(1), 2006), with MUMPS.

    Parameters
    ----------
    tolerance : float
        Ipopt's ``tol`` and ``constr_viol_tol``.
    max_iterations : int
    max_seconds : float
        Wall time of one solve.
    hessian : {"exact", "limited-memory"}
    """

    tolerance: float = 1e-8
    max_iterations: int = 500
    max_seconds: float = 60.0
    hessian: Literal["exact", "limited-memory"] = "exact"

    name: ClassVar[str] = "ipopt"
    summary: ClassVar[str] = "interior point, exact derivatives; any problem"

    def __post_init__(self) -> None:
        require(self, "tolerance", self.tolerance > 0, "above zero")
        require(self, "max_iterations", self.max_iterations >= 0, "zero or above")
        require(self, "max_seconds", self.max_seconds > 0, "above zero")
        require(self, "hessian", self.hessian in HESSIANS, " or ".join(map(repr, HESSIANS)))

    def _build(self, nlp: Nlp) -> None:
        _compiled(self, nlp)

    def _run(self, nlp: Nlp, instances: Instances) -> Sequence[Answer]:
        function = _compiled(self, nlp)
        return [_solve(function, instances, i) for i in range(len(instances))]


def _solve(function: Any, instances: Instances, i: int) -> Answer:
    started = time.perf_counter()
    try:
        out = function(
            x0=instances.start[i],
            p=instances.parameters[i],
            lbx=instances.lower[i],
            ubx=instances.upper[i],
            lbg=instances.lower_g[i],
            ubg=instances.upper_g[i],
        )
    except RuntimeError as error:  # CasADi's, for example on NaN bounds
        if "KeyboardInterrupt" in str(error):
            raise KeyboardInterrupt from error
        seconds = time.perf_counter() - started
        return Answer(instances.start[i], Status.FAILED, str(error), 0, 0, seconds)
    seconds = time.perf_counter() - started
    stats = function.stats()
    words = str(stats["return_status"])
    if words == "User_Requested_Stop":  # nobody but the user's Ctrl-C, which CasADi catches
        raise KeyboardInterrupt
    return Answer(
        x=np.asarray(out["x"]).ravel(),
        status=STATUS.get(words, Status.FAILED),
        message=words,
        iterations=int(stats["iter_count"]),
        evaluations=int(stats["n_call_nlp_f"]),
        seconds=seconds,
        multipliers=(np.asarray(out["lam_x"]).ravel(), np.asarray(out["lam_g"]).ravel()),
    )


@lru_cache(maxsize=64)
def _compiled(solver: Ipopt, nlp: Nlp) -> Any:
    options: dict[str, Any] = {
        "expand": nlp.unroll,
        "print_time": False,
        "error_on_fail": False,
        "show_eval_warnings": False,
        "record_time": True,
        "calc_lam_p": False,  # nobody asks for it, and it warns where a solve fails
        "ipopt": {
            "tol": solver.tolerance,
            "constr_viol_tol": solver.tolerance,
            "max_iter": solver.max_iterations,
            "max_wall_time": solver.max_seconds,
            "hessian_approximation": solver.hessian,
            "honor_original_bounds": "yes",
            "print_level": 0,
            "sb": "yes",
        },
    }
    problem = {"x": nlp.x, "p": nlp.p, "f": nlp.objective, "g": nlp.g}
    return ca.nlpsol("solver", "ipopt", problem, options)
