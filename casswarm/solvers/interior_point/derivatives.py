"""Evaluation of programs for the method: values, derivatives and condensed matrices, as arrays.

Arrays have instances last, (k, b), so that the engine's loops do an operation for many of them.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple, Protocol

import casadi as ca
import numpy as np
from typing_extensions import override

from ..._util.threads import locked_cache
from ...compiled.kernels import contiguous
from ...nlp.program import LagrangianHessian, Nlp
from ...typing import Expr, FloatArray, IntArray
from .factors import DenseFactors, Factors, SparseFactors, SparseSystem, shifts_to_try
from .iterate_kernels import LANES
from .system_kernels import times
from .tape import MAX_OPERATIONS, Calls, Tape, scalar

_FEW = 300  # variables


class Condensation(NamedTuple):
    """Terms of condensed matrices H + diag(w) + J' diag(v) J.

    H are the Hessians of objective f + multipliers' g, for multipliers (ng, b) and an objective's
    weight, or (b,) of them; `weights` (nx + ng, b) are w and v.
    """

    multipliers: FloatArray
    weights: FloatArray
    objective: FloatArray | float = 1.0


class Linearisation(Protocol):
    """Derivatives of b instances at their points: g has the Jacobian J."""

    gradient: FloatArray
    """Of f, (nx, b)."""

    def times(self, vectors: FloatArray) -> FloatArray:
        """J v, (ng, b), of vectors v (nx, b)."""

    def transposed_times(self, vectors: FloatArray) -> FloatArray:
        """J' w, (nx, b), of vectors w (ng, b)."""

    def row_sizes(self) -> FloatArray:
        """Largest absolute entries (ng, b) of the rows of J."""

    def factors(self, terms: Condensation, last: FloatArray) -> Factors:
        """Factors of condensed matrices; `last` (b,) are the shifts that were last needed."""


class Problems(Protocol):
    """Instances of a program as functions of arrays; `rows` (b,) selects some of them.

    Up to `lanes` points are evaluated in the time of a single one.
    """

    lanes: int = 1

    def evaluate(self, rows: IntArray, x: FloatArray) -> tuple[FloatArray, FloatArray]:
        """f (b,) and g (ng, b) at x (nx, b)."""

    def linearise(self, rows: IntArray, x: FloatArray) -> Linearisation:
        """Derivatives at x (nx, b)."""


@dataclass(frozen=True, eq=False)
class NumericDerivatives:
    """Faster derivatives of a program than those of CasADi's functions, attached to it.

    Parameters
    ----------
    problems : callable
        Parameters (B, np) to the instances.
    """

    problems: Callable[[FloatArray], Problems]


@dataclass(frozen=True, eq=False)
class Functions:
    """A program's functions of stacked arguments, for which instances are last.

    Parameters
    ----------
    values : Tape or Calls
        (x, p) to f and g.
    first : Tape or Calls
        (x, p) to the gradient of f and the entries of J.
    hessian : Tape or Calls
        (x, p, weights of f and g) to the entries of the Lagrangian's Hessian, its upper triangle.
    system : SparseSystem, optional
        Of the condensed matrices; None if dense ones are better.
    """

    values: Tape | Calls
    first: Tape | Calls
    hessian: Tape | Calls
    system: SparseSystem | None

    @classmethod
    def of(cls, nlp: Nlp) -> Functions:
        """Tapes, or CasADi's functions where operations are not scalar, or too many."""
        try:
            return cls._tapes(nlp)
        except NotImplementedError:
            return cls.calls(nlp)

    @classmethod
    def _tapes(cls, nlp: Nlp) -> Functions:
        x, p, lam_f, lam_g = (ca.SX.sym("v", size) for size in (*nlp.sizes[:2], 1, nlp.sizes[2]))
        f, g = scalar(nlp.evaluate)(x, p)
        lagrangian, weights = lam_f * f + ca.dot(lam_g, g), ca.vertcat(lam_f, lam_g)
        _require_small([x, p, lam_f, lam_g], ca.gradient(lagrangian, x))
        own = nlp.attached(LagrangianHessian)
        if own is None:
            upper = ca.triu(ca.hessian(lagrangian, x)[0])
        else:
            upper = scalar(own.function)(x, p, lam_f, lam_g)
        values = Tape.of([x, p], [ca.densify(f), ca.densify(g)])
        first = Tape.of([x, p], [ca.densify(ca.gradient(f, x)), ca.jacobian(g, x)])
        hessian = Tape.of([x, p, weights], [upper])
        system = SparseSystem.of(nlp.sizes[0], hessian.patterns[0], first.patterns[1])
        return cls(values, first, hessian, system)

    @classmethod
    def calls(cls, nlp: Nlp) -> Functions:
        """CasADi's functions."""
        x, p = (ca.MX.sym("v", size) for size in nlp.sizes[:2])
        weights = ca.MX.sym("weights", 1 + nlp.sizes[2])
        values = [ca.densify(each) for each in nlp.evaluate(x, p)]
        first = [ca.densify(nlp.gradient(x, p)[1]), nlp.jacobian(x, p)]
        hessian = nlp.lagrangian_hessian(x, p, weights[0], weights[1:])
        derivatives = Calls.of([x, p], first), Calls.of([x, p, weights], [hessian])
        return cls(Calls.of([x, p], values), *derivatives, cls._system(nlp, *derivatives))

    @staticmethod
    def _system(nlp: Nlp, first: Calls, hessian: Calls) -> SparseSystem | None:
        """System of many variables; with few, LAPACK's factors of each instance are quick."""
        if nlp.sizes[0] <= _FEW:
            return None
        return SparseSystem.of(nlp.sizes[0], hessian.patterns[0], first.patterns[1])


