"""A step of the interior-point method: Newton's direction, and the search along it.

Newton's equations of the interior-point method, condensed to the variables.

With ds = J dx + g - s and the bounds' weights sigma = z_l / (y - l) + z_u / (u - y) eliminated, the
matrix of dx is the Lagrangian's Hessian + diag(sigma_x) + J' diag(sigma_s) J. Where it is not
positive definite, a multiple of the identity is added.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from ...typing import BoolArray, FloatArray, IntArray
from .derivatives import Condensation, Linearisation, Problems
from .factors import Factors, tries_at_once
from .iterate_kernels import (
    EQUALITY,
    FIXED,
    KEEP,
    barrier_terms,
    condense,
    expand,
    judge,
    log_barrier,
    move_multipliers,
    remember,
    right_hand_sides,
    slopes,
    trial_points,
    violations,
)
from .iterates import Iterates, Residuals


@dataclass(eq=False)
class CondensedSystems:
    """The condensed equations of b instances, factorised.

    Parameters
    ----------
    at : Linearisation
    weights : (k, b)
        Weights of the bounds of x and s.
    gradient : (k, b)
        Gradients of the barrier function plus lam' (g - s), zero where y is fixed.
    fixed : (k, b) bool
    """

    at: Linearisation
    weights: FloatArray
    gradient: FloatArray
    fixed: BoolArray
    _factors: Factors = field(init=False)

    def factorise(
        self, multipliers: FloatArray, last: FloatArray, objective: float = 1.0
    ) -> FloatArray:
        """Factorise; return the shifts (b,) of the diagonals, NaN where none is enough.

        `last` are the shifts of the previous iteration that needed one; `objective` is the weight
        of f in the Hessian.
        """
        self._factors = self.at.factors(Condensation(multipliers, self.weights, objective), last)
        return self._factors.shifts

    def direction(self, primal: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Steps of y and lam that reduce g - s by `primal` (ng, b) to first order."""
        pull, right = np.empty_like(primal), np.empty_like(self.at.gradient)
        condense(self.weights, self.gradient, primal, pull)
        pulled = self.at.transposed_times(pull)
        right_hand_sides(self.gradient, pulled, self.fixed, right)
        dx = self._factors.solve(right)
        step, multipliers = np.empty_like(self.gradient), np.empty_like(primal)
        equations = self.weights, self.gradient, primal, self.fixed
        expand((dx, self.at.times(dx)), equations, step, multipliers)
        return step, multipliers


def estimate_multipliers(problems: Problems, iterates: Iterates, largest: float) -> None:
    """Let lam minimise the sum of squares of the Lagrangian's gradient, where it is not too large.

    Elsewhere it stays as it is, as in Ipopt (``constr_mult_init_max``).
    """
    if largest == 0.0 or not iterates.lam.size:
        return
    size, bounds = iterates.size, iterates.bounds
    at = problems.linearise(iterates.rows, iterates.y[:size])
    gradient = iterates.z[1] - iterates.z[0]
    gradient[:size] += at.gradient
    weights = np.ones_like(gradient)
    weights[size:][bounds.fixed[size:]] = EQUALITY
    weights[:size][bounds.fixed[:size]] = FIXED
    systems = CondensedSystems(at, weights, np.where(bounds.fixed, 0.0, gradient), bounds.fixed)
    none = np.zeros_like(iterates.lam)
    systems.factorise(none, np.zeros(iterates.mu.size), 0.0)
    _, lam = systems.direction(none)
    iterates.lam = np.where(abs(lam).max(axis=0) <= largest, lam, iterates.lam)


_SHORTEST = 1e-10  # step length, relative to the first, at which a search ends
_CORRECTIONS = 4  # of a step, at most
_REDUCED = 0.5  # of the violation, by a correction after which there is another


