"""A step of the interior-point method: Newton's direction, and the search along it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ....typing import BoolArray, FloatArray, IntArray
from .filter import LineSearch
from .iterates import Iterates, Residuals
from .newton import CondensedSystems
from .problems import Linearisation, NumericProblems

_SHORTEST = 1e-10  # step length, relative to the first, at which a search ends


def advance(
    problems: NumericProblems,
    at: Linearisation,
    iterates: Iterates,
    residuals: Residuals,
    active: BoolArray,
) -> tuple[BoolArray, IntArray]:
    """Move active iterates by one step: whether each moved, and its number of evaluations."""
    from .step_kernels import barrier_terms

    y, bounds, size = iterates.y, iterates.bounds, at.gradient.shape[1]
    barrier, weights = np.empty_like(y), np.empty_like(y)
    limits = bounds.lower, bounds.upper, bounds.fixed
    barrier_terms((y, iterates.z, iterates.mu), limits, size, barrier, weights)
    gradient = np.where(bounds.fixed, 0.0, residuals.gradient + barrier)
    systems = CondensedSystems(at, weights, gradient, bounds.fixed)
    shifts = systems.factorise(iterates.lam, iterates.shift)
    iterates.shift = np.where(shifts > 0.0, shifts, iterates.shift)
    step, multipliers = systems.direction(residuals.primal)
    barrier[:, :size] += at.gradient
    line = LineSearch(
        iterates.filter,
        abs(residuals.primal).sum(axis=1),
        iterates.f + iterates.mu * bounds.log_barrier(iterates.y),
        np.where(bounds.fixed, 0.0, barrier * step).sum(axis=1),
    )
    search = Search(problems, iterates, line, systems, residuals.primal)
    moved, evaluations = search.run(step, np.flatnonzero(active & np.isfinite(shifts)))
    search.finish(step, multipliers, moved)
    return moved, evaluations


@dataclass(eq=False)
class Trial:
    """Trial points of some instances, `rows`: y, f, g, and what the filter compares."""

    rows: IntArray
    y: FloatArray
    f: FloatArray
    g: FloatArray
    violation: FloatArray
    merit: FloatArray
    accepted: BoolArray

    def replace(self, at: IntArray, other: Trial) -> None:
        """Take over the accepted points of another trial, whose instances are those `at` here."""
        for name in ("y", "f", "g", "violation", "merit", "accepted"):
            getattr(self, name)[at[other.accepted]] = getattr(other, name)[other.accepted]


@dataclass(eq=False)
class Search:
    """The line search of all instances, which halves steps until the filter accepts a point.

    Parameters
    ----------
    problems : NumericProblems
    iterates : Iterates
    line : LineSearch
    systems : CondensedSystems
    primal : (b, ng)
        g - s at the iterates.
    """

    problems: NumericProblems
    iterates: Iterates
    line: LineSearch
    systems: CondensedSystems
    primal: FloatArray

    def __post_init__(self) -> None:
        now = self.iterates
        self.new = now.y.copy(), now.f.copy(), now.g.copy()
        self.keep = np.minimum(0.01, now.mu)
        self.length = np.ones(len(now.mu))

    def run(self, step: FloatArray, rows: IntArray) -> tuple[BoolArray, IntArray]:
        """Search for some instances: whether each has moved, and its number of evaluations."""
        now, bounds = self.iterates, self.iterates.bounds
        self.length = first = bounds.longest_step(now.y, step, self.keep)
        moved, evaluations = np.zeros(first.size, bool), np.zeros(first.size, np.int64)
        initial = True
        while rows.size:
            trial = self._trial(rows, now.y[rows] + self.length[rows, None] * step[rows])
            evaluations[rows] += 1
            if initial:
                evaluations += self._correct(trial, step)
                initial = False
            done = trial.accepted
            for target, values in zip(self.new, (trial.y, trial.f, trial.g), strict=True):
                target[rows[done]] = values[done]
            moved[rows[done]] = True
            self.line.remember(rows[done], self.length[rows[done]], trial.merit[done])
            rows = rows[~done]
            self.length = np.where(moved, self.length, 0.5 * self.length)
            rows = rows[self.length[rows] > _SHORTEST * first[rows]]
        return moved, evaluations

    def _trial(self, rows: IntArray, y: FloatArray) -> Trial:
        size, now = self.systems.at.gradient.shape[1], self.iterates
        f, g = self.problems.evaluate(now.rows[rows], y[:, :size])
        violation = abs(g - y[:, size:]).sum(axis=1)
        merit = f + now.mu[rows] * now.bounds[rows].log_barrier(y)
        accepted = self.line.accepts(rows, self.length[rows], violation, merit)
        return Trial(rows, y, f, g, violation, merit, accepted)

    def _correct(self, trial: Trial, step: FloatArray) -> IntArray:
        """Second-order corrections of first steps that do not reduce the violation."""
        evaluations = np.zeros(len(step), np.int64)
        worse = trial.violation >= self.line.violation[trial.rows]
        at = np.flatnonzero(~trial.accepted & worse & np.isfinite(trial.violation))
        if at.size:
            rows, size = trial.rows[at], self.systems.at.gradient.shape[1]
            primal = self.primal.copy()
            beyond = trial.g[at] - trial.y[at, size:]
            primal[rows] = self.length[rows, None] * primal[rows] + beyond
            corrected, _ = self.systems.direction(primal)
            y = self.iterates.y
            length = self.iterates.bounds.longest_step(y, corrected, self.keep)
            points = y[rows] + length[rows, None] * corrected[rows]
            trial.replace(at, self._trial(rows, points))
            evaluations[rows] = 1
        return evaluations

    def finish(self, step: FloatArray, multipliers: FloatArray, moved: BoolArray) -> None:
        """Move the multipliers of the instances that have moved, and write all new values."""
        from .step_kernels import move_multipliers

        now, limits = self.iterates, (self.iterates.bounds.lower, self.iterates.bounds.upper)
        y, f, g = self.new
        move_multipliers((now.y, y, now.mu), limits, step, self.keep, moved, now.z)
        now.lam = now.lam + np.where(moved, self.length, 0.0)[:, None] * multipliers
        now.y, now.f, now.g = y, f, g
