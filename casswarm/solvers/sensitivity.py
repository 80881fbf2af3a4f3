"""Derivatives of solutions, multipliers and optimal values by the parameters.

At a solution with the active rows A of bounds and g, the implicit function theorem gives

    H dx + A' dlam = -d2L/dxdp dp,    A dx = -dA/dp dp,

for the Hessian H of the Lagrangian L. The condensed matrix H + A' R A with a large diagonal R has a
Cholesky factor if the second-order sufficient condition holds; it solves the system up to terms of
1 / R, which refinement removes. See A. V. Fiacco, Introduction to Sensitivity and Stability
Analysis in Nonlinear Programming, Academic Press, 1983.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np
from scipy import linalg

from .._util.threads import locked_cache, one_blas_thread
from ..compiled.kernels import contiguous
from ..errors import SolverError
from ..nlp.program import Instances, Nlp
from ..nlp.residuals import estimated_multipliers
from ..nlp.solution import BatchSolution, Sensitivities
from ..typing import BoolArray, FloatArray
from .interior_point.derivatives import (
    Condensation,
    FunctionLinearisation,
    Functions,
    program_functions,
)
from .interior_point.iterates import are_equal
from .interior_point.system_kernels import times
from .interior_point.tape import Calls, Tape, scalar

WEAK = 1e-4
"""Multiplier and slack, relative to the problem's scale, below which a row is weakly active."""

_PENALTY = 1e8  # of active rows, relative to the Hessian
_CONVERGED, _ACCURATE = 1e-10, 1e-8  # relative residuals: at which refinement ends, and allowed
_REFINEMENTS = 12
_SINGULAR = 1e-11  # least eigenvalue of the system, relative to the largest
_FAR = 1e-4  # relative length of a Newton step to the solution, from which it is not determined
_FLAT = 1e-4  # least size of a Hessian, relative to the scale of the instance
_LARGEST = 1500  # size of a dense system whose eigenvalues are found
_WIDTH = 128  # of instances that are solved together


def sensitivities(
    nlp: Nlp,
    instances: Instances,
    solution: BatchSolution,
    multipliers: tuple[FloatArray, FloatArray] | None = None,
) -> Sensitivities:
    """Derivatives of the solutions of a batch by the parameters of the program.

    Parameters
    ----------
    nlp : Nlp
    instances : Instances
    solution : BatchSolution
        Answers of any solver to the instances.
    multipliers : (B, nx), (B, ng), optional
        Of the bounds and of g, positive at an upper bound; by default those of the solution. Rows
        that are NaN are estimated by least squares over the active rows.

    Raises
    ------
    SolverError
        The shapes of instances, solution or multipliers do not fit the program.
    """
    systems = KktSystems.of(nlp, instances, solution, multipliers)
    return Sensitivities(
        np.concatenate([part.value_gradient() for part in systems.parts]),
        np.concatenate([part.weak.T for part in systems.parts]),
        np.concatenate([part.regular for part in systems.parts]),
        systems.forward,
        systems.adjoint,
    )


@locked_cache(maxsize=32)
def _cross_derivatives(nlp: Nlp) -> Tape | Calls:
    """(x, p, weights of f and g) to d2L/dxdp, dg/dp and dL/dp."""
    try:
        return _derived(Tape, ca.SX, nlp)
    except NotImplementedError:
        return _derived(Calls, ca.MX, nlp)


def _derived(kind: type[Tape] | type[Calls], symbols: Any, nlp: Nlp) -> Tape | Calls:
    variables, parameters, rows = nlp.sizes
    x, p, weights = (symbols.sym("v", size) for size in (variables, parameters, 1 + rows))
    evaluate = scalar(nlp.evaluate) if kind is Tape else nlp.evaluate
    f, g = evaluate(x, p)
    lagrangian = weights[0] * f + (ca.dot(weights[1:], g) if rows else 0)
    by_p = ca.gradient(lagrangian, p)
    cross = ca.jacobian(ca.gradient(lagrangian, x), p)
    return kind.of([x, p, weights], [cross, ca.jacobian(g, p), ca.densify(by_p)])


