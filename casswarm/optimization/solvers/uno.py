"""Uno, through CasADi: trust-region SQP with a filter."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

from ..solution import Status
from .base import Capabilities, require
from .casadi_nlpsol import NlpsolSolver

STATUS = {
    "Converged with feasible KKT point": Status.SOLVED,
    "Converged with infeasible stationary point": Status.INFEASIBLE,
    "Terminated with unbounded problem": Status.DIVERGED,
}
"""The plugin's return_status; small steps and Fritz John points are failures."""

NOT_OPTIMAL = "Terminated with not optimal point"
"""Said of every limit alike, and of errors."""


@dataclass(frozen=True)
class Uno(NlpsolSolver):
    """Uno (Vanaret, Leyffer, arXiv:2406.13454) as its preset ``filtersqp`` composes it.

    Parameters
    ----------
    tolerance : float
        Uno's ``primal_tolerance`` and ``dual_tolerance``; the latter is scaled by multipliers.
    max_iterations : int
    max_seconds : float
        CPU time of one solve.
    """

    tolerance: float = 1e-7
    max_iterations: int = 500
    max_seconds: float = 60.0

    name: ClassVar[str] = "uno"
    summary: ClassVar[str] = "trust-region filter SQP, exact derivatives; any problem"
    capabilities: ClassVar[Capabilities] = Capabilities(multipliers=True, time_limit=True)
    plugin: ClassVar[str] = "uno"
    talks: ClassVar[bool] = True  # of variables that are fixed and rows without bounds
    statuses: ClassVar[dict[str, Status]] = STATUS

    def __post_init__(self) -> None:
        require(self, "tolerance", self.tolerance > 0, "above zero")
        require(self, "max_iterations", self.max_iterations >= 1, "whole numbers from 1")
        require(self, "max_seconds", self.max_seconds > 0, "above zero")

    def _options(self) -> dict[str, Any]:
        return {
            "uno": {
                "preset": "filtersqp",
                "logger": "SILENT",
                "primal_tolerance": self.tolerance,
                "dual_tolerance": self.tolerance,
                "max_iterations": self.max_iterations,
                "time_limit": self.max_seconds,
            }
        }

    def _status(self, words: str, stats: Mapping[str, Any]) -> Status:
        if words == NOT_OPTIMAL and stats["unified_return_status"] == "SOLVER_RET_LIMITED":
            exhausted = stats["iter_count"] >= self.max_iterations
            return Status.ITERATION_LIMIT if exhausted else Status.TIME_LIMIT
        return super()._status(words, stats)
