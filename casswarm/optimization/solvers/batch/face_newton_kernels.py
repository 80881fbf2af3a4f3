"""Newton steps on a face of a product of planar sets: plain Python that Numba compiles.

The face that x lies on: every member is free (in the plane), on one boundary (free along it), or
held in a corner. On the face the Lagrangian is minimised by conjugate gradients, its Hessian times
a vector taken from differences of gradients, so that a step costs O(n) gradients at most and needs
no more source than the objective's. A circle of radius r whose multiplier is m adds the curvature
m / r along it. See `casswarm._util.jit` for ``compiled`` and ``evaluate``.
"""

# mypy: ignore-errors
import math

if "compiled" not in globals():
    from casswarm.optimization.feasible_sets.planar_kernels import DISCS, compiled, nearest

ACTIVE = 1e-10  # a boundary is active that is nearer, in units of x
HELD = 1e-9  # a member is held that the projected gradient moves less, in units of x
DIFFERENCE = 1e-7  # length of the gradient's differences, in units of x
FORCING = 1e-3  # residual at which the conjugate gradients stop, as a part of the first
MAX_ITERATIONS = 30  # of their steps
REACH = 0.1  # the longest component of a step, in units of x
TRIALS = 4  # of its length
SUFFICIENT = 1e-4  # decrease, as a part of what the gradient promises


@compiled
def tangent(i, x, gradient, direction, sets, unit):
    """What member i may do on its face: (degrees of freedom, tx, ty, curvature).

    Of the active boundaries, those count that the negative gradient presses on.
    """
    gx, gy = gradient[2 * i], gradient[2 * i + 1]
    px, py = x[2 * i], x[2 * i + 1]
    dx, dy = direction[2 * i], direction[2 * i + 1]
    moves = math.sqrt(dx * dx + dy * dy)
    pressed, tx, ty, curvature, steepest = 0, 0.0, 0.0, 0.0, 0.0
    for side in range(4):  # the box's normals: -x, -y, +x, +y
        if abs((px if side % 2 == 0 else py) - sets[i, side]) <= ACTIVE * unit:
            sign = -1.0 if side < 2 else 1.0
            push = -sign * (gx if side % 2 == 0 else gy)
            if push > 0.0:
                pressed += 1
                if push > steepest:
                    steepest, curvature = push, 0.0
                    tx, ty = (0.0, 1.0) if side % 2 == 0 else (1.0, 0.0)
    for k in DISCS:
        r = sets[i, k + 2]
        if r < math.inf:
            nx, ny = px - sets[i, k], py - sets[i, k + 1]
            away = math.sqrt(nx * nx + ny * ny)
            if away > 0.0 and abs(away - r) <= ACTIVE * unit:
                nx, ny = nx / away, ny / away
                push = -(gx * nx + gy * ny)
                if push > 0.0:
                    pressed += 1
                    if push > steepest:
                        steepest, curvature = push, push / r
                        tx, ty = -ny, nx
    if pressed == 0:
        return 2, 0.0, 0.0, 0.0
    fixed = sets[i, 0] == sets[i, 2] and sets[i, 1] == sets[i, 3]
    if fixed or (pressed > 1 and moves <= HELD * unit):
        return 0, 0.0, 0.0, 0.0
    return 1, tx, ty, curvature


