"""Limits of paths: slacks, gradients, curvatures, and banded factors; Python that Numba compiles.

A path of k members over H steps is y (2 k H,), step by step, member by member: what they have come
from where they began, in units in which no component of a velocity exceeds 1. With y_{-1} = 0,

    v_s = y_s - y_{s-1},   w_s = v_s - v_{s-1},   v_{-1} = `before`,

and every member has six constraints a step, each a slack that must not be negative::

    1 - v_x, 1 - v_y, 1 + v_x, 1 + v_y, square - |w|^2, squares[i, s] - |y_s - centers[i, s]|^2

where an infinite number of `squares` means that the last is absent: its slack is infinite. See
`casswarm._util.jit` for ``compiled``.
"""

# mypy: ignore-errors
import math

ROWS = 6  # constraints of a member at a step

if "compiled" not in globals():
    from casswarm.optimization.feasible_sets.planar_kernels import compiled


@compiled
def motion(y, before, members, s, i):
    """Velocity and change of velocity of member i at step s: (vx, vy, wx, wy)."""
    c, back = 2 * (s * members + i), 2 * members
    if s == 0:
        return y[c], y[c + 1], y[c] - before[i, 0], y[c + 1] - before[i, 1]
    vx, vy = y[c] - y[c - back], y[c + 1] - y[c + 1 - back]
    if s == 1:
        return vx, vy, vx - y[c - back], vy - y[c + 1 - back]
    px, py = y[c - back] - y[c - 2 * back], y[c + 1 - back] - y[c + 1 - 2 * back]
    return vx, vy, vx - px, vy - py


@compiled
def slacks(y, before, square, centers, squares, out):
    """Write the slacks (6 k H,); the least of them, NaN where y is not finite."""
    members, steps = squares.shape
    least = math.inf
    for s in range(steps):
        for i in range(members):
            c = 2 * (s * members + i)
            j = 3 * c
            vx, vy, wx, wy = motion(y, before, members, s, i)
            dx, dy = y[c] - centers[i, s, 0], y[c + 1] - centers[i, s, 1]
            out[j], out[j + 1], out[j + 2], out[j + 3] = 1.0 - vx, 1.0 - vy, 1.0 + vx, 1.0 + vy
            out[j + 4] = square - wx * wx - wy * wy
            out[j + 5] = squares[i, s] - dx * dx - dy * dy
            for row in range(j, j + ROWS):
                if not out[row] >= least:
                    least = out[row]
    return least


@compiled
def add_pulled(y, q, before, centers, members, steps, out):
    """Add sum over constraints of q times the gradient of minus its slack to `out`."""
    back = 2 * members
    for s in range(steps):
        for i in range(members):
            c = 2 * (s * members + i)
            j = 3 * c
            _vx, _vy, wx, wy = motion(y, before, members, s, i)
            bx, by = q[j] - q[j + 2], q[j + 1] - q[j + 3]
            tx, ty = 2.0 * q[j + 4] * wx, 2.0 * q[j + 4] * wy
            dx, dy = y[c] - centers[i, s, 0], y[c + 1] - centers[i, s, 1]
            out[c] += bx + tx + 2.0 * q[j + 5] * dx
            out[c + 1] += by + ty + 2.0 * q[j + 5] * dy
            if s > 0:
                out[c - back] -= bx + 2.0 * tx
                out[c + 1 - back] -= by + 2.0 * ty
            if s > 1:
                out[c - 2 * back] += tx
                out[c + 1 - 2 * back] += ty


@compiled
def pushed(y, step, before, centers, members, steps, out):
    """Write the change of minus every slack along `step`, to first order (6 k H,)."""
    for s in range(steps):
        for i in range(members):
            c = 2 * (s * members + i)
            j = 3 * c
            _vx, _vy, wx, wy = motion(y, before, members, s, i)
            px, py, ax, ay = change(step, members, s, i)
            dx, dy = y[c] - centers[i, s, 0], y[c + 1] - centers[i, s, 1]
            out[j], out[j + 1], out[j + 2], out[j + 3] = px, py, -px, -py
            out[j + 4] = 2.0 * (wx * ax + wy * ay)
            out[j + 5] = 2.0 * (dx * step[c] + dy * step[c + 1])


@compiled
def bends(step, members, steps, out):
    """Write what every slack loses along `step` to second order (6 k H,): the discs' curvature."""
    for s in range(steps):
        for i in range(members):
            c = 2 * (s * members + i)
            j = 3 * c
            _px, _py, ax, ay = change(step, members, s, i)
            out[j], out[j + 1], out[j + 2], out[j + 3] = 0.0, 0.0, 0.0, 0.0
            out[j + 4] = ax * ax + ay * ay
            out[j + 5] = step[c] * step[c] + step[c + 1] * step[c + 1]


