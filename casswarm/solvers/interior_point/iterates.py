"""The state of the interior-point method: iterates with their bounds, the filter, and results."""

from __future__ import annotations

import math
import time
from dataclasses import dataclass, replace
from typing import Self

import numpy as np
from typing_extensions import override

from ...nlp.program import Instances
from ...nlp.solution import Status
from ...typing import BoolArray, FloatArray, IntArray
from . import iterate_kernels as kernels
from .derivatives import Linearisation, Problems

INFINITE = 1e19
"""Size from which a bound is none."""

DIVERGENT = 1e4
"""Size of multipliers, in the method's units, that may not exist."""

_EQUAL, _NEAR = 1e-9, 1e-12  # width of bounds that count as equal, absolute and relative
_RELAXED = 1e-8  # of bounds, relative to those above 1: Ipopt's bound_relax_factor
_NEARLY_FEASIBLE = 1e-4  # sum of violations up to which a failure may be one of thin feasible sets
_MORE = 15  # iterations at a solution for `Options.accuracy`
_DIVERGED = 1e10  # of what residuals are relative to: multipliers of which no digit is left


def are_equal(lower: FloatArray, upper: FloatArray) -> BoolArray:
    """Mask of the bounds that are equal up to an allowed error."""
    finite = np.isfinite(lower) & np.isfinite(upper)
    width = np.subtract(upper, lower, out=np.full_like(lower, np.inf), where=finite)
    return np.asarray(width <= np.maximum(_EQUAL, _NEAR * abs(lower)), bool) & finite


def middle(lower: FloatArray, upper: FloatArray, where: BoolArray) -> FloatArray:
    """Midpoints of some intervals, and zeros elsewhere."""
    width = np.subtract(upper, lower, out=np.zeros_like(lower), where=where)
    return np.add(lower, 0.5 * width, out=np.zeros_like(lower), where=where)


def wrong_bounds(instances: Instances) -> dict[int, str]:
    """Messages, by row, on instances with inconsistent bounds: no number is between them."""
    wrong: dict[int, str] = {}
    for low, high in (("lbx", "ubx"), ("lbg", "ubg")):
        lower, upper = getattr(instances, low), getattr(instances, high)
        crossed = ~(lower <= upper) | (lower == np.inf) | (upper == -np.inf)
        for row, k in zip(*np.nonzero(crossed), strict=True):
            text = f"nothing is between {low}[{k}] = {lower[row, k]:g} and {high}[{k}] = "
            wrong.setdefault(int(row), f"{text}{upper[row, k]:g}")
    return wrong


def relaxed_bounds(instances: Instances, largest: float) -> Instances:
    """Relax bounds that are not equal as Ipopt does, by up to `largest`.

    Sets without an interior, such as those of complementarity constraints, have one then.
    """
    relaxed = {}
    for low, high in (("lbx", "ubx"), ("lbg", "ubg")):
        lower, upper = getattr(instances, low), getattr(instances, high)
        free = ~are_equal(lower, upper)
        for name, bound, sign in ((low, lower, -1.0), (high, upper, 1.0)):
            width = np.minimum(largest, _RELAXED * np.maximum(1.0, abs(bound)))
            relaxed[name] = np.where(free, bound + sign * width, bound)
    return replace(instances, **relaxed)


class Lanes:
    """Records of arrays, or of such records, whose last axis are instances."""

    def take(self, places: IntArray, axis: int = -1) -> Self:
        """The records of some instances, like `numpy.ndarray.take`."""
        return type(self)(*(part.take(places, axis) for part in vars(self).values()))

    def joined(self, other: Self) -> Self:
        """These records, then those of another batch."""
        pairs = zip(vars(self).values(), vars(other).values(), strict=True)
        return type(self)(
            *(
                one.joined(two) if isinstance(one, Lanes) else np.concatenate([one, two], -1)
                for one, two in pairs
            )
        )


