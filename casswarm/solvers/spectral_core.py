"""The spectral projected gradient, state by state: plain Python that Numba compiles.

`casswarm.compiling` joins this text with `casswarm.planar_core`, `newton_core` and that of an
objective into one module, in which `compiled` is Numba's decorator and ``evaluate(x, p, shared,
gradient, scratch)`` returns f(x; p) and writes its gradient. Imported as it stands, nothing is
compiled, and the functions run on any such `evaluate`.
"""

# mypy: ignore-errors
import math

import numpy as np

if "compiled" not in globals():
    from casswarm.planar_core import clip, compiled, excess, nearest
    from casswarm.solvers.newton_core import newton_step

MEMORY = 10  # objective values that the nonmonotone search looks back on
SUFFICIENT = 1e-4  # decrease, as a part of what the gradient promises
SHORTEST, LONGEST = 1e-10, 1e10  # spectral steps
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
def projected_step(x, gradient, step, sets, direction):
    """Write P(x - step gradient) - x into `direction`; its slope and its longest member's length.

    The length of a member's part grows with `step`, and falls when divided by it, so that it bounds
    that of any other step.
    """
    slope, longest = 0.0, 0.0
    for c in range(x.size):
        direction[c] = x[c] - step * gradient[c]
    project(direction, sets, direction)
    for i in range(sets.shape[0]):
        direction[2 * i] -= x[2 * i]
        direction[2 * i + 1] -= x[2 * i + 1]
        dx, dy = direction[2 * i], direction[2 * i + 1]
        slope += dx * gradient[2 * i] + dy * gradient[2 * i + 1]
        longest = max(longest, dx * dx + dy * dy)
    return slope, math.sqrt(longest)


@compiled
def minimise(x, p, shared, units, sets, tolerance, iterations, work, face, scratch, counts):
    """Improve the feasible point `x` in place: (f, outcome); counts: steps, evaluations.

    SPG2 of Birgin, Martinez and Raydan (SIAM J. Optim. 10(4), 2000), which finds the face of the
    set that the minimum lies on, with Newton steps on that face (`newton_core`), in the manner of
    Birgin and Martinez (Comput. Optim. Appl. 23, 2002). `work` (9, x.size) and `scratch` are
    overwritten; row 0 of `work` ends as the gradient at x.
    """
    gradient, direction, following, gradient_then = work[0], work[1], work[2], work[3]
    size = x.size
    metric = units[0] * units[0] / units[1]
    f = evaluate(x, p, shared, gradient, scratch)
    counts[1] += 1
    history = np.full(MEMORY, f)
    step, patience, waited = metric, PATIENCE, 0
    for iteration in range(iterations):
        slope, length = projected_step(x, gradient, step, sets, direction)
        if not (math.isfinite(f) and math.isfinite(slope)):
            return f, NOT_FINITE
        small = tolerance * units[0]
        if length * max(1.0, metric / step) <= small:
            return f, CONVERGED
        if length * metric / step <= small < length:  # perhaps: look closer
            if projected_step(x, gradient, metric, sets, following)[1] <= small:
                return f, CONVERGED
        if iteration == 0:  # no curvature is known yet: a step of about one unit
            step = metric * units[0] / length
            slope, length = projected_step(x, gradient, step, sets, direction)
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
            reference = history.max()
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
        moved, curved = 0.0, 0.0
        for c in range(size):
            s = following[c] - x[c]
            moved += s * s
            curved += s * (gradient_then[c] - gradient[c])
            x[c], gradient[c] = following[c], gradient_then[c]
        f = f_then
        history[iteration % MEMORY] = f
        step = moved / curved if curved > 0.0 else LONGEST * metric
        step = clip(step, SHORTEST * metric, LONGEST * metric)
    return f, EXHAUSTED


@compiled
def stationarity(x, gradient, units, sets, work):
    """Largest component of x - P(x - gradient) in units of x and f; NaN where not finite."""
    metric = units[0] * units[0] / units[1]
    for c in range(x.size):
        if not math.isfinite(gradient[c]):
            return math.nan  # which a projection onto a box would hide
    projected_step(x, gradient, metric, sets, work)
    largest = 0.0
    for c in range(x.size):
        largest = max(largest, abs(work[c]))
    return largest / units[0]


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
    return f, violation, stationarity(x, work[0], units, sets, work[1])


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
    work, scratch = np.empty((10, size)), np.empty(members * (members + 8))
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
                trial[:] = best
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
                best[:] = trial
        x[state] = best
        judged[state, 0], judged[state, 1], judged[state, 2] = judge(
            best, p, shared, unit, box, work, scratch
        )
