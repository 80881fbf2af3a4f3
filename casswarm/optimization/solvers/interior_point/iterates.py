"""The state of the interior-point method: iterates, their residuals, and results."""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np

from ....typing import BoolArray, FloatArray, IntArray
from ...problem import Instances
from ...solution import Status
from .bounds import Bounds
from .filter import Filter
from .problems import Linearisation, NumericProblems

_SOLVED = 10.0  # residual of a barrier problem that counts as solved, in units of mu
_LARGE = 100.0  # mean multiplier from which residuals are relative to it


@dataclass(frozen=True)
class Options:
    """Tolerances and start of the method.

    Parameters
    ----------
    tolerance : float
        Of the optimality conditions, relative to large multipliers.
    violation : float
        Of the constraints, absolute.
    mu_init, bound_push : float
        Initial barrier parameter, and relative distance by which x0 is moved inside its bounds.
    max_iter : int
    """

    tolerance: float
    violation: float
    mu_init: float
    bound_push: float
    max_iter: int


@dataclass(eq=False)
class Iterates:
    """The b instances that have not ended: `rows` of the batch.

    y (b, k) are x and slacks, lam (b, ng), z (b, 2, k) the multipliers of lower and upper bounds,
    f (b,), g (b, ng), mu and shift (b,) the barrier parameter and the last regularisation.
    """

    rows: IntArray
    y: FloatArray
    lam: FloatArray
    z: FloatArray
    f: FloatArray
    g: FloatArray
    mu: FloatArray
    shift: FloatArray
    bounds: Bounds
    filter: Filter

    def __getitem__(self, keep: BoolArray) -> Iterates:
        return Iterates(*(getattr(self, field.name)[keep] for field in fields(self)))

    @classmethod
    def start(cls, problems: NumericProblems, instances: Instances, options: Options) -> Iterates:
        """The initial guesses, moved inside their bounds."""
        rows = np.arange(len(instances))
        mu = np.full(rows.size, options.mu_init)
        box = Bounds.of(instances.lbx, instances.ubx)
        x = np.clip(instances.x0, instances.lbx, instances.ubx)
        x = box.inside(x, options.bound_push)
        f, g = problems.evaluate(rows, x)
        lower = np.hstack([instances.lbx, instances.lbg])
        bounds = Bounds.of(lower, np.hstack([instances.ubx, instances.ubg]))
        y = np.where(bounds.fixed, lower, bounds.inside(np.hstack([x, g]), options.bound_push))
        z = mu[:, None, None] / bounds.gaps(y)
        lam = (z[:, 1] - z[:, 0])[:, x.shape[1] :]
        violation = abs(g - y[:, x.shape[1] :]).sum(axis=1)
        return cls(rows, y, lam, z, f, g, mu, np.zeros(rows.size), bounds, Filter.empty(violation))


@dataclass(frozen=True, eq=False)
class Residuals:
    """Residuals of the optimality conditions at b iterates.

    Parameters
    ----------
    gradient : (b, k)
        Of f + lam' (g - s), in x and s.
    dual, primal : (b, k), (b, ng)
        Of the first and of the third equation.
    products : (b, 2, k)
        Multipliers times gaps, NaN where there is no bound.
    scale : (b,)
        What dual residuals and products are relative to.
    """

    gradient: FloatArray
    dual: FloatArray
    primal: FloatArray
    products: FloatArray
    scale: FloatArray

    @classmethod
    def of(cls, at: Linearisation, iterates: Iterates) -> Residuals:
        """Residuals of some iterates, linearised there."""
        z, lam, fixed = iterates.z, iterates.lam, iterates.bounds.fixed
        gradient = np.hstack([at.gradient + at.transposed_times(lam), -lam])
        dual = np.where(fixed, 0.0, gradient - z[:, 0] + z[:, 1])
        gaps = iterates.bounds.gaps(iterates.y)
        products = np.multiply(z, gaps, out=np.full(z.shape, np.nan), where=np.isfinite(gaps))
        total = abs(lam).sum(axis=1) + z.sum(axis=(1, 2))
        mean = total / (lam.shape[1] + 2 * z.shape[2])
        primal = iterates.g - iterates.y[:, at.gradient.shape[1] :]
        return cls(gradient, dual, primal, products, np.maximum(_LARGE, mean) / _LARGE)

    def error(self, mu: FloatArray | float) -> FloatArray:
        """Largest residual (b,) of the equations with barrier parameters mu."""
        away = abs(self.products - np.reshape(mu, (-1, 1, 1)))
        complementarity = np.fmax.reduce(away, axis=(1, 2), initial=0.0)
        dual = abs(self.dual).max(axis=1, initial=0.0)
        return np.asarray(
            np.maximum(np.maximum(dual, complementarity) / self.scale, self.violation)
        )

    @property
    def violation(self) -> FloatArray:
        """Largest entries (b,) of g - s."""
        return np.asarray(abs(self.primal).max(axis=1, initial=0.0))


@dataclass(eq=False)
class Results:
    """Answers to B instances: x (B, nx), multipliers of bounds and of g, status, counts."""

    x: FloatArray
    lam_x: FloatArray
    lam_g: FloatArray
    status: list[Status]
    message: list[str]
    iterations: IntArray
    evaluations: IntArray

    @classmethod
    def empty(cls, instances: Instances) -> Results:
        """Before the first iteration."""
        size = len(instances)
        return cls(
            instances.x0.copy(),
            np.zeros_like(instances.x0),
            np.zeros_like(instances.lbg),
            [Status.ITERATION_LIMIT] * size,
            ["maximum number of iterations"] * size,
            np.zeros(size, np.int64),
            np.ones(size, np.int64),
        )

    def end(self, rows: IntArray, status: Status, message: str) -> None:
        """Note how some instances end."""
        for row in rows.tolist():
            self.status[row], self.message[row] = status, message

    def conclude(self, iterates: Iterates, residuals: Residuals, options: Options) -> BoolArray:
        """Note which iterates are solutions, or not finite; return which (b,)."""
        error, violation = residuals.error(0.0), residuals.violation
        solved = (error <= options.tolerance) & (violation <= options.violation)
        self.end(iterates.rows[solved], Status.SOLVED, "solved")
        broken = ~np.isfinite(error)
        self.end(iterates.rows[broken], Status.FAILED, "a function or derivative is not finite")
        return np.asarray(solved | broken)

    def keep(self, iterates: Iterates) -> None:
        """Write the iterates of the instances that end."""
        rows, size = iterates.rows, self.x.shape[1]
        self.x[rows] = iterates.y[:, :size]
        self.lam_x[rows] = (iterates.z[:, 1] - iterates.z[:, 0])[:, :size]
        self.lam_g[rows] = iterates.lam


def reduce_mu(iterates: Iterates, residuals: Residuals, least: float) -> None:
    """Reduce the barrier parameters of those whose barrier problem is solved."""
    while True:
        mu = iterates.mu
        solved = (mu > least) & (residuals.error(mu) <= _SOLVED * mu)
        if not solved.any():
            return
        smaller = np.maximum(least, np.minimum(0.2 * mu, mu**1.5))
        iterates.mu = np.where(solved, smaller, mu)
        iterates.filter.clear(solved)
