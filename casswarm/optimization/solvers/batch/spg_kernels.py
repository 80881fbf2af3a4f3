"""The spectral projected gradient, state by state: plain Python that Numba compiles.

`casswarm._util.jit` joins this text with `casswarm.optimization.feasible_sets.planar_kernels`, `newton_core` and that of an
objective into one module, in which `compiled` is Numba's decorator and ``evaluate(x, p, shared,
gradient, scratch)`` returns f(x; p) and writes its gradient. Imported as it stands, nothing is
compiled, and the functions run on any such `evaluate`.
"""

# mypy: ignore-errors
import math

import numpy as np

if "compiled" not in globals():
    from casswarm.optimization.feasible_sets.planar_kernels import clip, compiled, excess, nearest
    from casswarm.optimization.solvers.batch.face_newton_kernels import (
        largest_of,
        longest_of,
        newton_step,
    )

MEMORY = 10  # objective values that the nonmonotone search looks back on
SUFFICIENT = 1e-4  # decrease, as a part of what the gradient promises
SHORTEST, LONGEST = 1e-10, 1e10  # spectral steps
OWN = 100.0  # how far a member's step may be from that of all, as a factor
PATIENCE = 4  # spectral steps before the first Newton step; doubled when one is refused
COARSE = 1e-3  # tolerance to which starts are compared
CONVERGED, EXHAUSTED, STALLED, NOT_FINITE = 0, 1, 2, 3


@compiled
def project(x, sets, out):
    """Nearest point of the product of sets (n, 10), into `out`."""
    for i in range(sets.shape[0]):
        px, py, found = nearest(x[2 * i], x[2 * i + 1], sets, i)
        if not found:  # a sliver as thin as rounding: keep to the box, and be judged
            px = clip(x[2 * i], sets[i, 0], sets[i, 2])
            py = clip(x[2 * i + 1], sets[i, 1], sets[i, 3])
        out[2 * i], out[2 * i + 1] = px, py


@compiled
def projected_step(x, gradient, steps, sets, direction):
    """Write P(x - steps gradient) - x into `direction`, a step a member; its slope."""
    slope = 0.0
    for i in range(sets.shape[0]):
        direction[2 * i] = x[2 * i] - steps[i] * gradient[2 * i]
        direction[2 * i + 1] = x[2 * i + 1] - steps[i] * gradient[2 * i + 1]
    project(direction, sets, direction)
    for i in range(sets.shape[0]):
        direction[2 * i] -= x[2 * i]
        direction[2 * i + 1] -= x[2 * i + 1]
        slope += direction[2 * i] * gradient[2 * i] + direction[2 * i + 1] * gradient[2 * i + 1]
    return slope


