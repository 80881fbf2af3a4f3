"""SLEQP, through CasADi: sequential linear-equality-constrained quadratic programming."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

from ..solution import Status
from .base import Capabilities, require
from .casadi_nlpsol import NlpsolSolver

STATUS = {
    "optimal": Status.SOLVED,
    "infeasible": Status.INFEASIBLE,
    "unbounded": Status.DIVERGED,
    "iteration limit": Status.ITERATION_LIMIT,
    "time limit": Status.TIME_LIMIT,
}
"""The plugin's return_status; its ``success`` is always true, even at a limit."""


@dataclass(frozen=True)
class Sleqp(NlpsolSolver):
    """SLEQP (after Byrd, Gould, Nocedal, Waltz, Math. Program. 100(1), 2004), damped BFGS.

    The plugin knows no tolerance: SLEQP's own is 1e-6, on stationarity relative to multipliers.

    Parameters
    ----------
    max_iterations : int
    max_seconds : float
        Wall time of one solve.
    """

    max_iterations: int = 1000
    max_seconds: float = 60.0

    name: ClassVar[str] = "sleqp"
    summary: ClassVar[str] = "active set by linear programs, then equality QPs; any problem"
    capabilities: ClassVar[Capabilities] = Capabilities(multipliers=True, time_limit=True)
    plugin: ClassVar[str] = "sleqp"
    wants_a_row: ClassVar[bool] = True  # or one solve in ten takes seconds, past its limit of time
    statuses: ClassVar[dict[str, Status]] = STATUS

    def __post_init__(self) -> None:
        require(self, "max_iterations", self.max_iterations >= 1, "whole numbers from 1")
        require(self, "max_seconds", self.max_seconds > 0, "above zero")

    def _options(self) -> dict[str, Any]:
        return {
            "max_iter": self.max_iterations,
            "max_wall_time": self.max_seconds,
            "print_level": 0,
        }
