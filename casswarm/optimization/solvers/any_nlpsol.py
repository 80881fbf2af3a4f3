"""Any plugin of CasADi's nlpsol, by its name and its options."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, ClassVar

from ..solution import Status
from .base import Capabilities
from .casadi_nlpsol import NlpsolSolver

_UNIFIED = {
    "SOLVER_RET_SUCCESS": Status.SOLVED,
    "SOLVER_RET_INFEASIBLE": Status.INFEASIBLE,
    "SOLVER_RET_LIMITED": Status.ITERATION_LIMIT,
}
"""Status by CasADi's own word for it, which does not tell the limit that was reached."""


@dataclass(frozen=True, eq=False)
class NlpSol(NlpsolSolver):
    """A plugin of `casadi.nlpsol` with the options that it takes there.

    For plugins that need a licence or a library of their own, and for those that casswarm has no
    class for. A success is what CasADi calls one, so that limits that the plugin confuses with
    successes are counted as such, unless the recomputed residuals contradict.

    Parameters
    ----------
    plugin : str
        Such as madnlp, knitro or snopt.
    options : mapping
        The plugin's options, such as ``{"madnlp": {"tol": 1e-8}}``.

    Examples
    --------
    >>> import casswarm as csw
    >>> csw.solvers.NlpSol("sqpmethod", {"qpsol": "qrqp", "max_iter": 50}).name
    'sqpmethod'
    """

    plugin: str  # type: ignore[misc]
    options: Mapping[str, Any] = field(default_factory=dict)

    summary: ClassVar[str] = "a plugin of CasADi's nlpsol by name; any problem"
    capabilities: ClassVar[Capabilities] = Capabilities(multipliers=True)
    prints_to_stdout: ClassVar[bool] = True  # many do unless told otherwise
    statuses: ClassVar[dict[str, Status]] = {}

    @property
    def name(self) -> str:  # type: ignore[override]
        """The plugin's name."""
        return self.plugin

    def plugin_options(self) -> dict[str, Any]:
        """See `NlpsolSolver.plugin_options`."""
        return dict(self.options)

    def status(self, stats: Mapping[str, Any]) -> Status:
        """See `NlpsolSolver.status`."""
        return _UNIFIED.get(str(stats["unified_return_status"]), Status.FAILED)
