"""The spectral projected gradient, state by state: plain Python that Numba compiles.

`casswarm.compiling` joins this text and that of an objective into one module, in which `compiled`
is Numba's decorator and ``evaluate(x, p, shared, gradient)`` returns f(x; p) and writes its
gradient. Imported as it stands, nothing is compiled, and the functions run on any such `evaluate`.
"""

# mypy: ignore-errors
import math

import numpy as np

ROUNDING = 2.0**-46  # as in casswarm.sets
MEMORY = 10  # objective values that the nonmonotone search looks back on
SUFFICIENT = 1e-4  # decrease, as a part of what the gradient promises
SHORTEST, LONGEST = 1e-10, 1e10  # spectral steps
CONVERGED, EXHAUSTED, STALLED, NOT_FINITE = 0, 1, 2, 3

if "compiled" not in globals():

    def compiled(function):
        return function


@compiled
def in_discs(x, y, centers, radii):
    """Whether a point lies in all discs, up to rounding."""
    for k in range(radii.shape[0]):
        if radii[k] < math.inf:
            dx, dy = x - centers[k, 0], y - centers[k, 1]
            size = max(abs(x) + abs(centers[k, 0]), abs(y) + abs(centers[k, 1]))
            if math.sqrt(dx * dx + dy * dy) > radii[k] + ROUNDING * (size + radii[k]):
                return False
    return True


@compiled
def clip(value, low, high):
    return min(max(value, low), high)


@compiled
def try_crossing(x, y, px, py, lower, upper, centers, radii, best):
    """Keep (x, y) in `best` (x, y, found) if it lies in the set and is nearer to (px, py)."""
    x, y = clip(x, lower[0], upper[0]), clip(y, lower[1], upper[1])
    if in_discs(x, y, centers, radii):
        gain = (x - best[0]) * ((px - x) + (px - best[0])) + (y - best[1]) * (
            (py - y) + (py - best[1])
        )
        if best[2] == 0.0 or gain > 0.0:
            best[0], best[1], best[2] = x, y, 1.0


@compiled
def project_point(px, py, lower, upper, centers, radii, best):
    """Nearest point of a box and discs, into `best`: the cases of `casswarm.sets`, in its order."""
    x, y = clip(px, lower[0], upper[0]), clip(py, lower[1], upper[1])
    best[0], best[1], best[2] = x, y, 1.0
    if in_discs(x, y, centers, radii):
        return
    for k in range(radii.shape[0]):
        dx, dy = px - centers[k, 0], py - centers[k, 1]
        distance = math.sqrt(dx * dx + dy * dy)
        if distance > radii[k]:
            shrink = radii[k] / distance
            x, y = centers[k, 0] + shrink * dx, centers[k, 1] + shrink * dy
            inx, iny = clip(x, lower[0], upper[0]), clip(y, lower[1], upper[1])
            slack = ROUNDING * (max(abs(x), abs(y)) + radii[k])
            if max(abs(inx - x), abs(iny - y)) <= slack and in_discs(inx, iny, centers, radii):
                best[0], best[1] = inx, iny
                return
    best[0], best[1], best[2] = px, py, 0.0
    for k in range(radii.shape[0]):
        r = radii[k]
        if r == math.inf:
            continue
        cx, cy = centers[k, 0], centers[k, 1]
        for side in range(2):
            line = lower[0] if side == 0 else upper[0]
            away = abs(line - cx)
            if away <= r:
                half = math.sqrt(r - away) * math.sqrt(r + away)
                try_crossing(line, cy - half, px, py, lower, upper, centers, radii, best)
                try_crossing(line, cy + half, px, py, lower, upper, centers, radii, best)
            line = lower[1] if side == 0 else upper[1]
            away = abs(line - cy)
            if away <= r:
                half = math.sqrt(r - away) * math.sqrt(r + away)
                try_crossing(cx - half, line, px, py, lower, upper, centers, radii, best)
                try_crossing(cx + half, line, px, py, lower, upper, centers, radii, best)
    if radii.shape[0] == 2 and radii[0] < math.inf and radii[1] < math.inf:
        cross_circles(px, py, lower, upper, centers, radii, best)


@compiled
def cross_circles(px, py, lower, upper, centers, radii, best):
    """Try the points where the two circles cross, measured from the smaller one."""
    small = 0 if radii[0] <= radii[1] else 1
    r, large = radii[small], radii[1 - small]
    cx, cy = centers[small, 0], centers[small, 1]
    dx, dy = centers[1 - small, 0] - cx, centers[1 - small, 1] - cy
    distance = math.sqrt(dx * dx + dy * dy)
    if distance > 0.0:
        along = clip(0.5 * distance + (r - large) * ((r + large) / (2.0 * distance)), -r, r)
        across = math.sqrt(r - along) * math.sqrt(r + along)
        ux, uy = dx / distance, dy / distance
        for sign in (-1.0, 1.0):
            x, y = cx + along * ux - sign * across * uy, cy + along * uy + sign * across * ux
            try_crossing(x, y, px, py, lower, upper, centers, radii, best)


