"""A primal-dual barrier method for paths within limits: plain Python that Numba compiles.

Minimise sum over steps s of evaluate(u_s; p_s) over paths u that keep the limits of
`casswarm.optimization.feasible_sets.trajectory_kernels`. ``evaluate(x, p, shared, gradient, scratch)`` returns a step's objective for
the places x (2n,) of all n members and writes its gradient. The limits are convex and have an
inside, and every iterate is strictly within them. A step is the Newton step of the primal-dual
equations, condensed to a banded matrix, made shorter until no slack shrinks too much and the
barrier function decreases. Where the limits cut it, it is bent along the curvature of their discs
first, for which the same factor serves; without that, iterates zigzag between thin slivers of
discs. Where the matrix is not positive definite, a multiple of the identity is added.

A step's block of the objective's Hessian is taken from differences of gradients: the places of a
step enter no other step's objective. `casswarm._util.jit` joins this text with `casswarm.optimization.feasible_sets.trajectory_kernels`
and that of an objective.
"""

# mypy: ignore-errors
import math

import numpy as np

if "compiled" not in globals():
    from casswarm.optimization.feasible_sets.planar_kernels import compiled
    from casswarm.optimization.feasible_sets.trajectory_kernels import (
        add_curvature,
        add_pulled,
        bends,
        factor,
        longest,
        pushed,
        slacks,
        solve,
    )

DIFFERENCE = 1e-7  # length of the gradient's differences
SUFFICIENT = 1e-4  # decrease, as a part of what the slope promises
TRIALS = 40  # of a step's length
CONVERGED, EXHAUSTED, STALLED, NOT_FINITE, NO_INSIDE = 0, 1, 2, 3, 4


@compiled
def copy(source, target):
    """As slices would, which take Numba seconds to compile for the sake of their error message."""
    for c in range(source.size):
        target[c] = source[c]


@compiled
def copy_rows(source, target):
    """The same of a matrix."""
    for r in range(source.shape[0]):
        for c in range(source.shape[1]):
            target[r, c] = source[r, c]


@compiled
def clear(target):
    """Write zeros."""
    for c in range(target.size):
        target[c] = 0.0


@compiled
def clear_rows(target):
    """Write zeros into a matrix."""
    for r in range(target.shape[0]):
        for c in range(target.shape[1]):
            target[r, c] = 0.0


@compiled
def total(y, u, who, p, shared, units, gradients, scratch):
    """Objective at y in units, with the places u (H, 2n) and gradients (H, 2n) written."""
    members, value = who.size, 0.0
    for s in range(u.shape[0]):
        for a in range(members):
            c = 2 * (s * members + a)
            u[s, 2 * who[a]] = units[0] * y[c]
            u[s, 2 * who[a] + 1] = units[0] * y[c + 1]
        value += evaluate(u[s], p[min(s, p.shape[0] - 1)], shared, gradients[s], scratch)
    return value / units[1]


@compiled
def gather(gradients, who, units, out):
    """Write the gradient with respect to y, in units."""
    members = who.size
    for s in range(gradients.shape[0]):
        for a in range(members):
            for axis in range(2):
                pull = gradients[s, 2 * who[a] + axis]
                out[2 * (s * members + a) + axis] = pull * units[0] / units[1]