@dataclass(frozen=True, eq=False)
class KktSystems:
    """Systems of the active rows of B instances, in parts of at most `_WIDTH`."""

    parts: list[_Part]

    @classmethod
    def of(
        cls,
        nlp: Nlp,
        instances: Instances,
        solution: BatchSolution,
        multipliers: tuple[FloatArray, FloatArray] | None = None,
    ) -> KktSystems:
        """Systems at the answers to the instances; see `sensitivities`."""
        instances.require_fit(nlp)
        lam = _multipliers(nlp, instances, solution, multipliers)
        functions = program_functions(nlp), _cross_derivatives(nlp)
        parts = []
        with one_blas_thread(), np.errstate(all="ignore"):
            for start in range(0, max(1, len(instances)), _WIDTH):
                some = slice(start, start + _WIDTH)
                known = solution.success[some]
                parts.append(_Part(functions, instances[some], solution.x[some], lam[some], known))
        return cls(parts)

    def forward(self) -> tuple[FloatArray, FloatArray]:
        """dx/dp (B, nx, np) and dlam/dp (B, nx + ng, np); NaN where singular."""
        with one_blas_thread(), np.errstate(all="ignore"):
            pairs = [part.forward() for part in self.parts]
        dx, dlam = (np.concatenate(each) for each in zip(*pairs, strict=True))
        return dx, dlam

    def adjoint(self, bar_x: FloatArray, bar_lam: FloatArray | None = None) -> FloatArray:
        """Vector-Jacobian products (B, np): bar_x' dx/dp + bar_lam' dlam/dp, by a single solve.

        Parameters
        ----------
        bar_x : (B, nx)
        bar_lam : (B, nx + ng), optional
            Zero by default.
        """
        parts, start = [], 0
        with one_blas_thread(), np.errstate(all="ignore"):
            for part in self.parts:
                some = slice(start, start + len(part.regular))
                bar = None if bar_lam is None else contiguous(bar_lam[some].T)
                parts.append(part.adjoint(contiguous(bar_x[some].T), bar))
                start = some.stop
        return np.concatenate(parts)


def _multipliers(
    nlp: Nlp,
    instances: Instances,
    solution: BatchSolution,
    multipliers: tuple[FloatArray, FloatArray] | None,
) -> FloatArray:
    """Multipliers (B, nx + ng) of bounds and rows; those of solutions are estimated if missing."""
    variables, _, rows = nlp.sizes
    shape = len(instances), variables + rows
    lam = np.hstack(multipliers or (solution.lam_x, solution.lam_g))
    if solution.x.shape != (shape[0], variables) or lam.shape != shape:
        message = (
            f"x has shape {solution.x.shape} and multipliers {lam.shape}; expected: "
            f"{(shape[0], variables)} and {shape} for the program {nlp.name!r}"
        )
        raise SolverError(message, key="solution", shape=solution.x.shape, expected=shape)
    for i in np.flatnonzero(np.isnan(lam).any(axis=1) & solution.success):
        lam[i] = estimated_multipliers(nlp, instances[i : i + 1], solution.x[i])
    return lam