@compiled
def residual_bounds(direction, steps, metric):
    """Bounds on the longest member of P(x - metric gradient) - x, from the direction of `steps`.

    The length of a member's part grows with its step, and falls when divided by it.
    """
    low, high = 0.0, 0.0
    for i in range(direction.size // 2):
        dx, dy = direction[2 * i], direction[2 * i + 1]
        square, ratio = dx * dx + dy * dy, metric / steps[i]
        low = max(low, square * min(1.0, ratio * ratio))
        high = max(high, square * max(1.0, ratio * ratio))
    return math.sqrt(low), math.sqrt(high)


@compiled
def spectral_steps(moved, changed, metric, steps):
    """Write every member's step: its own inverse curvature, within a factor OWN of that of all.

    `moved` and `changed` are the differences of the last two points and gradients.
    """
    moves, curves = 0.0, 0.0
    for c in range(moved.size):
        moves += moved[c] * moved[c]
        curves += moved[c] * changed[c]
    common = moves / curves if curves > 0.0 else LONGEST * metric
    common = clip(common, SHORTEST * metric, LONGEST * metric)
    for i in range(steps.size):
        sx, sy = moved[2 * i], moved[2 * i + 1]
        move, curve = sx * sx + sy * sy, sx * changed[2 * i] + sy * changed[2 * i + 1]
        own = move / curve if curve > 0.0 else common
        steps[i] = clip(own, common / OWN, common * OWN)


@compiled
def copy(source, target):
    """As slices would, which take Numba seconds to compile for the sake of their error message."""
    for c in range(source.size):
        target[c] = source[c]


@compiled
def minimise(x, p, shared, units, sets, tolerance, iterations, work, face, scratch, counts):
    """Improve the feasible point `x` in place: (f, outcome); counts: steps, evaluations.

    SPG2 of Birgin, Martinez and Raydan (SIAM J. Optim. 10(4), 2000), which finds the face of the
    set that the minimum lies on, with Newton steps on that face (`newton_core`), in the manner of
    Birgin and Martinez (Comput. Optim. Appl. 23, 2002). Every member has a spectral step of its
    own: the set is a product over members, and in large swarms their curvatures differ by orders
    of magnitude. `work` (12, x.size) and `scratch` are overwritten; row 0 of `work` ends as the
    gradient at x.
    """
    gradient, direction, following, gradient_then = work[0], work[1], work[2], work[3]
    size = x.size
    steps = work[10, : size // 2]
    metric = units[0] * units[0] / units[1]
    f = evaluate(x, p, shared, gradient, scratch)
    counts[1] += 1
    history = work[11, :MEMORY] if size >= MEMORY else np.empty(MEMORY)
    history[:] = f
    patience, waited = PATIENCE, 0
    steps[:] = metric
    for iteration in range(iterations + 1):  # the first only finds the first step
        slope = projected_step(x, gradient, steps, sets, direction)
        if not (math.isfinite(f) and math.isfinite(slope)):
            return f, NOT_FINITE
        small = tolerance * units[0]
        low, high = residual_bounds(direction, steps, metric)
        if high <= small:
            return f, CONVERGED
        if low <= small:  # perhaps: look closer
            gradient_then[: size // 2] = metric
            projected_step(x, gradient, gradient_then[: size // 2], sets, following)
            if longest_of(following) <= small:
                return f, CONVERGED
        if iteration == 0:  # no curvature is known yet: a step of about one unit
            steps[:] = metric * units[0] / longest_of(direction)
            continue
        counts[0] += 1
        f_then, accepted = f, False
        if waited >= patience:
            f_then, accepted = newton_step(
                x, f, p, shared, sets, units, work, face, scratch, counts
            )
            patience = patience if accepted else 2 * patience
            waited = waited if accepted else 0
        if not accepted:
            waited += 1
            reference = history[0]
            for c in range(1, MEMORY):
                reference = max(reference, history[c])
            length = 1.0
            for _ in range(60):
                for c in range(size):
                    following[c] = x[c] + length * direction[c]
                f_then = evaluate(following, p, shared, gradient_then, scratch)
                counts[1] += 1
                if f_then <= reference + SUFFICIENT * length * slope:
                    accepted = True
                    break
                quadratic = -0.5 * length * length * slope / (f_then - f - length * slope)
                if not 0.1 * length <= quadratic <= 0.9 * length:
                    quadratic = 0.5 * length
                length = quadratic
        if not accepted:
            return f, STALLED
        for c in range(size):
            direction[c] = following[c] - x[c]
            following[c] = gradient_then[c] - gradient[c]
            x[c] += direction[c]
            gradient[c] = gradient_then[c]
        f = f_then
        history[iteration % MEMORY] = f
        spectral_steps(direction, following, metric, steps)
    return f, EXHAUSTED


@compiled
def stationarity(x, gradient, units, sets, work):
    """Largest component of x - P(x - gradient) in units of x and f; NaN where not finite."""
    metric = units[0] * units[0] / units[1]
    for c in range(x.size):
        if not math.isfinite(gradient[c]):
            return math.nan  # which a projection onto a box would hide
    work[1, : sets.shape[0]] = metric
    projected_step(x, gradient, work[1], sets, work[2])
    return largest_of(work[2]) / units[0]


@compiled
def judge(x, p, shared, units, sets, work, scratch):
    """f, violation and stationarity of a point, anew: nothing of a solve enters."""
    f = evaluate(x, p, shared, work[0], scratch)
    violation = 0.0
    for i in range(sets.shape[0]):
        outside = excess(x[2 * i], x[2 * i + 1], sets, i)
        if not outside <= violation:
            violation = outside
    if not (math.isfinite(f) and math.isfinite(violation)):
        return f, math.inf, math.nan
    return f, violation, stationarity(x, work[0], units, sets, work)


@compiled
def minimise_batch(
    first,
    last,
    starts,
    parameters,
    shared,
    units,
    sets,
    tolerance,
    iterations,
    x,
    judged,
    outcome,
    counts,
):
    """Solve the states `first` to `last` - 1 from every start (S, B, nx), and judge the answers.

    Writes x (B, nx), judged (B, 3): f, violation, stationarity; outcome (B,); counts (B, 2).
    """
    size, members = x.shape[1], sets.shape[1]
    work, scratch = np.empty((12, size)), np.empty(members * (members + 8))
    face = np.empty((members, 4))
    trial, best = work[7], work[8]
    tries = starts.shape[0] if starts.shape[0] > 1 else 0  # coarse ones, before the last
    for state in range(first, last):
        box, p, unit = sets[state], parameters[state], units[state]
        project(starts[0, state], box, best)
        least = math.inf
        for s in range(tries + 1):
            if s < tries:
                project(starts[s, state], box, trial)
            else:
                copy(best, trial)
            f, how = minimise(
                trial,
                p,
                shared,
                unit,
                box,
                COARSE if s < tries else tolerance,
                iterations,
                work,
                face,
                scratch,
                counts[state],
            )
            outcome[state] = how
            if s == tries or (how != NOT_FINITE and f < least):
                least = f
                copy(trial, best)
        copy(best, x[state])
        judged[state, 0], judged[state, 1], judged[state, 2] = judge(
            best, p, shared, unit, box, work, scratch
        )
