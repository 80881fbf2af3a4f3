"""Elastic programs: the least violation of sets of rows and bounds, for many sets at once.

The elastic program of a set of entries (rows and bounds of variables) is

    minimise  sum over its rows i of  dist(g_i(z), [l_i, u_i])^2 / 2
    subject to its bounds on z,

in units in which variables and rows are comparable: the other rows do not count, and the other
variables are free. Its value is zero exactly where a point meets the whole set. The elastic
variables are eliminated, so that it is a program of the size of the original one, without
constraints; sets are parameters, and a batch of sets and starts is solved at once.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import casadi as ca
import numpy as np
from typing_extensions import override

from ..compiled.kernels import contiguous
from ..nlp.program import Instances, Nlp
from ..solvers import FilterInteriorPoint
from ..solvers.interior_point.derivatives import (
    Condensation,
    Linearisation,
    NumericDerivatives,
    Problems,
    numeric_problems,
)
from ..solvers.interior_point.factors import Factors
from ..typing import BoolArray, FloatArray, IntArray

TOLERANCE = 1e-6
"""Largest violation that counts as none, in the units of `Units`."""

_SOLVER = FilterInteriorPoint(tolerance=1e-12, max_iter=30, mu_init=1e-2, scaling=False)


@dataclass(frozen=True, eq=False)
class Units:
    """Units in which variables and rows are comparable, and violations are judged.

    That of a variable is a typical distance to the bounds of the rows, or the width of its own
    bounds where that is less; that of a row is its change by the unit of a variable. They follow
    from the program, so that no result depends on the units that the user has chosen.

    Parameters
    ----------
    x : (nx,)
    rows : (ng,)
    """

    x: FloatArray
    rows: FloatArray

    @classmethod
    def of(cls, nlp: Nlp, instance: Instances, points: FloatArray) -> Units:
        """Units of an instance, by its rows and their gradients at points (K, nx)."""
        low, high, p = instance.lbg[0], instance.ubg[0], instance.p[0]
        slopes, lengths = [], []
        for x in points:
            g = np.asarray(nlp.evaluate(x, p)[1]).ravel()
            jacobian = abs(nlp.jacobian(x, p).full()).reshape(len(g), len(x))
            if np.isfinite(g).all() and np.isfinite(jacobian).all():
                distance = np.fmin(_positive(abs(g - low)), _positive(abs(g - high)))
                with np.errstate(all="ignore"):
                    lengths.append(distance[:, None] / _positive(jacobian))
                slopes.append(jacobian)
        given = np.stack([instance.x0[0], instance.lbx[0], instance.ubx[0]])
        given = abs(np.where(np.isfinite(given), given, 0.0)).max(axis=0)
        unit = np.fmin(_median(lengths, given.shape), _positive(instance.ubx[0] - instance.lbx[0]))
        unit = np.where(np.isfinite(unit), unit, np.where(given > 0, given, 1.0))
        changes = [(jacobian * unit).max(axis=1, initial=0.0)[None] for jacobian in slopes]
        rows = _median(changes, low.shape)
        bound = np.stack([low, high])
        bound = abs(np.where(np.isfinite(bound), bound, 0.0)).max(axis=0)
        return cls(unit, np.where(np.isfinite(rows), rows, np.where(bound > 0, bound, 1.0)))


def _positive(values: FloatArray) -> FloatArray:
    """The values that are above zero and finite, NaN instead of others."""
    return np.where((values > 0.0) & np.isfinite(values), values, np.nan)


def _median(parts: Sequence[FloatArray], shape: tuple[int, ...]) -> FloatArray:
    """Medians of columns, over values above zero that are finite; NaN if there are none."""
    columns = _positive(np.concatenate([np.full((1, *shape), np.nan), *parts]))
    known = ~np.isnan(columns).all(axis=0)
    medians = np.full(shape, np.nan)
    medians[known] = np.nanmedian(columns[:, known], axis=0)
    return medians


class _Elastic(Problems):
    """Elastic programs of B sets of rows, of which p (B, 3 ng) has the weights and bounds."""

    def __init__(self, rows: Problems, p: FloatArray) -> None:
        self._rows, self.lanes = rows, rows.lanes
        self._weights, self._low, self._high = map(contiguous, np.split(p.T, 3))

    def _excess(self, some: IntArray, g: FloatArray) -> FloatArray:
        """Signed distances of the rows that count to their bounds."""
        weights = self._weights.take(some, 1)
        excess = g - np.clip(g, self._low.take(some, 1), self._high.take(some, 1))
        return np.where(weights > 0.0, weights * excess, 0.0)

    @override
    def evaluate(self, rows: IntArray, x: FloatArray) -> tuple[FloatArray, FloatArray]:
        excess = self._excess(rows, self._rows.evaluate(rows, x)[1])
        return 0.5 * (excess**2).sum(axis=0), np.empty((0, rows.size))

    @override
    def linearise(self, rows: IntArray, x: FloatArray) -> Linearisation:
        excess = self._excess(rows, self._rows.evaluate(rows, x)[1])
        return _ElasticLinearisation(self._rows.linearise(rows, x), excess)


class _ElasticLinearisation(Linearisation):
    """Derivatives of half the sum of squares of the excess of rows."""

    def __init__(self, at: Linearisation, excess: FloatArray) -> None:
        self._at, self._excess = at, excess
        self.gradient = at.transposed_times(excess)

    @override
    def times(self, vectors: FloatArray) -> FloatArray:
        return np.empty((0, vectors.shape[1]))

    @override
    def transposed_times(self, vectors: FloatArray) -> FloatArray:
        return np.zeros_like(self.gradient)

    @override
    def row_sizes(self) -> FloatArray:
        return np.empty((0, self.gradient.shape[1]))

    @override
    def factors(self, terms: Condensation, last: FloatArray) -> Factors:
        violated = terms.objective * (self._excess != 0.0)
        inner = np.vstack([terms.weights, violated])
        multipliers = terms.objective * self._excess
        return self._at.factors(Condensation(multipliers, inner, 0.0), last)


class ElasticPrograms:
    """Elastic programs of an instance, and all points that were found by solving them.

    Entries are the rows, then the variables with their bounds; a set is a mask (ng + nx,) of them.

    Parameters
    ----------
    nlp : Nlp
    instance : Instances
        A single one.
    units : Units

    Attributes
    ----------
    points : (P, nx)
        In the user's units.
    violations : (P, ng + nx)
        Of every entry at every point, in `units`.
    """

    def __init__(self, nlp: Nlp, instance: Instances, units: Units) -> None:
        nx, _, ng = nlp.sizes
        z, scale = ca.MX.sym("z", nx), ca.MX.sym("scale", nx + ng)
        g = nlp.evaluate(scale[:nx] * z, ca.DM(instance.p[0]))[1]
        rows = {"g": g / scale[nx:]} if ng else {}
        self._rows = Nlp(nlp.name, {"z": z}, {"scale": scale}, ca.MX(0), rows)
        weights = ca.MX.sym("sets", 3 * ng)
        elastic = Nlp(nlp.name, {"z": z}, {"sets": weights}, ca.MX(0), {})
        self._program = elastic.with_attachments(NumericDerivatives(self._problems))
        self._bounds = tuple(
            np.concatenate([getattr(instance, f"{end}{part}")[0] for part in "gx"])
            for end in ("lb", "ub")
        )
        self.pose(units)

    def pose(self, units: Units) -> None:
        """Take other units, and forget all points."""
        ng, nx = len(units.rows), len(units.x)
        self.units, self._scale = units, np.concatenate([units.x, units.rows])
        entries = np.concatenate([units.rows, units.x])
        self._low, self._high = (bound / entries for bound in self._bounds)
        self._rows_between = self._low[:ng], self._high[:ng]
        self.points, self.violations = np.empty((0, nx)), np.empty((0, ng + nx))

    def _problems(self, p: FloatArray) -> Problems:
        scale = np.broadcast_to(self._scale, (len(p), len(self._scale)))
        return _Elastic(numeric_problems(self._rows, scale), p)

    def add(self, x: FloatArray) -> FloatArray:
        """Violations (P, ng + nx) at points (P, nx), which are kept."""
        z = x / self.units.x
        scale = np.broadcast_to(self._scale, (len(x), len(self._scale)))
        with np.errstate(all="ignore"):
            g = numeric_problems(self._rows, scale).evaluate(np.arange(len(x)), contiguous(z.T))[1]
        values = np.hstack([g.T, z])
        with np.errstate(invalid="ignore"):
            violations = np.maximum(np.maximum(self._low - values, values - self._high), 0.0)
        violations = np.where(np.isfinite(values), violations, np.inf)
        self.points = np.vstack([self.points, x])
        self.violations = np.vstack([self.violations, violations])
        return violations

    def pull(self, x: FloatArray) -> FloatArray:
        """Sizes (nx,) of the gradient of the elastic program of all rows at x, in `units`."""
        p = np.concatenate([np.ones_like(self.units.rows), *self._rows_between])[None]
        at = self._problems(p).linearise(np.array([0]), (x / self.units.x)[:, None])
        return np.abs(at.gradient[:, 0])

    def solve(self, sets: BoolArray, starts: FloatArray) -> None:
        """Add solutions of the programs of V sets (V, ng + nx), each from K points (V, K, nx)."""
        each = np.repeat(sets, starts.shape[1], axis=0)
        size, ng = len(each), len(self.units.rows)
        limits = (np.broadcast_to(bound, (size, ng)) for bound in self._rows_between)
        x0 = starts.reshape(size, -1) / self.units.x
        instances = Instances(
            x0,
            np.hstack([each[:, :ng].astype(float), *limits]),
            np.where(each[:, ng:], self._low[ng:], -np.inf),
            np.where(each[:, ng:], self._high[ng:], np.inf),
            *np.empty((2, size, 0)),
        )
        z = _SOLVER.solve_batch(self._program, instances).x
        self.add(z * self.units.x)
