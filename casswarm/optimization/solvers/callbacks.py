"""Solvers of other packages, which call a program's functions and sparse derivatives."""

from __future__ import annotations

import time
from abc import abstractmethod
from collections.abc import Sequence
from contextlib import AbstractContextManager, nullcontext
from dataclasses import replace
from typing import Any, NamedTuple

import casadi as ca
import numpy as np

from ..._util.interrupts import interruptible
from ..._util.threads import locked_cache, one_at_a_time
from ...errors import SolverError
from ...typing import Expr, FloatArray, IntArray
from ..problem import Instances, Nlp
from ..solution import Status
from .base import Answer, Solver, error_text


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
    if nlp.hessian is None:
        upper = ca.triu(ca.hessian(lam_f * f / value + ca.dot(lam_g, g), x)[0])
    else:
        upper = length**2 * nlp.hessian(length * x, nlp.p, lam_f / value, lam_g)
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
