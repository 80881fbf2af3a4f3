"""alpaqa, through CasADi: augmented Lagrangian around a proximal quasi-Newton method."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

from ..solution import Status
from .base import Capabilities, require
from .casadi_nlpsol import NlpsolSolver

LIMITED = "SOLVER_RET_LIMITED"
STATUS = {"SOLVER_RET_SUCCESS": Status.SOLVED, LIMITED: Status.ITERATION_LIMIT}
"""The plugin has no words of its own and sets only CasADi's unified_return_status."""


@dataclass(frozen=True)
class Alpaqa(NlpsolSolver):
    """ALM and PANOC with L-BFGS (Pas, Schuurmans, Patrinos, ECC 2022); first derivatives only.

    The plugin does not tell its iterations, which are counted as zero; its evaluations are those of
    the augmented Lagrangian.

    Parameters
    ----------
    tolerance : float
        Of stationarity and of the constraints.
    max_outer : int
        Updates of the multipliers.
    max_inner : int
        PANOC iterations between them.
    max_seconds : float
        Wall time of one solve.
    """

    tolerance: float = 1e-8
    max_outer: int = 100
    max_inner: int = 1000
    max_seconds: float = 60.0

    name: ClassVar[str] = "alpaqa"
    summary: ClassVar[str] = "augmented Lagrangian with PANOC, first derivatives; any problem"
    capabilities: ClassVar[Capabilities] = Capabilities(multipliers=True, time_limit=True)
    plugin: ClassVar[str] = "alpaqa"
    statuses: ClassVar[dict[str, Status]] = STATUS

    def __post_init__(self) -> None:
        require(self, "tolerance", self.tolerance > 0, "above zero")
        require(self, "max_outer", self.max_outer >= 1, "whole numbers from 1")
        require(self, "max_inner", self.max_inner >= 1, "whole numbers from 1")
        require(self, "max_seconds", self.max_seconds > 0, "above zero")

    def _options(self) -> dict[str, Any]:
        return {
            "alpaqa": {
                "alm.tolerance": self.tolerance,
                "alm.dual_tolerance": self.tolerance,
                "alm.max_iter": self.max_outer,
                "panoc.max_iter": self.max_inner,
                "alm.max_time": self.max_seconds,
            }
        }

    def _status(self, words: str, stats: Mapping[str, Any]) -> Status:
        if words == LIMITED and stats["t_wall_total"] >= self.max_seconds:  # it does not tell
            return Status.TIME_LIMIT
        return super()._status(words, stats)

    @staticmethod
    def _words(stats: Mapping[str, Any]) -> str:
        return str(stats["unified_return_status"])

    @staticmethod
    def _evaluations(stats: Mapping[str, Any]) -> int:
        return sum(int(stats.get(f"n_call_{name}", 0)) for name in ("nlp_psi", "nlp_grad_psi"))
