"""SLEQP, through CasADi: sequential linear-equality-constrained quadratic programming."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

from ..solution import Status
from .base import Capabilities
from .casadi_nlpsol import NlpsolSolver
from .options import Positive, PositiveInt


@dataclass(frozen=True)
class Sleqp(NlpsolSolver):
    """SLEQP (after Byrd, Gould, Nocedal, Waltz, Math. Program. 100(1), 2004), damped BFGS.

    The plugin has no option for the tolerance: it is 1e-6, on stationarity relative to
    multipliers.

    Parameters
    ----------
    max_iter : int
    time_limit : float
        Wall time of one solve, in seconds.
    """

    max_iter: PositiveInt = 1000
    time_limit: Positive = 60.0

    name: ClassVar[str] = "sleqp"
    summary: ClassVar[str] = "active set by linear programs, then equality QPs; any problem"
    capabilities: ClassVar[Capabilities] = Capabilities(multipliers=True, time_limit=True)
    plugin: ClassVar[str] = "sleqp"
    needs_constraint_row: ClassVar[bool] = True  # or some solves exceed their time limit
    # the plugin's success is always true, even at a limit
    statuses: ClassVar[dict[str, Status]] = {
        "optimal": Status.SOLVED,
        "infeasible": Status.INFEASIBLE,
        "unbounded": Status.DIVERGED,
        "iteration limit": Status.ITERATION_LIMIT,
        "time limit": Status.TIME_LIMIT,
    }

    def plugin_options(self) -> dict[str, Any]:
        """See `NlpsolSolver.plugin_options`."""
        return {
            "max_iter": self.max_iter,
            "max_wall_time": self.time_limit,
            "print_level": 0,
        }
