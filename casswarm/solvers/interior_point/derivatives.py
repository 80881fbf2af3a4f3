"""What the method reads of a program: values, derivatives and condensed matrices, as arrays.

The engine's arrays have instances last, (k, b), so that its loops do an operation for many of them.
Programs that are evaluated one by one, or by NumPy, have instances first: `RowProblems` is between.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

import casadi as ca
import numpy as np

from ..._util.threads import locked_cache
from ...compiled.kernels import contiguous
from ...nlp.program import LagrangianHessian, Nlp
from ...typing import Expr, FloatArray, IntArray
from .factors import DenseFactors, Factors, shifts_to_try


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

    def factors(
        self,
        multipliers: FloatArray,
        weights: FloatArray,
        last: FloatArray,
        objective: FloatArray | float = 1.0,
    ) -> Factors:
        """Factors of Hessians of objective f + multipliers' g, plus diag(w) + J' diag(v) J.

        `weights` (nx + ng, b) are w and v; `last` (b,) the shifts that were last needed;
        `objective` is a weight of f, or (b,).
        """


class Problems(Protocol):
    """Instances of a program as functions of arrays; `rows` (b,) selects some of them."""

    def evaluate(self, rows: IntArray, x: FloatArray) -> tuple[FloatArray, FloatArray]:
        """f (b,) and g (ng, b) at x (nx, b)."""

    def linearise(self, rows: IntArray, x: FloatArray) -> Linearisation:
        """Derivatives at x (nx, b)."""


class RowLinearisation(Protocol):
    """Derivatives of b instances, which are first in every array."""

    gradient: FloatArray
    """Of f, (b, nx)."""

    def times(self, vectors: FloatArray) -> FloatArray:
        """J v, (b, ng), of vectors v (b, nx)."""

    def transposed_times(self, vectors: FloatArray) -> FloatArray:
        """J' w, (b, nx), of vectors w (b, ng)."""

    def factors(
        self,
        multipliers: FloatArray,
        weights: FloatArray,
        shifts: FloatArray,
        objective: FloatArray | float = 1.0,
    ) -> Factors:
        """See `Linearisation`; multipliers (b, ng), weights (b, nx + ng). Solutions are (nx, b).

        `shifts` (b, m) are tried in order.
        """


class NumericProblems(Protocol):
    """Instances of a program, which are first in every array; `rows` (b,) selects some of them."""

    def evaluate(self, rows: IntArray, x: FloatArray) -> tuple[FloatArray, FloatArray]:
        """f (b,) and g (b, ng) at x (b, nx)."""

    def linearise(self, rows: IntArray, x: FloatArray) -> RowLinearisation:
        """Derivatives at x (b, nx)."""


@dataclass(frozen=True, eq=False)
class NumericDerivatives:
    """Faster derivatives of a program than those of CasADi's functions, attached to it.

    Parameters
    ----------
    problems : callable
        Parameters (B, np) to the instances.
    """

    problems: Callable[[FloatArray], NumericProblems]


class RowProblems:
    """`Problems` by those with instances first."""

    def __init__(self, rows_first: NumericProblems, n_rows: int) -> None:
        self._rows_first, self._n_rows = rows_first, n_rows

    def evaluate(self, rows: IntArray, x: FloatArray) -> tuple[FloatArray, FloatArray]:
        """See `Problems`."""
        f, g = self._rows_first.evaluate(rows, contiguous(x.T))
        return f, contiguous(g.T)

    def linearise(self, rows: IntArray, x: FloatArray) -> TransposedLinearisation:
        """See `Problems`."""
        at = self._rows_first.linearise(rows, contiguous(x.T))
        return TransposedLinearisation(at, self._n_rows)


class TransposedLinearisation:
    """`Linearisation` by one with instances first."""

    def __init__(self, rows_first: RowLinearisation, n_rows: int) -> None:
        self._rows_first, self._n_rows = rows_first, n_rows
        self.gradient = contiguous(rows_first.gradient.T)

    def times(self, vectors: FloatArray) -> FloatArray:
        """See `Linearisation`."""
        return contiguous(self._rows_first.times(contiguous(vectors.T)).T)

    def transposed_times(self, vectors: FloatArray) -> FloatArray:
        """See `Linearisation`."""
        return contiguous(self._rows_first.transposed_times(contiguous(vectors.T)).T)

    def row_sizes(self) -> FloatArray:
        """See `Linearisation`."""
        sizes = np.empty((self._n_rows, self.gradient.shape[1]))
        for row, units in zip(sizes, np.eye(self._n_rows), strict=True):
            vectors = np.tile(units, (sizes.shape[1], 1))
            row[:] = abs(self._rows_first.transposed_times(vectors)).max(axis=1, initial=0.0)
        return sizes

    def factors(
        self,
        multipliers: FloatArray,
        weights: FloatArray,
        last: FloatArray,
        objective: FloatArray | float = 1.0,
    ) -> Factors:
        """See `Linearisation`."""
        rows = contiguous(multipliers.T), contiguous(weights.T)
        return self._rows_first.factors(*rows, shifts_to_try(last), objective)


