"""A primal-dual interior-point method with a filter line search, over batches of instances.

Minimise f(x) subject to lbx <= x <= ubx and lbg <= g(x) <= ubg. Every row of g has a slack s, so
that bounds l <= y <= u are those of y = (x, s), and g(x) - s = 0. For barrier parameters mu that
decrease to zero, Newton's method solves

    grad f + J' lam - z_l + z_u = 0  (of x),   -lam - z_l + z_u = 0  (of s),   g(x) - s = 0,
    z_l (y - l) = mu,   z_u (u - y) = mu.

Each instance has a barrier parameter, a step length and a regularisation of its own. Some of a
batch advance together; those that end make room for others, and no answer depends on the others.
The method, and constants that are not explained, are those of A. Waechter and
L. T. Biegler, On the implementation of an interior-point filter line-search algorithm for
large-scale nonlinear programming, Math. Program. 106(1), 2006, with a restoration phase of its own
(`restoration`). `scaling` poses the instances in units in which their gradients are neither large
nor small. Instances that end without a solution near the constraints are solved again with relaxed
bounds: the feasible sets of complementarity constraints have no interior otherwise.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from ...nlp.program import Instances
from ...nlp.solution import Status
from ...typing import FloatArray, IntArray
from .derivatives import Problems
from .iterate_kernels import LANES
from .iterates import (
    Iterates,
    Options,
    Residuals,
    Results,
    reduce_mu,
    relaxed_bounds,
    wrong_bounds,
)
from .restoration import restore
from .steps import advance, estimate_multipliers
from .warm_start import warm_start

_REFILL = 0.75  # of the width: below it, others are started
_NONE = np.arange(0)
Recorder = Callable[[FloatArray], object]
_INFEASIBLE = "the constraints may be infeasible"
_LATE = "not solved within time_limit; allow more"


def minimise(
    problems: Problems,
    instances: Instances,
    options: Options,
    width: int,
    record: Recorder | None = None,
) -> Results:
    """Solve every instance, at most `width` at the same time.

    `record` is called with the points x (n, b) of every iteration, but not of restoration.
    """
    results, wrong = Results.empty(instances, options.max_iter), wrong_bounds(instances)
    for row, message in wrong.items():
        results.end(np.array([row]), Status.FAILED, message)
    rows = np.setdiff1d(np.arange(len(instances)), list(wrong))
    _solve(problems, instances, rows, results, options, width, record)
    more = options.restoration & (results.iterations < options.max_iter) & (not options.late)
    again = np.flatnonzero(results.degenerate & more)
    if again.size:
        results.end(again, Status.ITERATION_LIMIT, results.limit)
        relaxed = relaxed_bounds(instances, options.constraint_tolerance)
        _solve(problems, relaxed, again, results, options, width, record)
        solved = [row for row in again.tolist() if results.status[row].success]
        results.end(np.array(solved, int), Status.SOLVED, "solved with relaxed bounds")
    return results


def _solve(
    problems: Problems,
    instances: Instances,
    waiting: IntArray,
    results: Results,
    options: Options,
    width: int,
    record: Recorder | None,
) -> None:
    """Solve some instances, and write their results."""
    iterates = _started(problems, instances, waiting[:width], options)
    stuck, waiting = iterates[_NONE], waiting[width:]
    while iterates.rows.size or stuck.rows.size:
        if options.late:
            left = iterates.joined(stuck)
            results.end(np.append(left.rows, waiting), Status.TIME_LIMIT, _LATE)
            results.keep(left, np.zeros_like(left.y))
            return
        if stuck.rows.size >= LANES or not iterates.rows.size:
            iterates = iterates.joined(_restored(problems, stuck, results, options))
            stuck = stuck[_NONE]
            continue
        if record is not None:
            record(iterates.y[: iterates.size])
        iterates, more = _iterate(problems, iterates, results, options)
        stuck = stuck.joined(more) if more.rows.size else stuck
        free = width - iterates.rows.size - stuck.rows.size
        if waiting.size and free >= (1 - _REFILL) * width:
            new = _started(problems, instances, waiting[:free], options)
            iterates, waiting = iterates.joined(new), waiting[free:]


def _started(
    problems: Problems, instances: Instances, rows: IntArray, options: Options
) -> Iterates:
    """Iterates at the initial guesses of some instances."""
    new = Iterates.start(problems, instances, rows, options)
    estimate_multipliers(problems, new, options.constr_mult_init_max)
    warm_start(problems, instances, new, options)
    return new


def _iterate(
    problems: Problems, iterates: Iterates, results: Results, options: Options
) -> tuple[Iterates, Iterates]:
    """One iteration: the iterates that go on, and those that need restoration."""
    rows = iterates.rows
    at = problems.linearise(rows, iterates.y[: iterates.size])
    residuals = Residuals.of(at, iterates)
    ended = results.conclude(iterates, residuals, options)
    ended |= results.iterations[rows] >= options.max_iter
    stuck = np.zeros_like(ended)
    if not ended.all():
        reduce_mu(iterates, residuals, options)
        moved, evaluations = advance(problems, at, iterates, residuals, ~ended)
        results.evaluations[rows] += evaluations
        results.iterations[rows] += ~ended
        stuck = ~(ended | moved)
        if stuck.any():
            stuck &= ~iterates.widen(stuck)
        failed = stuck & ~(
            options.restoration & (iterates.violation > options.constraint_tolerance)
        )
        results.fail(iterates, failed, "the line search found no better point")
        ended, stuck = ended | failed, stuck & ~failed
    if not (ended | stuck).any():
        return iterates, iterates[_NONE]
    results.keep(iterates[ended], residuals.gradient[:, ended])
    return iterates[~(ended | stuck)], iterates[stuck]


def _restored(problems: Problems, stuck: Iterates, results: Results, options: Options) -> Iterates:
    """Restore stuck iterates: return those with a smaller violation, and end the others."""
    restored, iterations = restore(problems, stuck, options)
    results.iterations[stuck.rows] += iterations
    failed = stuck[~restored]
    for lane, violation in enumerate(failed.violation):
        message = f"{_INFEASIBLE}: the sum of violations was not reduced below {violation:.3g}"
        results.fail(failed, np.array([lane]), message)
    results.keep(failed, np.zeros_like(failed.y))
    again = stuck[restored]
    estimate_multipliers(problems, again, options.constr_mult_init_max)
    return again