@compiled
def reduced(vector, face, out):
    """Write the part of a vector that lies in the face's tangent space; its squared length."""
    total = 0.0
    for i in range(vector.size // 2):
        vx, vy = vector[2 * i], vector[2 * i + 1]
        if face[i, 0] == 1.0:
            along = vx * face[i, 1] + vy * face[i, 2]
            vx, vy = along * face[i, 1], along * face[i, 2]
        elif face[i, 0] == 0.0:
            vx, vy = 0.0, 0.0
        out[2 * i], out[2 * i + 1] = vx, vy
        total += vx * vx + vy * vy
    return total


@compiled
def largest_of(vector):
    """Largest magnitude of a component."""
    largest = 0.0
    for c in range(vector.size):
        largest = max(largest, abs(vector[c]))
    return largest


@compiled
def longest_of(vector):
    """Length of the longest member's part."""
    longest = 0.0
    for i in range(vector.size // 2):
        longest = max(longest, vector[2 * i] ** 2 + vector[2 * i + 1] ** 2)
    return math.sqrt(longest)


@compiled
def blocking_length(x, step, sets, unit):
    """Length of a step at which a first boundary is met that is not active at x."""
    shortest = math.inf
    for i in range(sets.shape[0]):
        sx, sy = step[2 * i], step[2 * i + 1]
        for side in range(4):
            ahead = sets[i, side] - (x[2 * i] if side % 2 == 0 else x[2 * i + 1])
            pace = sx if side % 2 == 0 else sy
            if abs(ahead) > ACTIVE * unit and ahead * pace > 0.0:
                shortest = min(shortest, ahead / pace)
        for k in DISCS:
            wx, wy, r = x[2 * i] - sets[i, k], x[2 * i + 1] - sets[i, k + 1], sets[i, k + 2]
            if r < math.inf and math.sqrt(wx * wx + wy * wy) < r - ACTIVE * unit:
                inside = r * r - wx * wx - wy * wy
                outward, square = wx * sx + wy * sy, sx * sx + sy * sy
                pace = outward + math.sqrt(outward * outward + square * inside)
                if pace > 0.0:
                    shortest = min(shortest, inside / pace)
    return shortest


@compiled
def curvature_along(x, q, p, shared, unit, work, face, scratch):
    """Write the reduced Hessian of the Lagrangian times q into row 9 of `work`; q'Hq."""
    gradient, moved, changed, product = work[0], work[2], work[3], work[9]
    short = DIFFERENCE * unit / largest_of(q)
    for c in range(x.size):
        moved[c] = x[c] + short * q[c]
    evaluate(moved, p, shared, changed, scratch)
    for c in range(x.size):
        product[c] = (changed[c] - gradient[c]) / short
    reduced(product, face, product)
    total = 0.0
    for c in range(x.size):
        product[c] += face[c // 2, 3] * q[c]
        total += q[c] * product[c]
    return total


@compiled
def newton_step(x, f, p, shared, sets, units, work, face, scratch, counts):
    """Try a Newton step from x: (f there, whether it is accepted).

    Rows of `work`: 0 the gradient at x, 1 its projected step, and written: 2 the new point, 3 its
    gradient, 4 the step, 5 the residual, 6 the conjugate direction, 9 the Hessian times it.
    """
    gradient, following, gradient_then = work[0], work[2], work[3]
    step, residual, q, product = work[4], work[5], work[6], work[9]
    size, unit = x.size, units[0]
    for i in range(sets.shape[0]):
        face[i, 0], face[i, 1], face[i, 2], face[i, 3] = tangent(
            i, x, gradient, work[1], sets, unit
        )
    square = reduced(gradient, face, residual)
    first = square
    if not 0.0 < first < math.inf:
        return f, False
    for c in range(size):
        step[c] = 0.0
        residual[c] = -residual[c]
        q[c] = residual[c]
    for _ in range(MAX_ITERATIONS):
        curved = curvature_along(x, q, p, shared, unit, work, face, scratch)
        counts[1] += 1
        if not curved > 0.0:
            along = REACH * unit / largest_of(q)
            for c in range(size):  # downhill all the way, as far as one may go
                step[c] += along * q[c]
            break
        length = square / curved
        now = 0.0
        for c in range(size):
            step[c] += length * q[c]
            residual[c] -= length * product[c]
            now += residual[c] * residual[c]
        if now <= FORCING * FORCING * first:
            break
        for c in range(size):
            q[c] = residual[c] + now / square * q[c]
        square = now
    slope = 0.0
    for c in range(size):
        slope += gradient[c] * step[c]
    if not slope < 0.0:
        return f, False
    length = min(1.0, REACH * unit / largest_of(step))
    blocked = blocking_length(x, step, sets, unit)
    for trial in range(TRIALS):
        for i in range(sets.shape[0]):
            px, py = x[2 * i] + length * step[2 * i], x[2 * i + 1] + length * step[2 * i + 1]
            following[2 * i], following[2 * i + 1], _found = nearest(px, py, sets, i)
        f_then = evaluate(following, p, shared, gradient_then, scratch)
        counts[1] += 1
        if f_then <= f + SUFFICIENT * length * slope + 2.0**-50 * abs(f):
            return f_then, True
        length = blocked if trial == 0 and blocked < length else 0.25 * length
    return f, False