def advance(
    problems: Problems,
    at: Linearisation,
    iterates: Iterates,
    residuals: Residuals,
    active: BoolArray,
) -> tuple[BoolArray, IntArray]:
    """Move active iterates by one step: whether each moved, and its number of evaluations."""
    y, bounds = iterates.y, iterates.bounds
    weights, gradient, ascent = (np.empty_like(y) for _ in range(3))
    limits, gradients = (
        (bounds.lower, bounds.upper, bounds.fixed),
        (residuals.gradient, at.gradient),
    )
    barrier_terms((y, iterates.z, iterates.mu), limits, gradients, (weights, gradient, ascent))
    systems = CondensedSystems(at, weights, gradient, bounds.fixed)
    shifts = systems.factorise(iterates.lam, iterates.shift)
    iterates.shift = np.where(shifts > 0.0, shifts, iterates.shift)
    step, multipliers = systems.direction(residuals.primal)
    lines = np.empty((3, y.shape[1]))
    violations(iterates.g, y, lines[0])
    lines[1] = iterates.merit
    slopes(ascent, step, lines[2])
    search = Search(problems, iterates, lines, systems, residuals.primal)
    moved, evaluations = search.run(step, np.flatnonzero(active & np.isfinite(shifts)))
    search.finish(step, multipliers, moved)
    return moved, evaluations


def lengths_to_try(problems: Problems, count: int) -> IntArray:
    """Halvings of the steps of some instances that are tried at once, since lanes are free."""
    return np.arange(tries_at_once(problems.lanes, count))


def first_accepted(accepted: BoolArray, tries: int) -> tuple[BoolArray, IntArray]:
    """Which instances have a point that is accepted (r tries,), and the places of their first."""
    each = accepted.reshape(-1, tries)
    done = np.asarray(each.any(axis=1))
    return done, (tries * np.arange(len(each)) + each.argmax(axis=1))[done]


@dataclass(eq=False)
class Trial:
    """Trial points of some instances, `rows`: y, f, g, barrier, and what the filter compares."""

    rows: IntArray
    y: FloatArray
    f: FloatArray
    g: FloatArray
    barrier: FloatArray
    violation: FloatArray
    merit: FloatArray
    accepted: BoolArray

    def replace(self, at: IntArray, other: Trial) -> None:
        """Take over the accepted points of another trial, whose instances are those `at` here."""
        accepted = other.accepted
        for name in ("y", "f", "g", "barrier", "violation", "merit", "accepted"):
            getattr(self, name)[..., at[accepted]] = getattr(other, name)[..., accepted]