@dataclass(frozen=True, eq=False)
class Bounds(Lanes):
    """Bounds of b vectors y = (x, s), with k entries each.

    Parameters
    ----------
    lower, upper : (k, b)
        Infinite where there are none, and where the entry is fixed.
    fixed : (k, b) bool
        Whether both bounds are equal, or nearly so: the entry stays between them.
    """

    lower: FloatArray
    upper: FloatArray
    fixed: BoolArray

    @classmethod
    def of(cls, lower: FloatArray, upper: FloatArray) -> Bounds:
        """Bounds from arrays in which those of a fixed entry are nearly equal.

        Those of 1e19 and more are infinite, as for Ipopt.
        """
        lower = np.where(lower <= -INFINITE, -np.inf, lower)
        upper = np.where(upper >= INFINITE, np.inf, upper)
        fixed = are_equal(lower, upper)
        return cls(np.where(fixed, -np.inf, lower), np.where(fixed, np.inf, upper), fixed)

    def part(self, entries: slice) -> Bounds:
        """Bounds of some of the entries of all vectors."""
        return Bounds(self.lower[entries], self.upper[entries], self.fixed[entries])

    def inside(self, y: FloatArray, push: float) -> FloatArray:
        """Points moved inside, by `push` relative to a bound, or to the width where it is less."""
        with np.errstate(invalid="ignore"):
            width = push * (self.upper - self.lower)
        below, above = (
            np.where(np.isinf(bound), 0.0, np.fmin(push * np.maximum(1.0, abs(bound)), width))
            for bound in (self.lower, self.upper)
        )
        return np.clip(y, self.lower + below, self.upper - above)

    def gaps(self, y: FloatArray) -> FloatArray:
        """Distances to both bounds, (2, k, b); infinite where there is none."""
        gaps = np.empty((2, *y.shape))
        np.subtract(y, self.lower, out=gaps[0])
        np.subtract(self.upper, y, out=gaps[1])
        return gaps

    def log_barrier(self, y: FloatArray) -> FloatArray:
        """Minus the sum of the logarithms of all gaps, (b,); NaN at and beyond the bounds."""
        barrier = np.empty(y.shape[1])
        kernels.log_barrier(y, self.lower, self.upper, np.empty((2, y.shape[1])), barrier)
        return barrier

    def longest_step(self, y: FloatArray, step: FloatArray, keep: FloatArray) -> FloatArray:
        """Largest lengths (b,) up to 1 after which every gap keeps a fraction `keep` (b,)."""
        length = np.empty(len(keep))
        kernels.longest_steps((y, step), (self.lower, self.upper), keep, length)
        return length


_ROOM = 8  # entries of a new filter


@dataclass(eq=False)
class Filter(Lanes):
    """Pairs of constraint violation and barrier function that no later step may reach, b times.

    Parameters
    ----------
    entries : (2, m, b)
    numbers : (b,) int
        How many of the entries are there.
    scale : (b,)
        Violation at the beginning, at least 1.
    """

    entries: FloatArray
    numbers: IntArray
    scale: FloatArray

    @classmethod
    def empty(cls, violation: FloatArray) -> Filter:
        """Filters without entries, from the violations (b,) at the beginning."""
        size = len(violation)
        scale = np.maximum(1.0, violation)
        return cls(np.zeros((2, _ROOM, size)), np.zeros(size, np.int64), scale)

    @override
    def joined(self, other: Filter) -> Filter:
        size = max(self.entries.shape[1], other.entries.shape[1])
        self.entries, other.entries = self._wide(size), other._wide(size)
        return super().joined(other)

    def make_room(self) -> None:
        """Have a place for one more entry in every filter."""
        room = self.entries.shape[1]
        if self.numbers.max(initial=0) == room:
            self.entries = self._wide(2 * room)

    def add(self, violation: FloatArray, merit: FloatArray) -> None:
        """Add a point to every filter."""
        self.make_room()
        kernels.add_entries(self.entries, self.numbers, violation, merit)

    def accepts(self, violation: FloatArray, merit: FloatArray) -> BoolArray:
        """Mask (b,) of the filters that accept points (b,)."""
        there = np.arange(self.entries.shape[1])[:, None] < self.numbers
        reached = (violation >= self.entries[0]) & (merit >= self.entries[1]) & there
        return np.asarray(~reached.any(axis=0) & np.isfinite(merit))

    def clear(self, rows: BoolArray) -> None:
        """Forget all entries of some filters, for a new barrier function."""
        self.numbers[rows] = 0

    def _wide(self, size: int) -> FloatArray:
        return np.pad(self.entries, ((0, 0), (0, size - self.entries.shape[1]), (0, 0)))


