"""A primal-dual barrier method for paths within limits: plain Python that Numba compiles.

Minimise sum over steps s of evaluate(u_s; p_s) over paths u that keep the limits of
`casswarm.path_core`. ``evaluate(x, p, shared, gradient, scratch)`` returns a step's objective for the
places x (2n,) of all n members and writes its gradient. Every iterate is strictly inside the limits
(which are convex and have an inside), so a step is the Newton step of the primal-dual equations,
condensed to a banded matrix, cut where a slack would shrink too much, and halved until the barrier
function decreases. Where the matrix is not positive definite, a multiple of the identity is added.

A step's block of the objective's Hessian is taken from differences of gradients: the places of a
step enter no other step's objective. `casswarm.compiling` joins this text with `casswarm.path_core`
and that of an objective.
"""

# mypy: ignore-errors
import math

import numpy as np

if "compiled" not in globals():
    from casswarm.path_core import add_curvature, add_pulled, factor, longest, pushed, slacks, solve
    from casswarm.planar_core import compiled

FIRST = 1e-2  # barrier parameter at the beginning, in units of the objective
COARSE = 1e-4  # barrier parameter at which starts are compared
KEPT = 0.1  # part of every slack that is kept on the way to a start
DIFFERENCE = 1e-6  # length of the gradient's differences
SUFFICIENT = 1e-4  # decrease, as a part of what the slope promises
TRIALS = 40  # of a step's length
CONVERGED, EXHAUSTED, STALLED, NOT_FINITE, NO_INSIDE = 0, 1, 2, 3, 4


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
    kept[:] = band
    add = 0.0
    for _ in range(30):
        if factor(band):
            for c in range(step.size):
                step[c] = -pulled[c]
            solve(band, step)
            return add
        add = max(ridge / 3.0, 1e-10 * most, 1e-8) if add == 0.0 else 8.0 * add
        band[:] = kept
        for r in range(band.shape[0]):
            band[r, band.shape[1] - 1] += add
    return -1.0


@compiled
def minimise(y, z, u, who, path, p, shared, units, finest, tolerance, iterations, scratch, counts):
    """Improve `y`, strictly inside, in place, and write multipliers z: (f, outcome).

    `path` holds before, square, centers, squares of `casswarm.path_core`. counts: steps, evaluations.
    """
    before, square, centers, squares = path
    members, steps = squares.shape
    size = y.size
    slack, slack_then, pull, push = np.empty((4, 3 * size))
    gradient, pulled, step, trial = np.empty((4, size))
    band, kept = np.empty((2, size, 4 * members + 2))
    gradients, changed = np.empty((steps, u.shape[1])), np.empty(u.shape[1])
    block = np.empty((2 * members, 2 * members))
    if not slacks(y, before, square, centers, squares, slack) > 0.0:
        return math.nan, NO_INSIDE
    mu, ridge = max(FIRST, finest), 0.0
    for row in range(z.size):
        z[row] = mu / slack[row]
    value = total(y, u, who, p, shared, units, gradients, scratch)
    counts[1] += 1
    for _ in range(iterations):
        gather(gradients, who, units, gradient)
        pulled[:] = gradient
        add_pulled(y, z, before, centers, members, steps, pulled)
        if not (math.isfinite(value) and math.isfinite(residuals(pulled, z, slack, 0.0)[0])):
            return value, NOT_FINITE
        largest, apart = residuals(pulled, z, slack, mu)
        while mu > finest and max(largest, apart) <= 10.0 * mu:
            mu = max(finest, min(0.2 * mu, mu**1.5))
            apart = residuals(pulled, z, slack, mu)[1]
        if mu <= finest and largest <= tolerance and apart <= 10.0 * mu:
            return value, CONVERGED
        for row in range(z.size):
            pull[row] = mu / slack[row]
        pulled[:] = gradient
        add_pulled(y, pull, before, centers, members, steps, pulled)
        band[:] = 0.0
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
        now, accepted = barrier(value, slack, mu), False
        pushed(y, step, before, centers, members, steps, push)
        for _trial in range(TRIALS):
            for c in range(size):
                trial[c] = y[c] + length * step[c]
            if slacks(trial, before, square, centers, squares, slack_then) > 0.0:
                value_then = total(trial, u, who, p, shared, units, gradients, scratch)
                counts[1] += 1
                then = barrier(value_then, slack_then, mu)
                if then <= now + SUFFICIENT * length * slope + 2.0**-46 * abs(now):
                    accepted = True
                    break
            length *= 0.5
        if not accepted:
            total(y, u, who, p, shared, units, gradients, scratch)
            return value, STALLED
        y[:], value = trial, value_then
        move_multipliers(z, slack, slack_then, push, mu, part)
        slack[:] = slack_then
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


