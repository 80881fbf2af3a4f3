"""alpaqa, through CasADi: augmented Lagrangian around a proximal quasi-Newton method."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

from ..solution import Status
from .base import Capabilities
from .casadi_nlpsol import NlpsolSolver
from .options import Positive, PositiveInt


@dataclass(frozen=True)
class Alpaqa(NlpsolSolver):
    """ALM and PANOC with L-BFGS (Pas, Schuurmans, Patrinos, ECC 2022); first derivatives only.

    The plugin does not report its iterations, which are counted as zero; its evaluations are those
    of the augmented Lagrangian.

    Parameters
    ----------
    tolerance : float
        On stationarity and on the constraints.
    max_iter : int
        Updates of the multipliers.
    max_inner_iter : int
        PANOC iterations between two updates.
    time_limit : float
        Wall time of one solve, in seconds.
    """

    tolerance: Positive = 1e-8
    max_iter: PositiveInt = 100
    max_inner_iter: PositiveInt = 1000
    time_limit: Positive = 60.0

    name: ClassVar[str] = "alpaqa"
    summary: ClassVar[str] = "augmented Lagrangian with PANOC, first derivatives; any problem"
    capabilities: ClassVar[Capabilities] = Capabilities(multipliers=True, time_limit=True)
    plugin: ClassVar[str] = "alpaqa"
    counts: ClassVar[tuple[str, ...]] = ("nlp_psi", "nlp_grad_psi")
    # the plugin sets no return_status
    statuses: ClassVar[dict[str, Status]] = {"SOLVER_RET_SUCCESS": Status.SOLVED}

    def plugin_options(self) -> dict[str, Any]:
        """See `NlpsolSolver.plugin_options`."""
        return {
            "alpaqa": {
                "alm.tolerance": self.tolerance,
                "alm.dual_tolerance": self.tolerance,
                "alm.max_iter": self.max_iter,
                "panoc.max_iter": self.max_inner_iter,
                "alm.max_time": self.time_limit,
            }
        }