class CasadiProblems:
    """Instances of any program, by CasADi's functions.

    Parameters
    ----------
    nlp : Nlp
    p : (B, np)
    """

    def __init__(self, nlp: Nlp, p: FloatArray) -> None:
        self.nlp, self.p = nlp, p

    def evaluate(self, rows: IntArray, x: FloatArray) -> tuple[FloatArray, FloatArray]:
        """See `NumericProblems`."""
        f, g = self.call(self.nlp.evaluate, rows, x)
        return f[:, 0, 0], g[..., 0]

    def linearise(self, rows: IntArray, x: FloatArray) -> CasadiLinearisation:
        """See `NumericProblems`."""
        return CasadiLinearisation(self, rows, x)

    def call(
        self, function: Expr, rows: IntArray, x: FloatArray, *more: FloatArray
    ) -> list[FloatArray]:
        """Outputs (b, r, c) of a function of x, p and more arguments of every instance."""
        results = [
            function.call([point, self.p[row], *arguments])
            for row, point, *arguments in zip(rows, x, *more, strict=True)
        ]
        shapes = [(len(rows), *function.size_out(k)) for k in range(function.n_out())]
        return [
            np.array([result[k].full() for result in results]).reshape(shape)
            for k, shape in enumerate(shapes)
        ]


class CasadiLinearisation:
    """See `RowLinearisation`; condensed matrices are dense."""

    def __init__(self, problems: CasadiProblems, rows: IntArray, x: FloatArray) -> None:
        self._problems, self._rows, self._x = problems, rows, x
        nlp = problems.nlp
        self.gradient = problems.call(nlp.gradient, rows, x)[1][..., 0]
        self._jacobian = problems.call(nlp.jacobian, rows, x)[0]

    def times(self, vectors: FloatArray) -> FloatArray:
        """See `RowLinearisation`."""
        return np.asarray(np.einsum("bmn,bn->bm", self._jacobian, vectors))

    def transposed_times(self, vectors: FloatArray) -> FloatArray:
        """See `RowLinearisation`."""
        return np.asarray(np.einsum("bmn,bm->bn", self._jacobian, vectors))

    def factors(
        self,
        multipliers: FloatArray,
        weights: FloatArray,
        shifts: FloatArray,
        objective: FloatArray | float = 1.0,
    ) -> Factors:
        """See `RowLinearisation`."""
        diagonal = np.arange(self.gradient.shape[1])
        of_x, of_g = weights[:, : diagonal.size], weights[:, diagonal.size :]
        matrices = self.condensed(multipliers, of_g, objective)
        matrices[:, diagonal, diagonal] += of_x
        return DenseFactors(matrices, shifts)

    def condensed(
        self, multipliers: FloatArray, weights: FloatArray, objective: FloatArray | float = 1.0
    ) -> FloatArray:
        """Hessians of objective f + multipliers' g, plus J' diag(weights) J: (b, nx, nx)."""
        hessian = lagrangian_hessian(self._problems.nlp)
        of_f = np.broadcast_to(objective, len(multipliers))
        upper = self._problems.call(hessian, self._rows, self._x, of_f, multipliers)[0]
        transposed = np.swapaxes(self._jacobian, 1, 2)
        full = upper + np.swapaxes(np.triu(upper, 1), 1, 2)
        return np.asarray(full + (transposed * weights[:, None]) @ self._jacobian)


@locked_cache(maxsize=64)
def lagrangian_hessian(nlp: Nlp) -> Expr:
    """CasADi Function (x, p, lam_f, lam_g) to the Lagrangian's Hessian, its upper triangle."""
    own = nlp.attached(LagrangianHessian)
    if own is not None:
        return own.function
    weight, multipliers = ca.MX.sym("lam_f"), ca.MX.sym("lam_g", nlp.sizes[2])
    lagrangian = weight * nlp.objective + ca.dot(multipliers, nlp.g)
    upper = ca.triu(ca.hessian(lagrangian, nlp.x)[0])
    function = ca.Function("hessian", [nlp.x, nlp.p, weight, multipliers], [upper])
    return function.expand() if nlp.unroll else function