def _require_small(arguments: list[Expr], gradient: Expr) -> None:
    """Raise NotImplementedError if the Jacobian of a gradient would have too many operations.

    It takes the gradient's operations for every group of columns without a common row.
    """
    groups = ca.jacobian_sparsity(gradient, arguments[0]).uni_coloring().size2()
    number = ca.Function("gradient", arguments, [gradient]).n_instructions() * groups
    if number > MAX_OPERATIONS:
        raise NotImplementedError(f"a Hessian of about {number} operations")


@locked_cache(maxsize=64)
def program_functions(nlp: Nlp) -> Functions:
    """Functions of a program."""
    return Functions.of(nlp)


def numeric_problems(nlp: Nlp, p: FloatArray) -> Problems:
    """Instances of a program: by its own compiled code, or by its functions."""
    numeric = nlp.attached(NumericDerivatives)
    if numeric is not None:
        return numeric.problems(p)
    return FunctionProblems(program_functions(nlp), p)


class FunctionProblems(Problems):
    """Instances of a program by its functions, for parameters p (B, np)."""

    def __init__(self, functions: Functions, p: FloatArray) -> None:
        self.functions, self.p = functions, contiguous(p.T)
        self.lanes = LANES if isinstance(functions.values, Tape) else 1

    @override
    def evaluate(self, rows: IntArray, x: FloatArray) -> tuple[FloatArray, FloatArray]:
        f, g = self.functions.values(x, self.p.take(rows, 1))
        return f[0], g

    @override
    def linearise(self, rows: IntArray, x: FloatArray) -> FunctionLinearisation:
        return FunctionLinearisation(self.functions, x, self.p.take(rows, 1))


class FunctionLinearisation(Linearisation):
    """Derivatives by the entries of J and of Hessians."""

    def __init__(self, functions: Functions, x: FloatArray, p: FloatArray) -> None:
        self._functions, self._at = functions, (x, p)
        self.gradient, self.entries = functions.first(x, p)

    @override
    def times(self, vectors: FloatArray) -> FloatArray:
        rows, columns = self._functions.first.patterns[1]
        return self._product(rows, columns, vectors, self._n_rows)

    @override
    def transposed_times(self, vectors: FloatArray) -> FloatArray:
        rows, columns = self._functions.first.patterns[1]
        return self._product(columns, rows, vectors, len(self.gradient))

    def _product(
        self, rows: IntArray, columns: IntArray, vectors: FloatArray, size: int
    ) -> FloatArray:
        out = np.empty((size, vectors.shape[1]))
        times(self.entries, rows, columns, vectors, out)
        return out

    @property
    def _n_rows(self) -> int:
        return int(self._functions.values.patterns[1].shape[1])

    @override
    def row_sizes(self) -> FloatArray:
        sizes = np.zeros((self._n_rows, self.gradient.shape[1]))
        np.maximum.at(sizes, self._functions.first.patterns[1][0], abs(self.entries))
        return sizes

    @override
    def factors(self, terms: Condensation, last: FloatArray) -> Factors:
        system, size = self._functions.system, len(self.gradient)
        if system is None:
            return DenseFactors(self.condensed(terms), shifts_to_try(last))
        of_x, of_g = terms.weights[:size], terms.weights[size:]
        return SparseFactors(system, (self._hessian(terms), self.entries, of_g, of_x), last)

    def condensed(self, terms: Condensation) -> FloatArray:
        """Condensed matrices, (b, nx, nx)."""
        size, batch = self.gradient.shape
        matrices, diagonal = np.zeros((batch, size, size)), np.arange(size)
        rows, columns = self._functions.hessian.patterns[0]
        matrices[:, rows, columns] = matrices[:, columns, rows] = self._hessian(terms).T
        matrices[:, diagonal, diagonal] += terms.weights[:size].T
        jacobian = np.zeros((batch, self._n_rows, size))
        jacobian[:, *self._functions.first.patterns[1]] = self.entries.T
        weighted = jacobian * terms.weights[size:].T[..., None]
        return np.asarray(matrices + weighted.swapaxes(1, 2) @ jacobian)

    def _hessian(self, terms: Condensation) -> FloatArray:
        multipliers, hessian = terms.multipliers, self._functions.hessian
        if not np.any(terms.objective) and not multipliers.any():
            return np.zeros((hessian.patterns[0].shape[1], multipliers.shape[1]))
        of_f = np.full((1, multipliers.shape[1]), terms.objective)
        return hessian(*self._at, np.vstack([of_f, multipliers]))[0]