@compiled
def judge(y, z, u, who, path, p, shared, units, scratch):
    """f, violation and residual of an answer, anew, in units; nothing of a solve enters.

    The violation is a distance; the residual is the larger of stationarity and complementarity.
    """
    before, square, centers, squares = path
    members, steps = squares.shape
    gradients, slack, pulled = np.empty((steps, u.shape[1])), np.empty(z.size), np.empty(y.size)
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
    """Solve the states `first` to `last` - 1 from every start (S, B, H, 2n), and judge the answers.

    `insides` (B, H, 2n) are strictly within the limits; what is not free is kept. `limits` are the
    bounds of a velocity's components and of its change. Writes x (B, H, 2n), multipliers
    (B, H, n, 6), judged (B, 3): f, violation, residual; outcome (B,); counts (B, 2).
    """
    steps, n = x.shape[1], free.shape[1]
    scratch = np.empty(n * (n + 8))
    square = (limits[1] / limits[0]) ** 2
    for state in range(first, last):
        who = np.flatnonzero(free[state])
        k, unit, p = who.size, units[state], parameters[state]
        began, middle, wide = np.empty((k, 2)), np.empty((k, steps, 2)), np.empty((k, steps))
        inside, guess, slack = (
            np.empty(2 * k * steps),
            np.empty(2 * k * steps),
            np.empty(6 * k * steps),
        )
        for a in range(k):
            for axis in range(2):
                began[a, axis] = before[state, who[a], axis] / unit[0]
            for s in range(steps):
                for axis in range(2):
                    middle[a, s, axis] = centers[state, who[a], s, axis] / unit[0]
                    inside[2 * (s * k + a) + axis] = insides[state, s, 2 * who[a] + axis] / unit[0]
                wide[a, s] = (radii[state, who[a], s] / unit[0]) ** 2
        path = (began, square, middle, wide)
        u = insides[state].copy()
        y, best = np.empty(inside.size), inside.copy()
        z, best_z = np.zeros(slack.size), np.zeros(slack.size)
        least, how = math.inf, NO_INSIDE
        tries = starts.shape[0]
        found = slacks(inside, began, square, middle, wide, slack) > 0.0
        for t in range(tries + (tries > 1) if found else 0):
            if t < tries:
                for a in range(k):
                    for s in range(steps):
                        for axis in range(2):
                            c = 2 * (s * k + a) + axis
                            guess[c] = starts[t, state, s, 2 * who[a] + axis] / unit[0] - inside[c]
                slacks(inside, began, square, middle, wide, slack)
                reach = longest(inside, guess, 1.0 - KEPT, slack, began, middle, k, steps)
                for c in range(y.size):
                    y[c] = inside[c] + reach * guess[c]
            else:
                y[:] = best
            rough = tries > 1 and t < tries
            f, how = minimise(
                y,
                z,
                u,
                who,
                path,
                p,
                shared,
                unit,
                max(COARSE, finest) if rough else finest,
                max(COARSE, tolerance) if rough else tolerance,
                iterations,
                scratch,
                counts[state],
            )
            if not rough or (how != NOT_FINITE and f < least):
                least = f
                best[:], best_z[:] = y, z
        outcome[state] = how
        judged[state, 0], judged[state, 1], judged[state, 2] = judge(
            best, best_z, u, who, path, p, shared, unit, scratch
        )
        for s in range(steps):
            for c in range(2 * n):
                x[state, s, c] = u[s, c]
            for a in range(k):
                for row in range(6):
                    multipliers[state, s, who[a], row] = best_z[6 * (s * k + a) + row]