class _Part:
    """Systems of b instances; arrays have instances last, and rows are the bounds, then g."""

    def __init__(
        self,
        functions: tuple[Functions, Tape | Calls],
        instances: Instances,
        x: FloatArray,
        lam: FloatArray,
        known: BoolArray,
    ) -> None:
        (program, cross), size = functions, x.shape[1]
        by_column, p = contiguous(x.T), contiguous(instances.p.T)
        self._at, self._program = FunctionLinearisation(program, by_column, p), program
        self._lam, rows = contiguous(lam.T), contiguous(lam.T[size:])
        weights = np.vstack([np.ones((1, len(x))), rows])
        self._hessian = program.hessian(by_column, p, weights)[0]
        rows_of, columns_of = program.hessian.patterns[0]
        off = rows_of != columns_of  # of the upper triangle, whose entries are in both
        self._symmetric = (
            np.concatenate([self._hessian, self._hessian[off]]),
            np.concatenate([rows_of, columns_of[off]]),
            np.concatenate([columns_of, rows_of[off]]),
        )
        self._cross, (of_cross, of_g, self._by_p) = cross, cross(by_column, p, weights)
        self._by_p[:, ~known] = np.nan
        self._entries = of_cross, of_g
        self._norms = np.vstack([np.ones_like(by_column), self._at.row_sizes()])
        self._set_active(instances, np.vstack([by_column, program.values(by_column, p)[1]]))
        length, value = instances.scale.T
        sizes = abs(self._hessian).max(axis=0, initial=0.0)
        self._size_of_hessian = np.maximum(sizes, _FLAT * value / length**2)
        stiff = _PENALTY * self._size_of_hessian / np.maximum(self._norms, 1e-300) ** 2
        self._penalties = np.where(self._active, stiff, 0.0)
        terms = Condensation(rows, self._penalties)
        self._factors = self._at.factors(terms, np.zeros(len(x)))
        self._dense: dict[int, Any] = {}
        self.regular = known & (self._factors.shifts == 0.0)
        self._probe(known)

    def _set_active(self, instances: Instances, values: FloatArray) -> None:
        """Find the active rows, and those that are weakly so."""
        lower = np.vstack([instances.lbx.T, instances.lbg.T])
        upper = np.vstack([instances.ubx.T, instances.ubg.T])
        length, value = instances.scale.T
        forces = abs(self._lam) * self._norms
        force = np.maximum(value / length, abs(self._at.gradient).max(axis=0, initial=0.0))
        forces /= np.maximum(force, forces.max(axis=0, initial=0.0))
        nearest = np.where(upper - values < values - lower, values - upper, values - lower)
        size = len(instances.x0.T)
        self._length = np.maximum(length, abs(values[:size]).max(axis=0, initial=0.0))
        self._distance = np.where(self._lam > 0.0, values - upper, values - lower)
        self._distance = np.where(np.isfinite(self._distance), self._distance, nearest)
        distance = abs(self._distance) / np.maximum(self._norms, 1e-300) / self._length
        equal = are_equal(lower, upper)
        self._active = equal | (forces > distance)
        pulled = self._at.transposed_times(contiguous(self._lam[size:]))
        self._residual = self._at.gradient + pulled + self._lam[:size]
        self.weak = ~equal & (np.maximum(forces, distance) < WEAK)

    def _probe(self, known: BoolArray) -> None:
        """Solve with arbitrary right-hand sides, which singular systems do not have answers for."""
        generator = np.random.default_rng(0)
        top = self._size_of_hessian * generator.normal(size=self._at.gradient.shape)
        below = self._norms * generator.normal(size=self._norms.shape)
        (u, v), error = self._refined(top, below * self._active)
        size = abs(v * self._norms).max(axis=0, initial=0.0) / self._size_of_hessian
        bounded = np.maximum(abs(u).max(axis=0, initial=0.0), size) < 0.1 * _PENALTY
        self.regular &= (error < _ACCURATE) & bounded
        for i in np.flatnonzero(known & ~self.regular):
            self._factorise(int(i))
        step, _ = self._solved(-self._residual, np.where(self._active, -self._distance, 0.0))
        near = abs(step).max(axis=0, initial=0.0) <= _FAR * self._length
        self.regular &= near

    def _factorise(self, i: int) -> None:
        """Factors of the whole system of an instance, if a solution satisfies the conditions."""
        size, rows = len(self._at.gradient), np.flatnonzero(self._active[:, i])
        if size + len(rows) > _LARGEST:
            return
        hessian = np.zeros((size, size))
        hessian[*self._program.hessian.patterns[0]] = self._hessian[:, i]
        hessian += np.triu(hessian, 1).T
        jacobian = np.zeros((len(self._norms), size))
        jacobian[np.arange(size), np.arange(size)] = 1.0
        one, two = self._program.first.patterns[1]
        jacobian[size + one, two] = self._at.entries[:, i]
        scale = np.maximum(self._norms[rows, i], 1e-300) / self._size_of_hessian[i]
        part = jacobian[rows] / scale[:, None]
        matrix = np.block([[hessian, part.T], [part, np.zeros((len(rows), len(rows)))]])
        if not np.isfinite(matrix).all():
            return
        eigenvalues = linalg.eigvalsh(matrix)
        sound = abs(eigenvalues).min() > _SINGULAR * abs(eigenvalues).max()
        if sound and (eigenvalues < 0.0).sum() == len(rows):
            self.regular[i] = True
            self._dense[i] = linalg.lu_factor(matrix), rows, scale

    def _hessian_times(self, u: FloatArray) -> FloatArray:
        product = np.empty_like(u)
        times(*self._symmetric, u, product)
        return product

    def _refined(self, top: FloatArray, below: FloatArray) -> tuple[Any, FloatArray]:
        """Solutions (u, v) of H u + A' v = top, A u = below, and their relative residuals (b,)."""
        size, active, norms = len(top), self._active, np.maximum(self._norms, 1e-300)
        u, v, right, low = np.zeros_like(top), np.zeros_like(below), top, below
        stiffness = self._size_of_hessian
        largest = np.maximum(
            abs(top).max(axis=0, initial=0.0) / stiffness,
            abs(below / norms).max(axis=0, initial=0.0),
        )
        error = np.zeros(top.shape[1])
        for _ in range(_REFINEMENTS):
            forces = self._penalties * low
            pulled = right + forces[:size] + self._at.transposed_times(forces[size:])
            du = self._factors.solve(pulled)
            u += du
            moves = np.concatenate([du, self._at.times(du)])
            v += self._penalties * moves - forces
            right = top - self._hessian_times(u) - v[:size] - self._at.transposed_times(v[size:])
            low = low - active * moves
            moved = np.maximum(largest, abs(u).max(axis=0, initial=0.0))
            moved = np.maximum(moved, abs(v * norms).max(axis=0, initial=0.0) / stiffness)
            error = abs(right).max(axis=0, initial=0.0) / stiffness
            error = np.maximum(error, abs(low / norms).max(axis=0, initial=0.0))
            error /= np.maximum(moved, 1e-300)
            if not (error > _CONVERGED).any():
                break
        return (u, v), error

    def _solved(self, top: FloatArray, below: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Solutions of the systems; NaN where they are singular."""
        (u, v), error = self._refined(top, below)
        failed = ~(self.regular & (error < _ACCURATE))
        u[:, failed], v[:, failed] = np.nan, np.nan
        for i, (factor, rows, scale) in self._dense.items():
            values = linalg.lu_solve(factor, np.concatenate([top[:, i], below[rows, i] / scale]))
            u[:, i], v[:, i] = values[: len(top)], 0.0
            v[rows, i] = values[len(top) :] / scale
        return u, v

    def _parameters(self) -> tuple[FloatArray, FloatArray]:
        """d2L/dxdp (np, nx, b), and derivatives (np, nx + ng, b) of the active rows."""
        size, count = len(self._at.gradient), len(self._by_p)
        arrays = []
        of_rows = (size, len(self._norms) - size)
        for entries, (rows, columns), number in zip(
            self._entries, self._cross.patterns, of_rows, strict=False
        ):
            arrays.append(np.zeros((count, number, entries.shape[1])))
            arrays[-1][columns, rows] = entries
        below = np.concatenate([np.zeros_like(arrays[0]), arrays[1]], axis=1)
        return arrays[0], below * self._active

    def forward(self) -> tuple[FloatArray, FloatArray]:
        """See `KktSystems.forward`."""
        tops, belows = self._parameters()
        dx, dlam = np.empty_like(tops), np.empty_like(belows)
        for k, (top, below) in enumerate(zip(tops, belows, strict=True)):
            dx[k], dlam[k] = self._solved(-top, -below)
        return dx.transpose(2, 1, 0), dlam.transpose(2, 1, 0)

    def adjoint(self, bar_x: FloatArray, bar_lam: FloatArray | None) -> FloatArray:
        """See `KktSystems.adjoint`."""
        bar = np.zeros_like(self._norms) if bar_lam is None else bar_lam * self._active
        u, v = self._solved(bar_x, bar)
        size, products = len(u), np.zeros((u.shape[1], len(self._by_p)))
        for entries, (rows, columns), vectors in zip(
            self._entries, self._cross.patterns, (u, v[size:]), strict=False
        ):
            part = np.empty((len(self._by_p), u.shape[1]))
            times(entries, columns, rows, contiguous(vectors), part)
            products -= part.T
        return products

    def value_gradient(self) -> FloatArray:
        """Gradients (b, np) of the optimal values; NaN without a solution."""
        return np.asarray(self._by_p.T)
