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
large-scale nonlinear programming, Math. Program. 106(1), 2006, without scaling and restoration.
"""

from __future__ import annotations

import numpy as np

from ...problem import Instances
from ...solution import Status
from .iterates import Iterates, Options, Residuals, Results, reduce_mu
from .problems import Problems
from .step import advance

_REFILL = 0.75  # of the width: below it, others are started


def minimise(problems: Problems, instances: Instances, options: Options, width: int) -> Results:
    """Solve every instance, at most `width` at the same time."""
    results = Results.empty(instances)
    waiting = np.arange(len(instances))
    iterates = Iterates.start(problems, instances, waiting[:width], options)
    waiting = waiting[width:]
    while iterates.rows.size:
        rows = iterates.rows
        at = problems.linearise(rows, iterates.y[: iterates.size])
        residuals = Residuals.of(at, iterates)
        ended = results.conclude(iterates, residuals, options)
        ended |= results.iterations[rows] >= options.max_iter
        if not ended.all():
            reduce_mu(iterates, residuals, options.tolerance / 10.0)
            moved, evaluations = advance(problems, at, iterates, residuals, ~ended)
            results.evaluations[rows] += evaluations
            results.iterations[rows] += ~ended
            stuck = ~(ended | moved)
            results.end(rows[stuck], Status.FAILED, "the line search found no better point")
            ended |= stuck
        if not ended.any():
            continue
        results.keep(iterates[ended], residuals.gradient[:, ended])
        iterates = iterates[~ended]
        free = width - iterates.rows.size
        if waiting.size and free >= (1 - _REFILL) * width:
            new = Iterates.start(problems, instances, waiting[:free], options)
            iterates, waiting = iterates.joined(new), waiting[free:]
    return results