@compiled
def change(step, members, s, i):
    """What `step` changes in `motion`: (of vx, vy, wx, wy)."""
    c, back = 2 * (s * members + i), 2 * members
    if s == 0:
        return step[c], step[c + 1], step[c], step[c + 1]
    px, py = step[c] - step[c - back], step[c + 1] - step[c + 1 - back]
    if s == 1:
        return px, py, px - step[c - back], py - step[c + 1 - back]
    ax, ay = step[c - back] - step[c - 2 * back], step[c + 1 - back] - step[c + 1 - 2 * back]
    return px, py, px - ax, py - ay


@compiled
def longest(y, step, part, slack, before, centers, members, steps):
    """Longest multiple of `step`, 1 at the most, that takes no more than `part` of any slack."""
    most = 1.0
    for s in range(steps):
        for i in range(members):
            c = 2 * (s * members + i)
            j = 3 * c
            _vx, _vy, wx, wy = motion(y, before, members, s, i)
            px, py, ax, ay = change(step, members, s, i)
            for row, pace in ((j, px), (j + 1, py), (j + 2, -px), (j + 3, -py)):
                if pace * most > part * slack[row]:
                    most = part * slack[row] / pace
            most = within_disc(wx, wy, ax, ay, part * slack[j + 4], most)
            if slack[j + 5] < math.inf:
                dx, dy = y[c] - centers[i, s, 0], y[c + 1] - centers[i, s, 1]
                most = within_disc(dx, dy, step[c], step[c + 1], part * slack[j + 5], most)
    return most


@compiled
def within_disc(x, y, dx, dy, room, most):
    """Longest multiple of (dx, dy), `most` at the most, by which |(x, y)|^2 grows by `room`."""
    outward, square = x * dx + y * dy, dx * dx + dy * dy
    if most * (2.0 * outward + most * square) <= room:
        return most
    root = math.sqrt(outward * outward + square * room)
    # both forms are the same root; each is exact where the other cancels
    return min(most, room / (outward + root) if outward > 0.0 else (root - outward) / square)


@compiled
def add_curvature(y, z, slack, before, centers, members, steps, band):
    """Add the constraints' part of the condensed Newton matrix to the lower `band`.

    `band` (2 k H, 4 k + 2): row r holds the entries (r, r - 4 k - 1) to (r, r).
    """
    back = 2 * members
    for s in range(steps):
        for i in range(members):
            c = 2 * (s * members + i)
            j = 3 * c
            _vx, _vy, wx, wy = motion(y, before, members, s, i)
            east = z[j] / slack[j] + z[j + 2] / slack[j + 2]
            north = z[j + 1] / slack[j + 1] + z[j + 3] / slack[j + 3]
            steep, flat = 4.0 * z[j + 4] / slack[j + 4], 2.0 * z[j + 4]
            xx, xy, yy = flat + steep * wx * wx, steep * wx * wy, flat + steep * wy * wy
            for p in range(min(3, s + 1)):
                of_p = -2.0 if p == 1 else 1.0
                for q in range(p, min(3, s + 1)):
                    of = of_p * (-2.0 if q == 1 else 1.0)
                    sign = (1.0 if p == q else -1.0) if q < 2 else 0.0
                    add_block(
                        band,
                        c - p * back,
                        c - q * back,
                        of * xx + sign * east,
                        of * xy,
                        of * yy + sign * north,
                    )
            if slack[j + 5] < math.inf:
                dx, dy = y[c] - centers[i, s, 0], y[c + 1] - centers[i, s, 1]
                steep, flat = 4.0 * z[j + 5] / slack[j + 5], 2.0 * z[j + 5]
                add_block(
                    band, c, c, flat + steep * dx * dx, steep * dx * dy, flat + steep * dy * dy
                )


@compiled
def add_block(band, row, column, xx, xy, yy):
    """Add a symmetric block at (row, column), on the diagonal its lower half."""
    last = band.shape[1] - 1
    band[row, last + column - row] += xx
    band[row + 1, last + column - row - 1] += xy
    band[row + 1, last + column - row] += yy
    if row != column:
        band[row, last + column + 1 - row] += xy


@compiled
def factor(band):
    """Cholesky's factor in place of a band; whether the matrix is positive definite."""
    last = band.shape[1] - 1
    for r in range(band.shape[0]):
        first = max(0, r - last)
        for c in range(first, r + 1):
            total = band[r, last + c - r]
            for m in range(max(first, c - last), c):
                total -= band[r, last + m - r] * band[c, last + m - c]
            if c < r:
                band[r, last + c - r] = total / band[c, last]
            elif total > 0.0:
                band[r, last] = math.sqrt(total)
            else:
                return False
    return True


@compiled
def solve(band, x):
    """Solve with the factor of `factor`, in place."""
    last = band.shape[1] - 1
    for r in range(band.shape[0]):
        for c in range(max(0, r - last), r):
            x[r] -= band[r, last + c - r] * x[c]
        x[r] /= band[r, last]
    for r in range(band.shape[0] - 1, -1, -1):
        x[r] /= band[r, last]
        for c in range(max(0, r - last), r):
            x[c] -= band[r, last + c - r] * x[r]
