"""The state of the interior-point method: iterates, their residuals, and results."""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Any

import numpy as np

from ....typing import BoolArray, FloatArray, IntArray
from ...problem import Instances
from ...solution import Status
from .bounds import Bounds, middle
from .filter import Filter
from .problems import Linearisation, Problems

_SOLVED = 10.0  # residual of a barrier problem that counts as solved, in units of mu


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
    constr_mult_init_max : float
        Largest initial multiplier of g that is estimated by least squares.
    restoration : bool
        Whether the violation is reduced first where the line search finds no better point.
    """

    tolerance: float
    violation: float
    mu_init: float
    bound_push: float
    max_iter: int
    constr_mult_init_max: float = 1000.0
    restoration: bool = True


@dataclass(eq=False)
class Iterates:
    """The b instances that have not ended: `rows` of the batch.

    y (k, b) are x and slacks, lam (ng, b), z (2, k, b) the multipliers of lower and upper bounds,
    f (b,), g (ng, b), mu and shift (b,) the barrier parameter and the last regularisation, barrier
    (b,) minus the sum of the logarithms of all gaps.
    """

    rows: IntArray
    y: FloatArray
    lam: FloatArray
    z: FloatArray
    f: FloatArray
    g: FloatArray
    mu: FloatArray
    shift: FloatArray
    barrier: FloatArray
    bounds: Bounds
    filter: Filter

    def __getitem__(self, keep: BoolArray | IntArray) -> Iterates:
        places = np.flatnonzero(keep) if keep.dtype == bool else keep
        return Iterates(*(getattr(self, field.name).take(places, -1) for field in fields(self)))

    @property
    def size(self) -> int:
        """Number of variables x."""
        return len(self.y) - len(self.g)

    def joined(self, other: Iterates) -> Iterates:
        """These iterates, then those of another batch."""
        parts: dict[str, Any] = {}
        for name in (field.name for field in fields(self)):
            one, two = getattr(self, name), getattr(other, name)
            together = isinstance(one, Bounds | Filter)
            parts[name] = one.joined(two) if together else np.concatenate([one, two], -1)
        return Iterates(**parts)

    @classmethod
    def start(
        cls, problems: Problems, every: Instances, rows: IntArray, options: Options
    ) -> Iterates:
        """The initial guesses of some instances, moved inside their bounds."""
        instances = every[rows]
        x0, lbx, ubx, lbg, ubg = (
            np.ascontiguousarray(getattr(instances, name).T)
            for name in ("x0", "lbx", "ubx", "lbg", "ubg")
        )
        mu = np.full(rows.size, options.mu_init)
        box = Bounds.of(lbx, ubx)
        x = box.inside(np.clip(x0, lbx, ubx), options.bound_push)
        x = np.where(box.fixed, middle(lbx, ubx, box.fixed), x)
        f, g = problems.evaluate(rows, x)
        lower, upper = np.vstack([lbx, lbg]), np.vstack([ubx, ubg])
        bounds = Bounds.of(lower, upper)
        y = bounds.inside(np.vstack([x, g]), options.bound_push)
        y = np.where(bounds.fixed, middle(lower, upper, bounds.fixed), y)
        filters = Filter.empty(violations(g, y))
        shift, barrier = np.zeros(rows.size), bounds.log_barrier(y)
        z, lam = np.empty((2, *y.shape)), np.empty_like(g)
        new = cls(rows, y, lam, z, f, g, mu, shift, barrier, bounds, filters)
        new.start_multipliers()
        return new

    def start_multipliers(self) -> None:
        """Let the multipliers be those of the barrier function, as at an initial guess."""
        self.z = self.mu / self.bounds.gaps(self.y)
        self.lam = (self.z[1] - self.z[0])[self.size :]

    @property
    def violation(self) -> FloatArray:
        """Sums (b,) of |g - s|."""
        return violations(self.g, self.y)

    @property
    def merit(self) -> FloatArray:
        """Barrier functions (b,)."""
        return self.f + self.mu * self.barrier

    def widen(self, some: BoolArray) -> BoolArray:
        """Move bounds of some instances of which only rounding error is left: whose were, (b,).

        Where more rows than variables are active, gaps vanish faster than the barrier parameter.
        """
        from .step_kernels import widen

        moved, limits = some.copy(), (self.bounds.lower, self.bounds.upper)
        widen((self.y, self.z, self.mu), limits, moved)
        self.barrier = np.where(moved, self.bounds.log_barrier(self.y), self.barrier)
        return moved

    def move(self, places: IntArray, new: tuple[FloatArray, ...]) -> None:
        """Replace y, f, g and barrier of some instances."""
        for values, moved in zip((self.y, self.f, self.g, self.barrier), new, strict=True):
            values[..., places] = moved


@dataclass(frozen=True, eq=False)
class Residuals:
    """Residuals of the optimality conditions at b iterates.

    Parameters
    ----------
    gradient : (k, b)
        Of f + lam' (g - s), in x and s.
    primal : (ng, b)
        g - s.
    largest : (5, b)
        See `step_kernels.residuals`.
    """

    gradient: FloatArray
    primal: FloatArray
    largest: FloatArray

    @classmethod
    def of(cls, at: Linearisation, iterates: Iterates) -> Residuals:
        """Residuals of some iterates, linearised there."""
        from .step_kernels import residuals

        y, z, lam, bounds = iterates.y, iterates.z, iterates.lam, iterates.bounds
        gradient, primal, largest = np.empty_like(y), np.empty_like(lam), np.empty((5, y.shape[1]))
        limits = bounds.lower, bounds.upper, bounds.fixed
        terms = at.gradient, at.transposed_times(lam), iterates.g
        residuals((y, z, lam), limits, terms, (gradient, primal), largest)
        return cls(gradient, primal, largest)

    def error(self, mu: FloatArray | float) -> FloatArray:
        """Largest residual (b,) of the equations with barrier parameters mu."""
        dual, least, most, violation, scale = self.largest
        complementarity = np.maximum(most - mu, mu - least)
        return np.asarray(np.maximum(np.maximum(dual, complementarity) / scale, violation))

    @property
    def violation(self) -> FloatArray:
        """Largest entries (b,) of g - s."""
        return np.asarray(self.largest[3])


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

    def keep(self, iterates: Iterates, gradient: FloatArray) -> None:
        """Write the iterates of the instances that end.

        The multiplier of a fixed variable balances the `gradient` (k, b) of f + lam' (g - s).
        """
        rows, size = iterates.rows, iterates.size
        self.x[rows] = iterates.y[:size].T
        multipliers = iterates.z[1] - iterates.z[0]
        multipliers = np.where(iterates.bounds.fixed, -gradient, multipliers)
        self.lam_x[rows] = multipliers[:size].T
        self.lam_g[rows] = iterates.lam.T


def violations(g: FloatArray, y: FloatArray) -> FloatArray:
    """Sums (b,) of |g - s|, added in the same order for any b."""
    from .search_kernels import violations as write

    out = np.empty(g.shape[1])
    write(g, y, out)
    return out


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