@dataclass(frozen=True)
class Options:
    """Tolerances and start of the method.

    Parameters
    ----------
    tolerance : float
        Of the optimality conditions, relative to large multipliers.
    constraint_tolerance : float
        Largest violation of the constraints, absolute.
    mu_init, bound_push : float
        Initial barrier parameter, and relative distance by which x0 is moved inside its bounds.
    max_iter : int
    accuracy : (B,)
        Residuals of the optimality conditions, absolute, for which the method goes on for some
        iterations at a solution within `tolerance`.
    constr_mult_init_max : float
        Largest initial multiplier of g that is estimated by least squares.
    restoration : bool
        Whether, where the line search finds no better point, the violation is reduced first, or the
        instance is solved with relaxed bounds.
    deadline : float
        Of `time.perf_counter`, in seconds.
    """

    tolerance: float
    constraint_tolerance: float
    mu_init: float
    bound_push: float
    max_iter: int
    accuracy: FloatArray
    constr_mult_init_max: float = 1000.0
    restoration: bool = True
    deadline: float = math.inf

    @property
    def late(self) -> bool:
        """Whether the time is over."""
        return time.perf_counter() > self.deadline


@dataclass(eq=False)
class Iterates(Lanes):
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
        return self.take(np.arange(self.rows.size)[keep])

    @property
    def size(self) -> int:
        """Number of variables x."""
        return len(self.y) - len(self.g)

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
        moved, limits = some.copy(), (self.bounds.lower, self.bounds.upper)
        kernels.widen((self.y, self.z, self.mu), limits, moved)
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
        See `iterate_kernels.residuals`.
    """

    gradient: FloatArray
    primal: FloatArray
    largest: FloatArray

    @classmethod
    def of(cls, at: Linearisation, iterates: Iterates) -> Residuals:
        """Residuals of some iterates, linearised there."""
        y, z, lam, bounds = iterates.y, iterates.z, iterates.lam, iterates.bounds
        gradient, primal, largest = np.empty_like(y), np.empty_like(lam), np.empty((5, y.shape[1]))
        limits = bounds.lower, bounds.upper, bounds.fixed
        terms = at.gradient, at.transposed_times(lam), iterates.g
        kernels.residuals((y, z, lam), limits, terms, (gradient, primal), largest)
        return cls(gradient, primal, largest)

    @property
    def error(self) -> FloatArray:
        """Largest residual (b,) of the optimality conditions."""
        violation, scale = self.largest[3:]
        return np.asarray(np.maximum(self.absolute / scale, violation))

    @property
    def absolute(self) -> FloatArray:
        """Largest residual (b,) of stationarity and complementarity, whatever the multipliers."""
        dual, least, most = self.largest[:3]
        return np.asarray(np.maximum(dual, np.maximum(most, -least)))

    @property
    def violation(self) -> FloatArray:
        """Largest entries (b,) of g - s."""
        return np.asarray(self.largest[3])


@dataclass(eq=False)
class Results:
    """Answers to B instances: x (B, nx), multipliers of bounds and of g, status, counts.

    `degenerate` (B,) are those that failed near the constraints, `near` (B,) are numbers of
    iterations at solutions that are not accurate; `limit` is the message of those that end at the
    limit of iterations.
    """

    x: FloatArray
    lam_x: FloatArray
    lam_g: FloatArray
    status: list[Status]
    message: list[str]
    iterations: IntArray
    evaluations: IntArray
    degenerate: BoolArray
    near: IntArray
    limit: str

    @classmethod
    def empty(cls, instances: Instances, max_iter: int) -> Results:
        """Before the first iteration."""
        size, limit = len(instances), f"not solved in max_iter = {max_iter} iterations; allow more"
        return cls(
            instances.x0.copy(),
            np.zeros_like(instances.x0),
            np.zeros_like(instances.lbg),
            [Status.ITERATION_LIMIT] * size,
            [limit] * size,
            np.zeros(size, np.int64),
            np.ones(size, np.int64),
            np.zeros(size, bool),
            np.zeros(size, np.int64),
            limit,
        )

    def end(self, rows: IntArray, status: Status, message: str) -> None:
        """Note how some instances end."""
        for row in rows.tolist():
            self.status[row], self.message[row] = status, message

    def fail(self, iterates: Iterates, some: BoolArray | IntArray, message: str) -> None:
        """Note that some iterates end without a solution, and which are near the constraints."""
        rows = iterates.rows[some]
        self.end(rows, Status.FAILED, message)
        self.degenerate[rows] = iterates.violation[some] <= _NEARLY_FEASIBLE

    def conclude(self, iterates: Iterates, residuals: Residuals, options: Options) -> BoolArray:
        """Note which iterates are solutions, not finite, or have diverged; return which (b,)."""
        error, violation = residuals.error, residuals.violation
        solved = (error <= options.tolerance) & (violation <= options.constraint_tolerance)
        rows, multipliers = iterates.rows, abs(iterates.lam).max(axis=0, initial=0.0)
        inaccurate = np.maximum(residuals.absolute, violation * multipliers)
        more = solved & (inaccurate > options.accuracy[rows]) & (multipliers <= DIVERGENT)
        self.near[rows] = np.where(more, self.near[rows] + 1, 0)
        solved &= self.near[rows] % (_MORE + 1) == 0
        self.end(iterates.rows[solved], Status.SOLVED, "solved")
        broken = ~np.isfinite(error)
        self.end(iterates.rows[broken], Status.FAILED, "a function or derivative is not finite")
        diverged = ~(solved | broken) & (residuals.largest[4] > _DIVERGED) & options.restoration
        message = "the multipliers diverge: a constraint qualification may fail"
        self.fail(iterates, diverged, message)
        return np.asarray(solved | broken | diverged)

    def keep(self, iterates: Iterates, gradient: FloatArray) -> None:
        """Write the iterates of the instances that end, solved if they are within the tolerance.

        The multiplier of a fixed variable balances the `gradient` (k, b) of f + lam' (g - s).
        """
        rows, size = iterates.rows, iterates.size
        near = rows[self.near[rows] > 0]
        self.end(near, Status.SOLVED, "solved")
        self.degenerate[near] = False
        self.x[rows] = iterates.y[:size].T
        multipliers = iterates.z[1] - iterates.z[0]
        multipliers = np.where(iterates.bounds.fixed, -gradient, multipliers)
        self.lam_x[rows] = multipliers[:size].T
        self.lam_g[rows] = iterates.lam.T


def violations(g: FloatArray, y: FloatArray) -> FloatArray:
    """Sums (b,) of |g - s|, added in the same order for any b."""
    out = np.empty(g.shape[1])
    kernels.violations(g, y, out)
    return out


def reduce_mu(iterates: Iterates, residuals: Residuals, options: Options) -> None:
    """Reduce the barrier parameters of those whose barrier problem is solved."""
    reduced = np.empty(iterates.mu.size, bool)
    least = np.minimum(options.tolerance, options.accuracy[iterates.rows]) / 10.0
    kernels.reduce_mu(residuals.largest, least, iterates.mu, reduced)
    iterates.filter.clear(reduced)
