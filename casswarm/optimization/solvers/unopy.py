"""Uno through its own Python package, which is optional: faster calls, and more methods."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import AbstractContextManager
from dataclasses import dataclass
from importlib.util import find_spec
from typing import Any, ClassVar, Literal

import numpy as np

from ..._util.silence import silence
from ...typing import FloatArray
from ..problem import Instances, Nlp
from ..solution import Status
from .base import Answer, Capabilities
from .callbacks import Callbacks, CallbackSolver
from .options import Positive, PositiveInt

_MISSING = "the package unopy is not installed: pip install 'casswarm[unopy]'"

INTERRUPTED = "USER_INTERRUPTION"
"""The name of Uno's status after Ctrl-C, which it handles itself."""


@dataclass(frozen=True)
class Unopy(CallbackSolver):
    """Uno (Vanaret, Leyffer, arXiv:2406.13454), called without CasADi's interface.

    Needs the package ``unopy``: ``pip install 'casswarm[unopy]'``.

    Parameters
    ----------
    preset : {"filtersqp", "ipopt"}
        Trust-region filter SQP as in `Uno`, or a filter line search with an interior point.
    tolerance : float
        Uno's ``primal_tolerance`` and ``dual_tolerance``; the latter is scaled by multipliers.
    max_iter : int
    time_limit : float
        CPU time of one solve, in seconds.
    """

    preset: Literal["filtersqp", "ipopt"] = "filtersqp"
    tolerance: Positive = 1e-7
    max_iter: PositiveInt = 500
    time_limit: Positive = 60.0

    name: ClassVar[str] = "unopy"
    summary: ClassVar[str] = "Uno without CasADi's interface, exact derivatives; any problem"
    capabilities: ClassVar[Capabilities] = Capabilities(multipliers=True, time_limit=True)
    # of the point where it ends with success; small steps and Fritz John points are failures
    statuses: ClassVar[dict[str, Status]] = {
        "FEASIBLE_KKT_POINT": Status.SOLVED,
        "INFEASIBLE_STATIONARY_POINT": Status.INFEASIBLE,
        "UNBOUNDED_OBJECTIVE": Status.DIVERGED,
        "DIVERGING_ITERATE": Status.DIVERGED,
    }
    # of the method, where it does not end with success
    limits: ClassVar[dict[str, Status]] = {
        "ITERATION_LIMIT": Status.ITERATION_LIMIT,
        "TIME_LIMIT": Status.TIME_LIMIT,
    }

    @classmethod
    def unavailable(cls) -> str:
        """Why the package cannot be used in this installation; empty if it can."""
        return "" if find_spec("unopy") else _MISSING

    def quiet(self) -> AbstractContextManager[None]:
        """See `CallbackSolver.quiet`."""
        return silence()  # it warns of rows without bounds on stdout

    def optimize(self, nlp: Nlp, instance: Instances) -> Any:
        """See `CallbackSolver.optimize`."""
        from unopy import UnoSolver  # optional

        solver = UnoSolver()
        solver.set_preset(self.preset)
        for option, setting in self._options().items():
            solver.set_option(option, setting)
        return solver.optimize(_model(nlp, instance))

    def answer(self, result: Any, instance: Instances) -> Answer:
        """See `CallbackSolver.answer`."""
        end, point = result.optimization_status.name, result.solution_status.name
        if end == INTERRUPTED:
            raise KeyboardInterrupt
        length, value = instance.scale[0]
        bounds = np.add(result.lower_bound_dual_solution, result.upper_bound_dual_solution)
        return Answer(
            x=length * np.array(result.primal_solution),
            status=self.status(end, point),
            message=point if end == "SUCCESS" else end,
            iterations=int(result.number_iterations),
            evaluations=int(result.number_objective_evaluations),
            seconds=0.0,
            multipliers=(
                value / length * bounds,
                value * np.array(result.constraint_dual_solution),
            ),
        )

    def status(self, end: str, point: str) -> Status:
        """Status by the names of Uno's optimization status and solution status."""
        known = self.statuses.get(point) if end == "SUCCESS" else self.limits.get(end)
        return known or Status.FAILED

    def _options(self) -> dict[str, Any]:
        return {
            "hessian_model": "exact",
            "logger": "SILENT",
            "primal_tolerance": float(self.tolerance),
            "dual_tolerance": float(self.tolerance),
            "max_iterations": self.max_iter,
            "time_limit": float(self.time_limit),
        }


def _model(nlp: Nlp, instance: Instances) -> Any:
    """Uno's model of an instance, in units of its scale."""
    import unopy

    (variables, _, rows), callbacks = nlp.sizes, Callbacks(nlp, instance)
    length = instance.scale[0, 0]
    jacobian, hessian = callbacks.jacobianstructure(), callbacks.hessianstructure()
    model = unopy.Model(unopy.PROBLEM_NONLINEAR, variables, unopy.ZERO_BASED_INDEXING)
    model.set_variables_lower_bounds(instance.lbx[0] / length)
    model.set_variables_upper_bounds(instance.ubx[0] / length)
    model.set_objective(unopy.MINIMIZE, callbacks.objective, _into(callbacks.gradient))
    if rows:
        bounds = instance.lbg[0], instance.ubg[0]
        entries = len(jacobian[0]), *jacobian, _into(callbacks.jacobian)
        model.set_constraints(rows, _into(callbacks.constraints), *bounds, *entries)

    def lagrangian(x: FloatArray, lam_f: float, lam_g: FloatArray, out: FloatArray) -> None:
        out[:] = callbacks.hessian(x, lam_g, lam_f)

    triangle = len(hessian[0]), unopy.LOWER_TRIANGLE, *hessian
    model.set_lagrangian_hessian(*triangle, lagrangian)
    model.set_lagrangian_sign_convention(unopy.MULTIPLIER_POSITIVE)
    model.set_initial_primal_iterate(instance.x0[0] / length)
    return model


def _into(function: Callable[[FloatArray], FloatArray]) -> Callable[[FloatArray, FloatArray], None]:
    """The function that writes its values into its second argument."""

    def write(x: FloatArray, out: FloatArray) -> None:
        out[:] = function(x)

    return write
