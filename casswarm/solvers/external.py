"""Solvers of other packages, POUNCE and Uno, which call functions and sparse derivatives."""

from __future__ import annotations

import os
import time
from abc import abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from importlib.metadata import PackageNotFoundError, version
from typing import Any, ClassVar, Literal

import numpy as np
from typing_extensions import override

from .._util.interrupts import interruptible, restore_sigint_handler
from .._util.silence import silence
from .._util.threads import locked_cache, one_at_a_time
from ..errors import SolverError
from ..nlp.program import Instances, Nlp
from ..nlp.solution import Status
from ..typing import Expr, FloatArray, IntArray
from .base import (
    Answer,
    NonNegativeInt,
    Positive,
    PositiveInt,
    Solver,
    described,
    error_text,
    settings,
)
from .casadi_plugins import Ipopt


class CallbackSolver(Solver):
    """A solver of an optional package that calls `InstanceFunctions`, of one problem at a time."""

    package: ClassVar[str]
    statuses: ClassVar[Mapping[str, Status]]

    @classmethod
    @override
    def unavailable(cls) -> str:
        try:
            version(cls.package)  # another package may have a module of the same name
        except PackageNotFoundError:
            install = f"pip install 'casswarm[{cls.name}]'"
            return f"the package {cls.package} is not installed: {install}"
        return ""

    @override
    def prepare(self, nlp: Nlp) -> None:
        reason = self.unavailable()
        if reason:
            raise SolverError(f"{self.name} cannot run here: {reason}", solver=self.name)
        _ = nlp.evaluate, nlp.gradient, nlp.jacobian, nlp.lagrangian_hessian

    @override
    def run(self, nlp: Nlp, instances: Instances) -> Sequence[Answer]:
        return [self._answer(nlp, instances[i : i + 1]) for i in range(len(instances))]

    @one_at_a_time
    def _answer(self, nlp: Nlp, instance: Instances) -> Answer:
        started = time.perf_counter()
        try:
            with interruptible():
                result = self.optimize(InstanceFunctions(nlp, instance))
        except (ValueError, RuntimeError, TypeError) as error:  # such as bounds that cross
            answer = Answer(instance.x0[0], Status.FAILED, error_text(error), 0, 0, 0.0)
        else:
            answer = self.answer(result).in_units(*instance.scale[0])
        return replace(answer, seconds=time.perf_counter() - started)

    @abstractmethod
    def optimize(self, functions: InstanceFunctions) -> Any:
        """Solve an instance with the package; return its result, in units of the instance's scale.

        ValueError, RuntimeError and TypeError become the message of a failed answer.
        """

    @abstractmethod
    def answer(self, result: Any) -> Answer:
        """The answer in a result, in units of its scale; its seconds are replaced."""


class InstanceFunctions:
    """The functions of a single instance in units of its scale, with the names of cyipopt.

    f and g are evaluated together, once at a point.
    """

    def __init__(self, nlp: Nlp, instance: Instances) -> None:
        self.nlp, self.instance, self.p = nlp, instance, instance.p[0]
        self.length, self.value = map(float, instance.scale[0])
        self.x0, self.lower, self.upper = (
            part[0] / self.length for part in (instance.x0, instance.lbx, instance.ubx)
        )
        self.last, self.evaluations = self.x0, 0
        self._values: Any = None

    def objective(self, x: FloatArray) -> float:
        """Value of f."""
        return float(self._evaluate(x)[0]) / self.value

    def constraints(self, x: FloatArray) -> FloatArray:
        """Values of g, (ng,)."""
        return _array(self._evaluate(x)[1])

    def gradient(self, x: FloatArray) -> FloatArray:
        """Gradient of f, (nx,)."""
        return self.length / self.value * _array(self.nlp.gradient(self.length * x, self.p)[1])

    def jacobianstructure(self) -> tuple[IntArray, IntArray]:
        """Rows and columns of the entries of `jacobian`."""
        return _entries(self.nlp.jacobian)

    def jacobian(self, x: FloatArray) -> FloatArray:
        """Nonzeros of the Jacobian of g."""
        return self.length * _array(self.nlp.jacobian(self.length * x, self.p).nz[:])

    def hessianstructure(self) -> tuple[IntArray, IntArray]:
        """Rows and columns of the entries of `hessian`, in the lower triangle."""
        rows, columns = _entries(self.nlp.lagrangian_hessian)  # upper by columns, lower by rows
        return columns, rows

    def hessian(self, x: FloatArray, lam_g: FloatArray, lam_f: float) -> FloatArray:
        """Nonzeros of the Hessian of lam_f f + lam_g g."""
        arguments = self.length * x, self.p, lam_f / self.value, lam_g
        return self.length**2 * _array(self.nlp.lagrangian_hessian(*arguments).nz[:])

    def _evaluate(self, x: FloatArray) -> Any:
        if self._values is None or not np.array_equal(x, self.last):
            self.evaluations += 1
            self.last = np.array(x)
            self._values = self.nlp.evaluate(self.length * x, self.p)
        return self._values


def _entries(function: Expr) -> tuple[IntArray, IntArray]:
    """Rows and columns of the nonzeros of a function's result, in CasADi's order."""
    rows, columns = function.sparsity_out(0).get_triplet()
    return np.array(rows, dtype=np.int64), np.array(columns, dtype=np.int64)


def _array(values: Any) -> FloatArray:
    return np.asarray(values, dtype=float).ravel()