@dataclass(eq=False)
class Search:
    """The line search of all instances, which halves steps until the filter accepts a point.

    Parameters
    ----------
    problems : Problems
    iterates : Iterates
    lines : (3, b)
        Constraint violation and barrier function at the current points, and the slope of the
        barrier function along the steps.
    systems : CondensedSystems
    primal : (ng, b)
        g - s at the iterates.
    """

    problems: Problems
    iterates: Iterates
    lines: FloatArray
    systems: CondensedSystems
    primal: FloatArray

    def __post_init__(self) -> None:
        now = self.iterates
        self.new = now.y.copy(), now.f.copy(), now.g.copy(), now.barrier.copy()
        self.keep = np.minimum(KEEP, now.mu)
        self.limits = now.bounds.lower, now.bounds.upper
        now.filter.make_room()

    def run(self, step: FloatArray, rows: IntArray) -> tuple[BoolArray, IntArray]:
        """Search for some instances: whether each has moved, and its number of evaluations."""
        now = self.iterates
        first = now.bounds.longest_step(now.y, step, self.keep)
        self.length = first.copy()
        size, kept = len(first), now.filter
        moved, evaluations = np.zeros(size, bool), np.zeros(size, np.int64)
        halvings, initial = np.arange(1), True
        while rows.size:
            lengths = np.outer(self.length[rows], 0.5**halvings)
            short, each = lengths <= _SHORTEST * first[rows, None], lengths.ravel()
            trial = self._trial(rows.repeat(halvings.size), step, each, each)
            if initial:
                self._correct(trial, evaluations)
                initial = False
            done, at = first_accepted(trial.accepted & ~short.ravel(), halvings.size)
            evaluations[rows] += (~short).sum(axis=1)
            evaluations[rows[done]] += 1 + at % halvings.size - (~short[done]).sum(axis=1)
            ended, values = rows[done], (trial.y, trial.f, trial.g, trial.barrier)
            for target, value in zip(self.new, values, strict=True):
                target[..., ended] = value[..., at]
            moved[ended], self.length[ended] = True, each[at]
            entries = kept.entries, kept.numbers
            remember(ended, self.lines, entries, (each[at], trial.merit[at]))
            rows = rows[~done]
            self.length[rows] = 0.5 * lengths[~done, -1]
            rows = rows[self.length[rows] > _SHORTEST * first[rows]]
            halvings = lengths_to_try(self.problems, rows.size)
        return moved, evaluations

    def _trial(
        self, rows: IntArray, step: FloatArray, lengths: FloatArray, judged: FloatArray
    ) -> Trial:
        """Trial points after steps of some lengths (r,), accepted as if these were `judged`."""
        now, kept = self.iterates, self.iterates.filter
        y, lower, upper = (np.empty((len(now.y), rows.size)) for _ in range(3))
        barrier, violation, work = (
            np.empty(rows.size),
            np.empty(rows.size),
            np.empty((2, rows.size)),
        )
        trial_points(rows, (now.y, step, lengths), self.limits, (y, lower, upper))
        log_barrier(y, lower, upper, work, barrier)
        f, g = self.problems.evaluate(now.rows[rows], y[: now.size])
        violations(g, y, violation)
        merit, accepted = f + now.mu[rows] * barrier, np.empty(rows.size, bool)
        entries = kept.entries, kept.numbers, kept.scale
        judge(rows, self.lines, entries, (judged, violation, merit), accepted)
        return Trial(rows, y, f, g, barrier, violation, merit, accepted)

    def _correct(self, trial: Trial, evaluations: IntArray) -> None:
        """Second-order corrections of first steps that do not reduce the violation.

        Each is corrected again while that halves the violation.
        """
        now, primal, size = self.iterates, self.primal.copy(), self.iterates.size
        g, y, before = trial.g, trial.y, trial.violation
        worse = (before > 0.0) & (before >= self.lines[0, trial.rows])
        at = np.flatnonzero(~trial.accepted & worse & np.isfinite(before))
        rows, lengths = trial.rows[at], self.length[trial.rows[at]]
        g, y, before = g[:, at], y[:, at], before[at]
        for _ in range(_CORRECTIONS):
            if not at.size:
                return
            primal[:, rows] = lengths * primal[:, rows] + g - y[size:]
            corrected, _ = self.systems.direction(primal)
            lengths = now.bounds.longest_step(now.y, corrected, self.keep)[rows]
            new = self._trial(rows, corrected, lengths, self.length[rows])
            trial.replace(at, new)
            evaluations[rows] += 1
            more = ~new.accepted & (new.violation <= _REDUCED * before)
            at, rows, lengths = at[more], rows[more], lengths[more]
            g, y, before = new.g[:, more], new.y[:, more], new.violation[more]

    def finish(self, step: FloatArray, multipliers: FloatArray, moved: BoolArray) -> None:
        """Move the multipliers of the instances that have moved, and write all new values."""
        now, (y, f, g, barrier) = self.iterates, self.new
        work = np.empty_like(now.z), moved.astype(float)
        gaps = now.bounds.gaps(now.y), now.bounds.gaps(y)
        move_multipliers(gaps, now.mu, step, self.keep, work, now.z)
        now.lam = np.where(moved, now.lam + self.length * multipliers, now.lam)
        now.y, now.f, now.g, now.barrier = y, f, g, barrier