@compiled
def project(x, lower, upper, centers, radii, best, out):
    """Nearest point of the product of sets; members of no width keep their place."""
    for i in range(lower.shape[0]):
        if lower[i, 0] == upper[i, 0] and lower[i, 1] == upper[i, 1]:
            out[2 * i], out[2 * i + 1] = lower[i, 0], lower[i, 1]
        else:
            project_point(x[2 * i], x[2 * i + 1], lower[i], upper[i], centers[i], radii[i], best)
            if best[2] == 0.0:  # a sliver as thin as rounding: keep to the box, and be judged
                best[0] = clip(x[2 * i], lower[i, 0], upper[i, 0])
                best[1] = clip(x[2 * i + 1], lower[i, 1], upper[i, 1])
            out[2 * i], out[2 * i + 1] = best[0], best[1]


@compiled
def stationarity(x, gradient, units, lower, upper, centers, radii, best, work):
    """Largest component of x - P(x - gradient) in units of x and f, zero at stationary points."""
    metric = units[0] * units[0] / units[1]
    for i in range(x.size):
        if not math.isfinite(gradient[i]):
            return math.nan  # which a projection onto a box would hide
        work[i] = x[i] - metric * gradient[i]
    project(work, lower, upper, centers, radii, best, work)
    largest = 0.0
    for i in range(x.size):
        change = abs(work[i] - x[i])
        largest = max(largest, change)
    return largest / units[0]


@compiled
def minimise(x, p, shared, units, lower, upper, centers, radii, tolerance, iterations, counts):
    """Improve the feasible point `x` in place; (f, stationarity, outcome); counts: steps, f's.

    SPG2 of Birgin, Martinez and Raydan (SIAM J. Optim. 10(4), 2000).
    """
    n = x.size
    gradient, direction, following = np.empty(n), np.empty(n), np.empty(n)
    gradient_then, best = np.empty(n), np.empty(3)
    f = evaluate(x, p, shared, gradient)
    counts[1] += 1
    history = np.full(MEMORY, f)
    residual = stationarity(x, gradient, units, lower, upper, centers, radii, best, direction)
    metric = units[0] * units[0] / units[1]
    step = metric / residual if residual > 0.0 else metric
    for iteration in range(iterations):
        if not (math.isfinite(f) and math.isfinite(residual)):
            return f, residual, NOT_FINITE
        if residual <= tolerance:
            return f, residual, CONVERGED
        step = clip(step, SHORTEST * metric, LONGEST * metric)
        for i in range(n):
            direction[i] = x[i] - step * gradient[i]
        project(direction, lower, upper, centers, radii, best, direction)
        slope = 0.0
        for i in range(n):
            direction[i] -= x[i]
            slope += direction[i] * gradient[i]
        reference = history.max()
        length, accepted = 1.0, False
        f_then = f
        for _ in range(60):
            for i in range(n):
                following[i] = x[i] + length * direction[i]
            f_then = evaluate(following, p, shared, gradient_then)
            counts[1] += 1
            if f_then <= reference + SUFFICIENT * length * slope:
                accepted = True
                break
            quadratic = -0.5 * length * length * slope / (f_then - f - length * slope)
            if not 0.1 * length <= quadratic <= 0.9 * length:
                quadratic = 0.5 * length
            length = quadratic
        if not accepted:
            return f, residual, STALLED
        counts[0] += 1
        moved, curved = 0.0, 0.0
        for i in range(n):
            s = following[i] - x[i]
            moved += s * s
            curved += s * (gradient_then[i] - gradient[i])
            x[i], gradient[i] = following[i], gradient_then[i]
        f = f_then
        history[iteration % MEMORY] = f
        step = moved / curved if curved > 0.0 else LONGEST * metric
        residual = stationarity(x, gradient, units, lower, upper, centers, radii, best, direction)
    return f, residual, CONVERGED if residual <= tolerance else EXHAUSTED


@compiled
def minimise_batch(
    first,
    last,
    starts,
    parameters,
    shared,
    units,
    lower,
    upper,
    centers,
    radii,
    tolerance,
    iterations,
    x,
    objective,
    residual,
    outcome,
    counts,
):
    """Solve the states `first` to `last` - 1 from every start (S, B, nx); the least f is kept."""
    trial, best = np.empty(x.shape[1]), np.empty(3)
    for state in range(first, last):
        box, discs = (lower[state], upper[state]), (centers[state], radii[state])
        objective[state], residual[state], outcome[state] = math.inf, math.inf, NOT_FINITE
        x[state] = starts[0, state]
        for s in range(starts.shape[0]):
            project(starts[s, state], box[0], box[1], discs[0], discs[1], best, trial)
            f, r, how = minimise(
                trial,
                parameters[state],
                shared,
                units[state],
                box[0],
                box[1],
                discs[0],
                discs[1],
                tolerance,
                iterations,
                counts[state],
            )
            # a converged start before one that is not, then the lower objective
            better = (
                how < outcome[state]
                if (how == 0) != (outcome[state] == 0)
                else (f < objective[state])
            )
            if better:
                objective[state], residual[state], outcome[state] = f, r, how
                x[state] = trial


@compiled
def residual_batch(x, parameters, shared, units, lower, upper, centers, radii, objective, residual):
    """f and stationarity of given points, anew: nothing of a solve enters."""
    gradient, work, best = np.empty(x.shape[1]), np.empty(x.shape[1]), np.empty(3)
    for state in range(x.shape[0]):
        objective[state] = evaluate(x[state], parameters[state], shared, gradient)
        residual[state] = stationarity(
            x[state],
            gradient,
            units[state],
            lower[state],
            upper[state],
            centers[state],
            radii[state],
            best,
            work,
        )
