"""Restoration: where the line search finds no better point, the violation is reduced first.

For the iterates of some instances, Gauss-Newton steps with a line search reduce

    |r(x)|^2 / 2 - nu sum log(gaps of x),

where r = g(x) - s, and s is the point nearest to g(x) that is well inside the bounds of g, until
the violation is well below that of the beginning, and the filter accepts the point. Where that is
not reached, any point that the filter accepts with a violation clearly below will do.
"""

from __future__ import annotations

import numpy as np

from ...typing import BoolArray, FloatArray, IntArray
from .derivatives import Condensation, Problems
from .iterate_kernels import FIXED, slopes
from .iterates import Iterates, Options
from .steps import first_accepted, lengths_to_try

_ENOUGH = 0.1  # of the violation, at which the method goes on
_LESS = 0.9  # likewise, where that is not reached: the required reduction of Ipopt's restoration
_BARRIER = 1e-2  # of the sum of squares, at most, for nu
_PUSH = 1e-2  # relative distance of slacks to their bounds
_MAX_ITER, _HALVINGS = 100, 30
_SLOW, _SMALLER = 30, 1e-4  # iterations after which nu falls with the sum of squares, to that
_ARMIJO, _KEEP = 1e-4, 0.01


def restore(problems: Problems, iterates: Iterates, options: Options) -> tuple[BoolArray, IntArray]:
    """Move iterates to points that their filters accept.

    Multipliers start there as at an initial guess.

    Returns
    -------
    restored : (b,) bool
        Which iterates have such a point.
    iterations : (b,) int
    """
    before = iterates.violation
    iterates.filter.add(before, iterates.merit)
    iterates.move(np.arange(before.size), _point(iterates, iterates.y, iterates.f, iterates.g))
    nu = np.minimum(iterates.mu, _BARRIER * _squares(iterates, 0.0))
    restored, left = np.zeros(before.size, bool), np.arange(before.size)
    iterations = np.zeros(before.size, np.int64)
    for iteration in range(_MAX_ITER):
        now = iterates[left]
        if iteration >= _SLOW:
            nu[left] = np.minimum(nu[left], _SMALLER * _squares(now, 0.0))
        moved = _advance(problems, now, nu[left])
        iterations[left] += 1
        iterates.move(left, (now.y, now.f, now.g, now.barrier))
        fewer = now.violation <= _ENOUGH * before[left]
        accepted = fewer & now.filter.accepts(now.violation, now.merit)
        restored[left[accepted]] = True
        left = left[moved & ~accepted]
        if not left.size or options.late:
            break
    less = iterates.violation <= _LESS * before
    restored |= less & iterates.filter.accepts(iterates.violation, iterates.merit)
    iterates.start_multipliers()
    return restored, iterations


def _point(
    now: Iterates, x: FloatArray, f: FloatArray, g: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """y, f, g and barrier at points whose first rows are x, with the nearest slacks."""
    nearest = now.bounds.inside(np.vstack([x[: now.size], g]), _PUSH)
    y = np.where(now.bounds.fixed, now.y, nearest)
    y[: now.size] = x[: now.size]
    return y, f, g, now.bounds.log_barrier(y)


def _squares(now: Iterates, nu: FloatArray | float) -> FloatArray:
    """The function that is reduced, (b,)."""
    r = now.g - now.y[now.size :]
    squares = products(r, r)
    box = now.bounds.part(slice(now.size))
    return np.asarray(0.5 * squares + nu * box.log_barrier(now.y[: now.size]))


def _advance(problems: Problems, now: Iterates, nu: FloatArray) -> BoolArray:
    """One step of every iterate: whether each has moved."""
    x, box = now.y[: now.size], now.bounds.part(slice(now.size))
    step, slope = _direction(problems, now, nu)
    length = box.longest_step(x, step, np.full(nu.size, _KEEP))
    before, left = _squares(now, nu), np.flatnonzero(slope < 0.0)
    moved, halved, tries = np.zeros(nu.size, bool), 0, np.arange(1)
    while left.size and halved < _HALVINGS:
        tries = tries[: _HALVINGS - halved]
        some, lengths = left.repeat(tries.size), np.outer(length[left], 0.5**tries).ravel()
        trial = now[some]
        ends = x.take(some, 1) + lengths * step.take(some, 1)
        new = _point(trial, ends, *problems.evaluate(trial.rows, ends))
        trial.move(np.arange(some.size), new)
        better = _squares(trial, nu[some]) <= before[some] + _ARMIJO * lengths * slope[some]
        better &= np.isfinite(trial.merit)
        done, at = first_accepted(better, tries.size)
        now.move(left[done], tuple(values[..., at] for values in new))
        moved[left[done]] = True
        length[left] *= 0.5**tries.size
        left, halved = left[~done], halved + tries.size
        tries = lengths_to_try(problems, left.size)
    return moved


def _direction(problems: Problems, now: Iterates, nu: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Gauss-Newton's steps of x (n, b), and the slopes (b,) of the function along them."""
    x, box = now.y[: now.size], now.bounds.part(slice(now.size))
    at = problems.linearise(now.rows, x)
    below, above = 1.0 / box.gaps(x)
    r = now.g - now.y[now.size :]
    ascent = nu * (above - below) + at.transposed_times(r)
    ascent[box.fixed] = 0.0
    near = np.sqrt(nu) / np.maximum(1.0, x**2)  # keeps steps short, as in Ipopt's restoration
    of_x = np.where(box.fixed, FIXED, nu * (below**2 + above**2) + near)
    weights = np.vstack([of_x, r != 0.0])
    factors = at.factors(Condensation(np.zeros_like(r), weights, 0.0), np.zeros(nu.size))
    step = np.where(box.fixed, 0.0, factors.solve(-ascent))
    return step, products(ascent, step)


def products(one: FloatArray, two: FloatArray) -> FloatArray:
    """Sums (b,) of products of entries (k, b), added in the same order for any b."""
    out = np.empty(one.shape[1])
    slopes(one, two, out)
    return out
