"""Solvers of other packages, POUNCE and Uno, which call functions and sparse derivatives."""

from __future__ import annotations

import os
import time
from abc import abstractmethod
from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass, replace
from importlib.metadata import PackageNotFoundError, version
from importlib.util import find_spec
from typing import Any, ClassVar, Literal, NamedTuple

import casadi as ca
import numpy as np

from .._util.interrupts import interruptible
from .._util.silence import silence
from .._util.threads import locked_cache, one_at_a_time
from ..errors import SolverError
from ..nlp.program import Instances, LagrangianHessian, Nlp
from ..nlp.solution import Status
from ..typing import Expr, FloatArray, IntArray
from .base import Answer, Capabilities, NonNegativeInt, Positive, PositiveInt, Solver, error_text
from .casadi_plugins import Ipopt


class CallbackSolver(Solver):
    """A solver of an optional package, which takes one problem at a time, as `Callbacks`."""

    def prepare(self, nlp: Nlp) -> None:
        """See `Solver.prepare`."""
        reason = self.unavailable()
        if reason:
            raise SolverError(f"{self.name} cannot run here: {reason}")
        derivatives(nlp)

    def run(self, nlp: Nlp, instances: Instances) -> Sequence[Answer]:
        """See `Solver.run`."""
        return [self._answer(nlp, instances[i : i + 1]) for i in range(len(instances))]

    @one_at_a_time
    def _answer(self, nlp: Nlp, instance: Instances) -> Answer:
        started = time.perf_counter()
        try:
            with interruptible(), self.quiet():
                result = self.optimize(nlp, instance)
        except (ValueError, RuntimeError, TypeError) as error:  # such as bounds that cross
            answer = Answer(instance.x0[0], Status.FAILED, error_text(error), 0, 0, 0.0)
        else:
            answer = self.answer(result, instance)
        return replace(answer, seconds=time.perf_counter() - started)

    def quiet(self) -> AbstractContextManager[None]:
        """Context in which the package prints nothing."""
        return nullcontext()

    @abstractmethod
    def optimize(self, nlp: Nlp, instance: Instances) -> Any:
        """What the package returns on an instance, in units of its scale.

        ValueError, RuntimeError and TypeError become the message of a failed answer.
        """

    @abstractmethod
    def answer(self, result: Any, instance: Instances) -> Answer:
        """The answer in a result; its seconds are replaced."""


class Derivatives(NamedTuple):
    """CasADi Functions of (x, p, scale), in units of `Instances.scale`, and their nonzeros' places.

    The Hessian of the Lagrangian, a function also of the multipliers of f and g, is its upper
    triangle by columns: the lower one by rows.
    """

    values: Expr
    gradient: Expr
    jacobian: Expr
    hessian: Expr
    jacobian_entries: tuple[IntArray, IntArray]
    hessian_entries: tuple[IntArray, IntArray]


@locked_cache(maxsize=64)
def derivatives(nlp: Nlp) -> Derivatives:
    """Functions and derivatives of a program, built once."""
    x, scale = ca.MX.sym("x", nlp.sizes[0]), ca.MX.sym("scale", 2)
    given, (length, value) = ca.vertcat(nlp.p, scale), ca.vertsplit(scale)
    f, g = nlp.evaluate.call([length * x, nlp.p], True, False)
    lam_f, lam_g = ca.MX.sym("lam_f"), ca.MX.sym("lam_g", nlp.sizes[2])
    own = nlp.attached(LagrangianHessian)
    if own is None:
        upper = ca.triu(ca.hessian(lam_f * f / value + ca.dot(lam_g, g), x)[0])
    else:
        upper = length**2 * own(length * x, nlp.p, lam_f / value, lam_g)
    gradient, jacobian = ca.gradient(f / value, x), ca.jacobian(g, x)

    def function(outputs: list[Expr], *more: Expr) -> Expr:
        made = ca.Function("derivatives", [x, given, *more], outputs)
        return made.expand() if nlp.unroll else made

    return Derivatives(
        function([f / value, g]),
        function([ca.densify(gradient)]),
        function([jacobian]),
        function([upper], lam_f, lam_g),
        _entries(jacobian),
        _entries(upper)[::-1],  # of the lower triangle
    )


def _entries(matrix: Expr) -> tuple[IntArray, IntArray]:
    """Rows and columns of a matrix's nonzeros, in CasADi's order."""
    rows, columns = matrix.sparsity().get_triplet()
    return np.array(rows, dtype=np.int64), np.array(columns, dtype=np.int64)


