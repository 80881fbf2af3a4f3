"""A primal-dual interior-point method with a filter line search, over batches of instances.

Minimise f(x) subject to lbx <= x <= ubx and lbg <= g(x) <= ubg. Every row of g has a slack s, so
that bounds l <= y <= u are those of y = (x, s), and g(x) - s = 0. For barrier parameters mu that
decrease to zero, Newton's method solves

    grad f + J' lam - z_l + z_u = 0  (of x),   -lam - z_l + z_u = 0  (of s),   g(x) - s = 0,
    z_l (y - l) = mu,   z_u (u - y) = mu.

Each instance has a barrier parameter, a step length and a regularisation of its own; those that end
leave the batch. The method, and constants that are not explained, are those of A. Waechter and
L. T. Biegler, On the implementation of an interior-point filter line-search algorithm for
large-scale nonlinear programming, Math. Program. 106(1), 2006, without scaling and restoration.
"""

from __future__ import annotations

from ...problem import Instances
from ...solution import Status
from .iterates import Iterates, Options, Residuals, Results, reduce_mu
from .problems import NumericProblems
from .step import advance


def minimise(problems: NumericProblems, instances: Instances, options: Options) -> Results:
    """Solve every instance."""
    iterates = Iterates.start(problems, instances, options)
    results = Results.empty(instances)
    size = instances.x0.shape[1]
    for iteration in range(options.max_iter + 1):
        at = problems.linearise(iterates.rows, iterates.y[:, :size])
        residuals = Residuals.of(at, iterates)
        results.iterations[iterates.rows] = iteration
        ended = results.conclude(iterates, residuals, options)
        if iteration < options.max_iter and not ended.all():
            reduce_mu(iterates, residuals, options.tolerance / 10.0)
            moved, evaluations = advance(problems, at, iterates, residuals, ~ended)
            results.evaluations[iterates.rows] += evaluations
            stuck = ~(ended | moved)
            results.end(
                iterates.rows[stuck], Status.FAILED, "the line search found no better point"
            )
            ended |= stuck
        else:
            ended[:] = True
        results.keep(iterates[ended])
        iterates = iterates[~ended]
        if not iterates.rows.size:
            break
    return results