@described
@dataclass(frozen=True)
class Pounce(CallbackSolver):
    """POUNCE (J. Kitchin, from version 0.13), derived from Ipopt, with exact derivatives.

    Needs the package ``pounce-solver``: ``pip install 'casswarm[pounce]'``.

    Parameters
    ----------
    tolerance : float
        Its options ``tol`` and ``constr_viol_tol``.
    max_iter : int
    time_limit : float
        Wall time of one solve, in seconds.
    mu_init : float, optional
        Initial barrier parameter, 0.1 by default: a smaller one stays nearer to a good guess.
    """

    tolerance: Positive = 1e-8
    max_iter: NonNegativeInt = 500
    time_limit: Positive = 60.0
    mu_init: Positive | None = None

    statuses: ClassVar[Mapping[str, Status]] = Ipopt.statuses

    @override
    def warm(self) -> Pounce:
        """With a small initial barrier parameter, which keeps it near its initial guess."""
        return self if self.mu_init is not None else replace(self, mu_init=1e-4)

    @override
    def optimize(self, functions: InstanceFunctions) -> Any:
        problem = _package().Problem(
            n=functions.nlp.sizes[0],
            m=functions.nlp.sizes[2],
            problem_obj=functions,
            lb=functions.lower,
            ub=functions.upper,
            cl=functions.instance.lbg[0],
            cu=functions.instance.ubg[0],
        )
        for option, setting in settings(self).items():
            problem.add_option(option, setting)
        return problem.solve(functions.x0)

    @override
    def answer(self, result: Any) -> Answer:
        x, info = result
        message = str(info["status_msg"])
        counts = int(info["iter_count"]), int(info["n_obj_evals"])
        multipliers = info["mult_x_U"] - info["mult_x_L"], info["mult_g"]
        status = self.statuses.get(message, Status.FAILED)
        return Answer(x, status, message, *counts, 0.0, multipliers)


@locked_cache(maxsize=1)
def _package() -> Any:
    """The package, imported so that it does not write its log to standard error."""
    before = os.environ.get("RUST_LOG")
    os.environ.setdefault("RUST_LOG", "off")  # read once, by the import
    try:
        import pounce  # slow to import, and optional
    finally:
        if before is None:
            del os.environ["RUST_LOG"]
    return pounce


INTERRUPTED = "USER_INTERRUPTION"
"""The name of Uno's status after Ctrl-C, which it handles itself."""


@described
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

    limits: ClassVar[Mapping[str, Status]]

    @override
    def optimize(self, functions: InstanceFunctions) -> Any:
        from unopy import UnoSolver  # optional

        solver = UnoSolver()
        solver.set_preset(self.preset)
        for option, setting in settings(self).items():
            solver.set_option(option, setting)
        with silence():  # it warns of rows without bounds on stdout
            return solver.optimize(_model(functions))

    @override
    def answer(self, result: Any) -> Answer:
        end, point = result.optimization_status.name, result.solution_status.name
        if end == INTERRUPTED:
            raise KeyboardInterrupt
        bounds = np.add(result.lower_bound_dual_solution, result.upper_bound_dual_solution)
        return Answer(
            np.array(result.primal_solution),
            self.status(end, point),
            message=point if end == "SUCCESS" else end,
            iterations=int(result.number_iterations),
            evaluations=int(result.number_objective_evaluations),
            seconds=0.0,
            multipliers=(bounds, np.array(result.constraint_dual_solution)),
        )

    def status(self, end: str, point: str) -> Status:
        """Status by the names of Uno's optimization status and solution status."""
        known = self.statuses.get(point) if end == "SUCCESS" else self.limits.get(end)
        return known or Status.FAILED


def _model(callbacks: InstanceFunctions) -> Any:
    """Uno's model of an instance, in units of its scale."""
    import unopy

    (variables, _, rows), instance = callbacks.nlp.sizes, callbacks.instance
    jacobian, hessian = callbacks.jacobianstructure(), callbacks.hessianstructure()

    def objective(x: FloatArray) -> float:
        restore_sigint_handler()  # Uno's own handler of Ctrl-C is not looked at after its last step
        return callbacks.objective(x)

    model = unopy.Model(unopy.PROBLEM_NONLINEAR, variables, unopy.ZERO_BASED_INDEXING)
    model.set_variables_lower_bounds(callbacks.lower)
    model.set_variables_upper_bounds(callbacks.upper)
    model.set_objective(unopy.MINIMIZE, objective, _into(callbacks.gradient))
    if rows:
        bounds = instance.lbg[0], instance.ubg[0]
        entries = len(jacobian[0]), *jacobian, _into(callbacks.jacobian)
        model.set_constraints(rows, _into(callbacks.constraints), *bounds, *entries)

    def lagrangian(x: FloatArray, lam_f: float, lam_g: FloatArray, out: FloatArray) -> None:
        out[:] = callbacks.hessian(x, lam_g, lam_f)

    triangle = len(hessian[0]), unopy.LOWER_TRIANGLE, *hessian
    model.set_lagrangian_hessian(*triangle, lagrangian)
    model.set_lagrangian_sign_convention(unopy.MULTIPLIER_POSITIVE)
    model.set_initial_primal_iterate(callbacks.x0)
    return model


def _into(function: Callable[[FloatArray], FloatArray]) -> Callable[[FloatArray, FloatArray], None]:
    """The function that writes its values into its second argument."""

    def write(x: FloatArray, out: FloatArray) -> None:
        out[:] = function(x)

    return write
