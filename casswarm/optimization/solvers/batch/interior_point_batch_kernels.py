"""Batches of states for the barrier method: starts, units, verdicts; Python that Numba compiles.

`casswarm._util.jit` joins this text with `casswarm.optimization.solvers.batch.interior_point_kernels` and what that needs.
"""

# mypy: ignore-errors
import math

import numpy as np

if "compiled" not in globals():
    from casswarm.optimization.feasible_sets.planar_kernels import compiled
    from casswarm.optimization.feasible_sets.trajectory_kernels import add_pulled, longest, slacks
    from casswarm.optimization.solvers.batch.interior_point_kernels import (
        NO_INSIDE,
        NOT_FINITE,
        clear,
        copy,
        gather,
        minimise,
        residuals,
        total,
    )

FIRST = 1e-2  # barrier parameter at the beginning, in units of the objective
COARSE = 1e-4  # barrier parameter at which starts are compared
KEPT = 0.1  # part of every slack that is kept on the way to a start


@compiled
def in_units(who, before, centers, radii, limits):
    """The limits of the members `who` as `path_core` has them: velocities in units of the first."""
    k, steps = who.size, radii.shape[1]
    began, middle, wide = np.empty((k, 2)), np.empty((k, steps, 2)), np.empty((k, steps))
    for a in range(k):
        for axis in range(2):
            began[a, axis] = before[who[a], axis] / limits[0]
        for s in range(steps):
            for axis in range(2):
                middle[a, s, axis] = centers[who[a], s, axis] / limits[0]
            wide[a, s] = (radii[who[a], s] / limits[0]) ** 2
    return began, (limits[1] / limits[0]) ** 2, middle, wide


@compiled
def take(u, who, speed, y):
    """Write the paths of the members `who` from u (H, 2n)."""
    k = who.size
    for s in range(u.shape[0]):
        for a in range(k):
            for axis in range(2):
                y[2 * (s * k + a) + axis] = u[s, 2 * who[a] + axis] / speed


@compiled
def approach(inside, guess, path, slack, way):
    """Move every member's path in `guess` towards `inside`, until its slacks are well above zero.

    The limits are a product over members: one who can move little does not hold the others.
    """
    began, square, middle, wide = path
    members, steps = wide.shape
    slacks(inside, began, square, middle, wide, slack)
    for a in range(members):
        clear(way)
        for s in range(steps):
            for axis in range(2):
                c = 2 * (s * members + a) + axis
                way[c] = guess[c] - inside[c]
        reach = longest(inside, way, 1.0 - KEPT, slack, began, middle, members, steps)
        for s in range(steps):
            for axis in range(2):
                c = 2 * (s * members + a) + axis
                guess[c] = inside[c] + reach * way[c]


@compiled
def judge(u, z, who, path, p, shared, units, scratch):
    """f, violation and residual of an answer, anew, in units; nothing of a solve enters.

    The violation is a distance; the residual is the larger of stationarity and complementarity.
    """
    before, square, centers, squares = path
    members, steps = squares.shape
    gradients, slack = np.empty((steps, u.shape[1])), np.empty(z.size)
    y, pulled = np.empty(z.size // 3), np.empty(z.size // 3)
    take(u, who, units[0], y)
    value = total(y, u, who, p, shared, units, gradients, scratch)
    slacks(y, before, square, centers, squares, slack)
    gather(gradients, who, units, pulled)
    add_pulled(y, z, before, centers, members, steps, pulled)
    violation, least = 0.0, 0.0
    for row in range(z.size):
        least = min(least, z[row])
        if slack[row] < 0.0:
            bound = 0.0
            if row % 6 == 4:
                bound = math.sqrt(square)
            elif row % 6 == 5:
                bound = math.sqrt(squares[row // 6 % members, row // (6 * members)])
            out = math.sqrt(bound * bound - slack[row]) - bound if row % 6 > 3 else -slack[row]
            violation = max(violation, out)
    largest, apart = residuals(pulled, z, slack, 0.0)
    if not (math.isfinite(value) and math.isfinite(largest)) or least < 0.0:
        return value * units[1], math.inf, math.nan
    return value * units[1], violation, max(largest, apart)


@compiled
def minimise_state(
    u, starts, who, path, p, shared, unit, finest, tolerance, iterations, scratch, z, counts
):
    """Solve a state from every start (S, H, 2n), with multipliers z: how it ended.

    `u` (H, 2n) begins strictly inside, and ends as the answer.
    """
    tries, size = starts.shape[0], z.size // 3
    inside, y, best, way = np.empty(size), np.empty(size), np.empty(size), np.empty(size)
    slack, best_z = np.empty(z.size), np.zeros(z.size)
    take(u, who, unit[0], inside)
    copy(inside, best)
    least, how = math.inf, NO_INSIDE
    if not slacks(inside, path[0], path[1], path[2], path[3], slack) > 0.0:
        return how
    for t in range(tries + 1 if tries > 1 else 1):
        rough = t < tries and tries > 1
        if t < tries:
            take(starts[t], who, unit[0], y)
            approach(inside, y, path, slack, way)
            clear(z)
        else:
            copy(best, y)
            copy(best_z, z)
        begin = max(FIRST if t < tries else COARSE, finest)
        end = max(COARSE, finest) if rough else finest
        close = max(COARSE, tolerance) if rough else tolerance
        f, how = minimise(
            y, z, u, who, path, p, shared, unit, begin, end, close, iterations, scratch, counts
        )
        if not rough or (how != NOT_FINITE and f < least):
            least = f
            copy(y, best)
            copy(z, best_z)
    copy(best, y)
    copy(best_z, z)
    for s in range(u.shape[0]):
        for a in range(who.size):
            for axis in range(2):
                u[s, 2 * who[a] + axis] = unit[0] * best[2 * (s * who.size + a) + axis]
    return how


@compiled
def minimise_batch(
    first,
    last,
    starts,
    insides,
    free,
    before,
    limits,
    centers,
    radii,
    parameters,
    shared,
    units,
    finest,
    tolerance,
    iterations,
    x,
    multipliers,
    judged,
    outcome,
    counts,
):
    """Solve the states `first` to `last` - 1 from every start (B, S, H, 2n), and judge the answers.

    `insides` (B, H, 2n) are strictly within the limits; what is not free is kept. `limits` are the
    bounds of a velocity's components and of its change; units (B, 2) those of x, the first of the
    limits, and of f. Writes x (B, H, 2n), multipliers (B, H, n, 6), judged (B, 3): f, violation,
    residual; outcome (B,); counts (B, 2).
    """
    steps, n = x.shape[1], free.shape[1]
    scratch = np.empty(n * (n + 8))
    for state in range(first, last):
        who, u = np.flatnonzero(free[state]), x[state]
        path = in_units(who, before[state], centers[state], radii[state], limits)
        z, unit, p = np.zeros(6 * who.size * steps), units[state], parameters[state]
        for s in range(steps):
            for c in range(2 * n):
                u[s, c] = insides[state, s, c]
        outcome[state] = minimise_state(
            u,
            starts[state],
            who,
            path,
            p,
            shared,
            unit,
            finest,
            tolerance,
            iterations,
            scratch,
            z,
            counts[state],
        )
        judged[state, 0], judged[state, 1], judged[state, 2] = judge(
            u, z, who, path, p, shared, unit, scratch
        )
        for s in range(steps):
            for a in range(who.size):
                for row in range(6):
                    multipliers[state, s, who[a], row] = z[6 * (s * who.size + a) + row]
