"""Uno, through CasADi: trust-region SQP with a filter."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

from ..solution import Status
from .base import Capabilities
from .casadi_nlpsol import NlpsolSolver
from .options import Positive, PositiveInt


@dataclass(frozen=True)
class Uno(NlpsolSolver):
    """Uno (Vanaret, Leyffer, arXiv:2406.13454) as its preset ``filtersqp`` composes it.

    Parameters
    ----------
    tolerance : float
        Uno's ``primal_tolerance`` and ``dual_tolerance``; the latter is scaled by multipliers.
    max_iter : int
    time_limit : float
        CPU time of one solve, in seconds.
    """

    tolerance: Positive = 1e-7
    max_iter: PositiveInt = 500
    time_limit: Positive = 60.0

    name: ClassVar[str] = "uno"
    summary: ClassVar[str] = "trust-region filter SQP, exact derivatives; any problem"
    capabilities: ClassVar[Capabilities] = Capabilities(multipliers=True, time_limit=True)
    plugin: ClassVar[str] = "uno"
    prints_to_stdout: ClassVar[bool] = True  # warnings on fixed variables and rows without bounds
    # small steps and Fritz John points are failures; limits share one text with errors
    statuses: ClassVar[dict[str, Status]] = {
        "Converged with feasible KKT point": Status.SOLVED,
        "Converged with infeasible stationary point": Status.INFEASIBLE,
        "Terminated with unbounded problem": Status.DIVERGED,
    }

    def plugin_options(self) -> dict[str, Any]:
        """See `NlpsolSolver.plugin_options`."""
        return {
            "uno": {
                "preset": "filtersqp",
                "logger": "SILENT",
                "primal_tolerance": self.tolerance,
                "dual_tolerance": self.tolerance,
                "max_iterations": self.max_iter,
                "time_limit": self.time_limit,
            }
        }