@compiled
def add_hessian(u, who, p, shared, units, gradients, band, block, changed, scratch):
    """Add the objective's Hessian, in units, to the band; `block` (2k, 2k) is overwritten."""
    size, last = 2 * who.size, band.shape[1] - 1
    short = DIFFERENCE * units[0]
    factor_ = units[0] * units[0] / (units[1] * short)
    for s in range(u.shape[0]):
        for c in range(size):
            place = 2 * who[c // 2] + c % 2
            kept = u[s, place]
            u[s, place] = kept + short
            evaluate(u[s], p[min(s, p.shape[0] - 1)], shared, changed, scratch)
            u[s, place] = kept
            for r in range(size):
                row = 2 * who[r // 2] + r % 2
                block[r, c] = (changed[row] - gradients[s, row]) * factor_
        for r in range(size):
            for c in range(r + 1):
                band[s * size + r, last + c - r] += 0.5 * (block[r, c] + block[c, r])


@compiled
def barrier(value, slack, mu):
    """The barrier function."""
    for row in range(slack.size):
        if slack[row] < math.inf:
            value -= mu * math.log(slack[row])
    return value


@compiled
def shrinking(slack, slack_then):
    """The largest part that a slack has lost; 2 where one is not a number."""
    largest = 0.0
    for row in range(slack.size):
        if slack[row] < math.inf:
            lost = 1.0 - slack_then[row] / slack[row]
            largest = max(largest, lost if lost <= 2.0 else 2.0)
    return largest


@compiled
def residuals(pulled, z, slack, mu):
    """Largest components of the Lagrangian's gradient, and of z slack - mu."""
    largest, apart = 0.0, 0.0
    for c in range(pulled.size):
        largest = max(largest, abs(pulled[c]))
    for row in range(z.size):
        if slack[row] < math.inf:
            apart = max(apart, abs(z[row] * slack[row] - mu))
    return largest, apart


@compiled
def newton_direction(pulled, band, kept, ridge, step):
    """Write the step that `band` gives for `pulled`: the ridge that it took, negative for none."""
    most = 0.0
    for r in range(band.shape[0]):
        most = max(most, abs(band[r, band.shape[1] - 1]))
    copy_rows(band, kept)
    add = 0.0
    for _ in range(30):
        if factor(band):
            for c in range(step.size):
                step[c] = -pulled[c]
            solve(band, step)
            return add
        add = max(ridge / 3.0, 2.0**-48 * most, 1e-8) if add == 0.0 else 8.0 * add
        copy_rows(kept, band)
        for r in range(band.shape[0]):
            band[r, band.shape[1] - 1] += add
    return -1.0


@compiled
def minimise(
    y, z, u, who, path, p, shared, units, mu, finest, tolerance, iterations, scratch, counts
):
    """Improve `y`, strictly inside, in place, with multipliers z: (f, outcome).

    The barrier parameter goes from `mu` to `finest`; multipliers that are 0 begin at mu / slack.
    `path` holds before, square, centers, squares of `casswarm.optimization.feasible_sets.trajectory_kernels`; counts: steps and
    evaluations.
    """
    before, square, centers, squares = path
    members, steps = squares.shape
    size = y.size
    slack, slack_then, pull, push = np.empty((4, 3 * size))
    gradient, pulled, step, trial, bent = np.empty((5, size))
    band, kept = np.empty((2, size, 4 * members + 2))
    gradients, changed = np.empty((steps, u.shape[1])), np.empty(u.shape[1])
    block = np.empty((2 * members, 2 * members))
    if not slacks(y, before, square, centers, squares, slack) > 0.0:
        return math.nan, NO_INSIDE
    ridge = 0.0
    for row in range(z.size):
        if z[row] == 0.0:
            z[row] = mu / slack[row]
    value = total(y, u, who, p, shared, units, gradients, scratch)
    counts[1] += 1
    for _ in range(iterations):
        gather(gradients, who, units, gradient)
        copy(gradient, pulled)
        add_pulled(y, z, before, centers, members, steps, pulled)
        if not (math.isfinite(value) and math.isfinite(residuals(pulled, z, slack, 0.0)[0])):
            return value, NOT_FINITE
        largest, apart = residuals(pulled, z, slack, mu)
        while mu > finest and largest <= max(10.0 * mu, tolerance) and apart <= 10.0 * mu:
            mu = max(finest, min(0.2 * mu, mu**1.5))
            apart = residuals(pulled, z, slack, mu)[1]
        if mu <= finest and largest <= tolerance and apart <= 10.0 * mu:
            return value, CONVERGED
        for row in range(z.size):
            pull[row] = mu / slack[row]
        copy(gradient, pulled)
        add_pulled(y, pull, before, centers, members, steps, pulled)
        clear_rows(band)
        add_hessian(u, who, p, shared, units, gradients, band, block, changed, scratch)
        counts[1] += 2 * members
        add_curvature(y, z, slack, before, centers, members, steps, band)
        ridge = newton_direction(pulled, band, kept, ridge, step)
        if ridge < 0.0:
            return value, NOT_FINITE
        slope = 0.0
        for c in range(size):
            slope += pulled[c] * step[c]
        counts[0] += 1
        part = max(0.99, 1.0 - mu)
        length = longest(y, step, part, slack, before, centers, members, steps)
        clear(bent)
        if length < 1.0:  # perhaps for the discs' curvature only: follow it
            bends(step, members, steps, push)
            for row in range(z.size):
                push[row] *= z[row] / slack[row]
            add_pulled(y, push, before, centers, members, steps, bent)
            for c in range(size):
                bent[c] = -bent[c]
            solve(band, bent)
            length = 1.0
        now, accepted = barrier(value, slack, mu), False
        for _trial in range(TRIALS):
            for c in range(size):
                trial[c] = y[c] + length * (step[c] + length * bent[c])
            slacks(trial, before, square, centers, squares, slack_then)
            if shrinking(slack, slack_then) <= part:
                value_then = total(trial, u, who, p, shared, units, gradients, scratch)
                counts[1] += 1
                then = barrier(value_then, slack_then, mu)
                if then <= now + SUFFICIENT * length * slope + 2.0**-46 * abs(now):
                    accepted = True
                    break
            length *= 0.6
        if not accepted:
            total(y, u, who, p, shared, units, gradients, scratch)
            return value, STALLED
        pushed(y, step, before, centers, members, steps, push)
        copy(trial, y)
        value = value_then
        move_multipliers(z, slack, slack_then, push, mu, part)
        copy(slack_then, slack)
    return value, EXHAUSTED


@compiled
def move_multipliers(z, slack, slack_then, push, mu, part):
    """The Newton step of the multipliers, as far as they stay positive, and near mu / slack."""
    length = 1.0
    for row in range(z.size):
        if slack[row] < math.inf:
            dz = (mu + z[row] * push[row]) / slack[row] - z[row]
            if dz < 0.0 and -length * dz > part * z[row]:
                length = -part * z[row] / dz
    for row in range(z.size):
        if slack[row] < math.inf:
            dz = (mu + z[row] * push[row]) / slack[row] - z[row]
            ideal = mu / slack_then[row]
            z[row] = min(max(z[row] + length * dz, 1e-10 * ideal), 1e10 * ideal)
        else:
            z[row] = 0.0
