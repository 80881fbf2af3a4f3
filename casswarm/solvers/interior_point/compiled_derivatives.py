"""A program's values and derivatives by compiled loops over the scalar operations of its graph."""

from __future__ import annotations

import casadi as ca
import numpy as np

from ..._util.threads import locked_cache
from ...nlp.program import LagrangianHessian, Nlp
from ...typing import Expr, FloatArray, IntArray
from .derivatives import CasadiProblems, NumericDerivatives, Problems, RowProblems
from .factors import DenseFactors, Factors, SparseFactors, SparseSystem, shifts_to_try
from .tape import MAX_OPERATIONS, Tape, scalar


@locked_cache(maxsize=64)
def program_tapes(nlp: Nlp) -> ProgramTapes | None:
    """Tapes of a program; None if it has operations that are not scalar, or too many."""
    try:
        return ProgramTapes(nlp)
    except NotImplementedError:
        return None


def numeric_problems(nlp: Nlp, p: FloatArray) -> Problems:
    """Instances of a program: by its own compiled code, by its tapes, or by CasADi."""
    numeric = nlp.attached(NumericDerivatives)
    if numeric is not None:
        return RowProblems(numeric.problems(p), nlp.sizes[2])
    tapes = program_tapes(nlp)
    if tapes is None:
        return RowProblems(CasadiProblems(nlp, p), nlp.sizes[2])
    return CompiledProblems(tapes, p)


class ProgramTapes:
    """Tapes of a program's values, first derivatives, and the Lagrangian's Hessian.

    Raises
    ------
    NotImplementedError
        An operation is not scalar, or there are too many.
    """

    def __init__(self, nlp: Nlp) -> None:
        x, p, lam_f, lam_g = (ca.SX.sym("v", size) for size in (*nlp.sizes[:2], 1, nlp.sizes[2]))
        f, g = scalar(nlp.evaluate)(x, p)
        lagrangian, weights = lam_f * f + ca.dot(lam_g, g), ca.vertcat(lam_f, lam_g)
        _require_small([x, p, lam_f, lam_g], ca.gradient(lagrangian, x))
        own = nlp.attached(LagrangianHessian)
        if own is None:
            upper = ca.triu(ca.hessian(lagrangian, x)[0])
        else:
            upper = scalar(own.function)(x, p, lam_f, lam_g)
        derivatives = [ca.densify(ca.gradient(f, x)), ca.jacobian(g, x)]
        self.values = Tape.of([x, p], [ca.densify(f), ca.densify(g)])
        self.first = Tape.of([x, p], derivatives)
        self.hessian = Tape.of([x, p, weights], [upper])
        self.n_rows, self.jacobian = nlp.sizes[2], self.first.patterns[1]
        self.system = SparseSystem.of(nlp.sizes[0], self.hessian.patterns[0], self.jacobian)


def _require_small(arguments: list[Expr], gradient: Expr) -> None:
    """Raise NotImplementedError if the Jacobian of a gradient would have too many operations.

    It takes the gradient's operations for every group of columns without a common row.
    """
    groups = ca.jacobian_sparsity(gradient, arguments[0]).uni_coloring().size2()
    number = ca.Function("gradient", arguments, [gradient]).n_instructions() * groups
    if number > MAX_OPERATIONS:
        raise NotImplementedError(f"a Hessian of about {number} operations")


class CompiledProblems:
    """Instances of a program by its tapes; see `Problems`."""

    def __init__(self, tapes: ProgramTapes, p: FloatArray) -> None:
        self.tapes, self.p = tapes, np.ascontiguousarray(p.T)

    def evaluate(self, rows: IntArray, x: FloatArray) -> tuple[FloatArray, FloatArray]:
        """See `Problems`."""
        f, g = self.tapes.values(x, self.p.take(rows, 1))
        return f[0], g

    def linearise(self, rows: IntArray, x: FloatArray) -> CompiledLinearisation:
        """See `Problems`."""
        kind = CompiledLinearisation if self.tapes.system is None else SparseLinearisation
        return kind(self.tapes, x, self.p.take(rows, 1))


class CompiledLinearisation:
    """See `Linearisation`; condensed matrices are dense."""

    def __init__(self, tapes: ProgramTapes, x: FloatArray, p: FloatArray) -> None:
        self._tapes, self._x, self._p = tapes, x, p
        self.gradient, self._entries = tapes.first(x, p)

    def times(self, vectors: FloatArray) -> FloatArray:
        """See `Linearisation`."""
        from .system_kernels import times

        out = np.empty((self._tapes.n_rows, vectors.shape[1]))
        rows, columns = self._tapes.jacobian
        times(self._entries, rows, columns, vectors, out)
        return out

    def transposed_times(self, vectors: FloatArray) -> FloatArray:
        """See `Linearisation`."""
        from .system_kernels import times

        out = np.empty_like(self.gradient)
        rows, columns = self._tapes.jacobian
        times(self._entries, columns, rows, vectors, out)
        return out

    def row_sizes(self) -> FloatArray:
        """See `Linearisation`."""
        sizes = np.zeros((self._tapes.n_rows, self.gradient.shape[1]))
        for row, entries in zip(self._tapes.jacobian[0], abs(self._entries), strict=True):
            np.maximum(sizes[row], entries, out=sizes[row])
        return sizes

    def factors(
        self,
        multipliers: FloatArray,
        weights: FloatArray,
        last: FloatArray,
        objective: FloatArray | float = 1.0,
    ) -> Factors:
        """See `Linearisation`."""
        size, batch = self.gradient.shape
        matrices = np.zeros((batch, size, size))
        rows, columns = self._tapes.hessian.patterns[0]
        matrices[:, rows, columns] = matrices[:, columns, rows] = self._hessian(
            multipliers, objective
        ).T
        matrices[:, np.arange(size), np.arange(size)] += weights[:size].T
        jacobian = np.zeros((batch, len(multipliers), size))
        jacobian[:, *self._tapes.jacobian] = self._entries.T
        weighted = jacobian * weights[size:].T[..., None]
        condensed = matrices + weighted.swapaxes(1, 2) @ jacobian
        return DenseFactors(condensed, shifts_to_try(last))

    def _hessian(self, multipliers: FloatArray, objective: FloatArray | float) -> FloatArray:
        if not np.any(objective) and not multipliers.any():
            return np.zeros((self._tapes.hessian.patterns[0].shape[1], multipliers.shape[1]))
        of_f = np.full((1, multipliers.shape[1]), objective)
        return self._tapes.hessian(self._x, self._p, np.vstack([of_f, multipliers]))[0]


class SparseLinearisation(CompiledLinearisation):
    """One of a program whose condensed matrices have sparse factors."""

    def factors(
        self,
        multipliers: FloatArray,
        weights: FloatArray,
        last: FloatArray,
        objective: FloatArray | float = 1.0,
    ) -> Factors:
        """See `Linearisation`."""
        system, size = self._tapes.system, len(self.gradient)
        assert system is not None
        values = (
            self._hessian(multipliers, objective),
            self._entries,
            weights[size:],
            weights[:size],
        )
        return SparseFactors(system, values, last)
