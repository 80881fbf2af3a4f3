"""Scaling of variables, objective and rows, for every instance of a batch."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np
from typing_extensions import override

from ...nlp.program import Instances
from ...typing import FloatArray, IntArray
from .derivatives import Condensation, Linearisation, Problems
from .factors import Factors
from .iterates import INFINITE, Results

_LARGE, _SMALL = 100.0, 1e-2  # sizes of gradients that are not scaled
_LEAST = 1e-8  # factor, and its inverse the largest
_NOTHING = 1e-12  # size that is rounding error


@dataclass(frozen=True, eq=False)
class Scaling:
    """Factors of B instances: the method solves objective f(length x') s.t. rows g(length x').

    Parameters
    ----------
    length, objective : (B,)
    rows : (ng, B)
    """

    length: FloatArray
    objective: FloatArray
    rows: FloatArray

    @classmethod
    def of(cls, problems: Problems, instances: Instances, width: int) -> Scaling:
        """Factors of `Instances.scale`, and of gradients at the initial guesses.

        In those units, gradients of f and of rows above 100 are scaled to 100, as in Ipopt. If all
        rows' gradients are below 0.01, they have a common factor: a single one may be small at the
        initial guess only. `width` instances are linearised at a time.
        """
        length, value = np.array(instances.scale.T)
        objective, rows = 1.0 / value, np.ones(instances.lbg.T.shape)
        for start in range(0, len(instances), width):
            some = np.arange(start, min(start + width, len(instances)))
            x = np.clip(instances.x0[some], instances.lbx[some], instances.ubx[some])
            at = problems.linearise(some, np.ascontiguousarray(x.T))
            gradient = length[some] / value[some] * abs(at.gradient).max(axis=0, initial=0.0)
            objective[some] *= _smaller(gradient)
            sizes = length[some] * at.row_sizes()
            rows[:, some] = _smaller(sizes) * _larger(sizes.max(axis=0, initial=0.0))
        return cls(length, objective, rows)

    @classmethod
    def none(cls, instances: Instances) -> Scaling:
        """No scaling."""
        one = np.ones(len(instances))
        return cls(one, one, np.ones(instances.lbg.T.shape))

    @property
    def trivial(self) -> bool:
        """True if all factors are 1."""
        return bool(all((part == 1.0).all() for part in (self.length, self.objective, self.rows)))

    def scaled(self, instances: Instances) -> Instances:
        """The instances in the method's units."""
        length, rows = self.length[:, None], self.rows.T
        multipliers: dict[str, Any] = {}
        if instances.lam_x0 is not None and instances.lam_g0 is not None:
            objective = self.objective[:, None]
            multipliers["lam_x0"] = instances.lam_x0 * objective * length
            multipliers["lam_g0"] = instances.lam_g0 * objective / rows
        return replace(
            instances,
            **multipliers,
            x0=instances.x0 / length,
            lbx=_bounds(instances.lbx) / length,
            ubx=_bounds(instances.ubx) / length,
            lbg=_bounds(instances.lbg) * rows,
            ubg=_bounds(instances.ubg) * rows,
        )

    def restore(self, results: Results) -> None:
        """Write results in the units of the instances."""
        length, objective = self.length[:, None], self.objective[:, None]
        results.x *= length
        results.lam_x /= objective * length
        results.lam_g *= self.rows.T / objective


_FACTORS = fields(Scaling)


def _bounds(values: FloatArray) -> FloatArray:
    return np.where(abs(values) >= INFINITE, np.copysign(np.inf, values), values)


def _smaller(sizes: FloatArray) -> FloatArray:
    """Factors up to 1 of gradients of more than 100; 1 where a size is not finite."""
    factors = np.maximum(_LARGE / np.maximum(sizes, _LARGE), _LEAST)
    return np.where(np.isfinite(sizes), factors, 1.0)


def _larger(sizes: FloatArray) -> FloatArray:
    """Factors from 1 of all rows, from the largest size of any; 1 where that is rounding error."""
    factors = np.minimum(_SMALL / np.clip(sizes, _NOTHING, _SMALL), 1.0 / _LEAST)
    return np.where(sizes > _NOTHING, factors, 1.0)


class ScaledProblems(Problems):
    """Instances of a program in other units."""

    def __init__(self, problems: Problems, scaling: Scaling) -> None:
        self._problems, self._scaling, self.lanes = problems, scaling, problems.lanes

    @override
    def evaluate(self, rows: IntArray, x: FloatArray) -> tuple[FloatArray, FloatArray]:
        scaling = self._scaling
        f, g = self._problems.evaluate(rows, scaling.length.take(rows) * x)
        return scaling.objective.take(rows) * f, scaling.rows.take(rows, 1) * g

    @override
    def linearise(self, rows: IntArray, x: FloatArray) -> Linearisation:
        some = Scaling(*(getattr(self._scaling, part.name).take(rows, -1) for part in _FACTORS))
        return _ScaledLinearisation(self._problems.linearise(rows, some.length * x), some)


class _ScaledLinearisation(Linearisation):
    def __init__(self, at: Linearisation, scaling: Scaling) -> None:
        self._at, self._scaling = at, scaling
        self.gradient = scaling.objective * scaling.length * at.gradient

    @override
    def row_sizes(self) -> FloatArray:
        return self._scaling.rows * self._scaling.length * self._at.row_sizes()

    @override
    def times(self, vectors: FloatArray) -> FloatArray:
        return self._scaling.rows * self._at.times(self._scaling.length * vectors)

    @override
    def transposed_times(self, vectors: FloatArray) -> FloatArray:
        return self._scaling.length * self._at.transposed_times(self._scaling.rows * vectors)

    @override
    def factors(self, terms: Condensation, last: FloatArray) -> Factors:
        scaling, size, weights = self._scaling, len(self.gradient), terms.weights
        squared = scaling.length**2
        inner = np.vstack([weights[:size], squared * scaling.rows**2 * weights[size:]])
        of_g = squared * scaling.rows * terms.multipliers
        of_f = terms.objective * scaling.objective * squared
        return self._at.factors(Condensation(of_g, inner, of_f), last)