class Callbacks:
    """The functions of a single instance, with the names that cyipopt gave them."""

    def __init__(self, nlp: Nlp, instance: Instances) -> None:
        self._functions = derivatives(nlp)
        self._p = np.append(instance.p[0], instance.scale[0])

    def objective(self, x: FloatArray) -> float:
        """Value of f."""
        return float(self._functions.values(x, self._p)[0])

    def constraints(self, x: FloatArray) -> FloatArray:
        """Values of g, (ng,)."""
        return _array(self._functions.values(x, self._p)[1])

    def gradient(self, x: FloatArray) -> FloatArray:
        """Gradient of f, (nx,)."""
        return _array(self._functions.gradient(x, self._p))

    def jacobianstructure(self) -> tuple[IntArray, IntArray]:
        """Rows and columns of the entries of `jacobian`."""
        return self._functions.jacobian_entries

    def jacobian(self, x: FloatArray) -> FloatArray:
        """Nonzeros of the Jacobian of g."""
        return _array(self._functions.jacobian(x, self._p).nz[:])

    def hessianstructure(self) -> tuple[IntArray, IntArray]:
        """Rows and columns of the entries of `hessian`, in the lower triangle."""
        return self._functions.hessian_entries

    def hessian(self, x: FloatArray, lam_g: FloatArray, lam_f: float) -> FloatArray:
        """Nonzeros of the Hessian of lam_f f + lam_g g."""
        return _array(self._functions.hessian(x, self._p, lam_f, lam_g).nz[:])


def _array(values: Any) -> FloatArray:
    return np.asarray(values, dtype=float).ravel()


_NO_POUNCE = "the package pounce-solver is not installed: pip install 'casswarm[pounce]'"


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

    name: ClassVar[str] = "pounce"
    summary: ClassVar[str] = "interior point in Rust, exact derivatives; any problem"
    capabilities: ClassVar[Capabilities] = Capabilities(multipliers=True, time_limit=True)
    # its messages are Ipopt's; others are failures: small steps, failed restoration, and errors
    statuses: ClassVar[dict[str, Status]] = Ipopt.statuses

    @classmethod
    def unavailable(cls) -> str:
        """Why the package cannot be used in this installation; empty if it can."""
        try:
            version("pounce-solver")  # another package has a module of the same name
        except PackageNotFoundError:
            return _NO_POUNCE
        return ""

    def warm(self) -> Pounce:
        """With a small initial barrier parameter, which keeps it near its initial guess."""
        return self if self.mu_init is not None else replace(self, mu_init=1e-4)

    def optimize(self, nlp: Nlp, instance: Instances) -> Any:
        """See `CallbackSolver.optimize`."""
        length = instance.scale[0, 0]
        problem = _package().Problem(
            n=nlp.sizes[0],
            m=nlp.sizes[2],
            problem_obj=Callbacks(nlp, instance),
            lb=instance.lbx[0] / length,
            ub=instance.ubx[0] / length,
            cl=instance.lbg[0],
            cu=instance.ubg[0],
        )
        for option, setting in self._options().items():
            problem.add_option(option, setting)
        return problem.solve(instance.x0[0] / length)

    def answer(self, result: Any, instance: Instances) -> Answer:
        """See `CallbackSolver.answer`."""
        (x, info), (length, value) = result, instance.scale[0]
        message = str(info["status_msg"])
        return Answer(
            x=length * x,
            status=self.statuses.get(message, Status.FAILED),
            message=message,
            iterations=int(info["iter_count"]),
            evaluations=int(info["n_obj_evals"]),
            seconds=0.0,
            multipliers=(
                value / length * (info["mult_x_U"] - info["mult_x_L"]),
                value * info["mult_g"],
            ),
        )

    def _options(self) -> dict[str, Any]:
        barrier = {} if self.mu_init is None else {"mu_init": float(self.mu_init)}
        return {
            **barrier,
            "tol": float(self.tolerance),
            "constr_viol_tol": float(self.tolerance),
            "max_iter": self.max_iter,
            "max_wall_time": float(self.time_limit),
            "bound_relax_factor": 0.0,  # or rows are violated by 1e-8 of their bounds
            "honor_original_bounds": "yes",
            "print_level": 0,
        }


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


_NO_UNOPY = "the package unopy is not installed: pip install 'casswarm[unopy]'"

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
        return "" if find_spec("unopy") else _NO_UNOPY

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
