"""A program's values and derivatives by compiled loops over the scalar operations of its graph."""

from __future__ import annotations

import casadi as ca
import numpy as np

from ...._util.threads import locked_cache
from ....typing import Expr, FloatArray, IntArray
from ...problem import Nlp
from .factors import Factors
from .problems import CasadiProblems, NumericProblems
from .sparse_factors import SparseFactors, SparseSystem
from .tape import MAX_OPERATIONS, Tape, scalar


@locked_cache(maxsize=64)
def program_tapes(nlp: Nlp) -> ProgramTapes | None:
    """Tapes of a program; None if it has operations that are not scalar, or too many."""
    try:
        return ProgramTapes(nlp)
    except NotImplementedError:
        return None


def numeric_problems(nlp: Nlp, p: FloatArray) -> NumericProblems:
    """Instances of a program: by its own compiled code, by its tapes, or by CasADi."""
    if nlp.numeric is not None:
        problems: NumericProblems = nlp.numeric(p)
        return problems
    tapes = program_tapes(nlp)
    return CasadiProblems(nlp, p) if tapes is None else CompiledProblems(tapes, p)


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
        lagrangian = lam_f * f + ca.dot(lam_g, g)
        _require_small([x, p, lam_f, lam_g], ca.gradient(lagrangian, x))
        if nlp.hessian is None:
            upper = ca.triu(ca.hessian(lagrangian, x)[0])
        else:
            upper = scalar(nlp.hessian)(x, p, lam_f, lam_g)
        derivatives = [ca.densify(ca.gradient(f, x)), ca.jacobian(g, x)]
        self.values = Tape.of([x, p], [ca.densify(f), ca.densify(g)])
        self.first = Tape.of([x, p], derivatives)
        self.hessian = Tape.of([x, p, lam_f, lam_g], [upper])
        rows, self.columns = self.first.patterns[1]
        self.n_rows = nlp.sizes[2]
        self.order = np.argsort(rows, kind="stable")
        self.rows, self.columns = rows[self.order], self.columns[self.order]
        pattern = np.stack([self.rows, self.columns])
        self.system = SparseSystem.of(nlp.sizes[0], self.hessian.patterns[0], pattern)


def _require_small(arguments: list[Expr], gradient: Expr) -> None:
    """Raise NotImplementedError if the Jacobian of a gradient would have too many operations.

    It takes the gradient's operations for every group of columns without a common row.
    """
    groups = ca.jacobian_sparsity(gradient, arguments[0]).uni_coloring().size2()
    number = ca.Function("gradient", arguments, [gradient]).n_instructions() * groups
    if number > MAX_OPERATIONS:
        raise NotImplementedError(f"a Hessian of about {number} operations")


class CompiledProblems:
    """Instances of a program by its tapes; see `NumericProblems`."""

    def __init__(self, tapes: ProgramTapes, p: FloatArray) -> None:
        self.tapes, self.p = tapes, p

    def evaluate(self, rows: IntArray, x: FloatArray) -> tuple[FloatArray, FloatArray]:
        """See `NumericProblems`."""
        f, g = self.tapes.values(x, self.p[rows])
        return f[:, 0], g

    def linearise(self, rows: IntArray, x: FloatArray) -> CompiledLinearisation:
        """See `NumericProblems`."""
        tapes, system = self.tapes, self.tapes.system
        if system is None:
            return CompiledLinearisation(tapes, x, self.p[rows])
        return SparseLinearisation(system, tapes, x, self.p[rows])


class CompiledLinearisation:
    """See `Linearisation`."""

    def __init__(self, tapes: ProgramTapes, x: FloatArray, p: FloatArray) -> None:
        self._tapes, self._x, self._p = tapes, x, p
        self.gradient, entries = tapes.first(x, p)
        self._entries = np.ascontiguousarray(entries[:, tapes.order])

    def times(self, vectors: FloatArray) -> FloatArray:
        """See `Linearisation`."""
        from .system_kernels import times

        out = np.empty((len(vectors), self._tapes.n_rows))
        times(self._entries, self._tapes.rows, self._tapes.columns, vectors, out)
        return out

    def transposed_times(self, vectors: FloatArray) -> FloatArray:
        """See `Linearisation`."""
        from .system_kernels import times

        out = np.empty(self._x.shape)
        vectors = np.ascontiguousarray(vectors)
        times(self._entries, self._tapes.columns, self._tapes.rows, vectors, out)
        return out

    def condensed(self, multipliers: FloatArray, weights: FloatArray) -> FloatArray:
        """See `Linearisation`."""
        entries, (rows, columns) = self._hessian(multipliers), self._tapes.hessian.patterns[0]
        batch, size = self._x.shape
        out = np.zeros((batch, size, size))
        out[:, rows, columns] = entries
        out[:, columns, rows] = entries
        jacobian = np.zeros((batch, weights.shape[1], size))
        jacobian[:, self._tapes.rows, self._tapes.columns] = self._entries
        return out + (jacobian.swapaxes(1, 2) * weights[:, None]) @ jacobian

    def _hessian(self, multipliers: FloatArray) -> FloatArray:
        ones = np.ones((len(multipliers), 1))
        return self._tapes.hessian(self._x, self._p, ones, multipliers)[0]


class SparseLinearisation(CompiledLinearisation):
    """One of a program whose condensed matrices have sparse factors; see `Factorises`."""

    def __init__(self, system: SparseSystem, tapes: ProgramTapes, *point: FloatArray) -> None:
        super().__init__(tapes, *point)
        self._system = system

    def factors(self, multipliers: FloatArray, weights: FloatArray, last: FloatArray) -> Factors:
        """See `Factorises`."""
        size = self._x.shape[1]
        values = self._hessian(multipliers), self._entries, weights[:, size:], weights[:, :size]
        return SparseFactors(self._system, values, last)
