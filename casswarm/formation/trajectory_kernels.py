"""Limits of trajectories: slacks, their derivatives, and banded factors; one state at a time.

A trajectory of k members over H steps is y (2 k H,), step by step, member by member: displacements
from the initial positions, in units in which no component of a velocity exceeds 1. With y_{-1} = 0,

    v_s = y_s - y_{s-1},   w_s = v_s - v_{s-1},   v_{-1} = `initial_velocities`,

and every point m = s k + i, that of member i after step s, has six constraints g >= 0, each a
slack::

    1 - v_x, 1 - v_y, 1 + v_x, 1 + v_y, acceleration - |w|^2, radii[m] - |y_m - centers_m|^2

The last two bounds are squares, infinite where the constraint is absent. J is the Jacobian of -g.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from ..compiled.kernels import kernel, objective
from ..typing import FloatArray

ROWS = 6  # constraints of a point
FIRST, SECOND = (1.0, -1.0, 0.0), (1.0, -2.0, 1.0)  # differences of y_s, y_{s-1} and y_{s-2}


class Constraints(NamedTuple):
    """Data of the constraints above: initial_velocities (2 k,), centers (2 k H,), radii (k H,).

    `acceleration` is the square of the largest change of a velocity in a step; radii are squared.
    """

    initial_velocities: FloatArray
    acceleration: float
    centers: FloatArray
    radii: FloatArray


@objective
def disc_distance(x, p, constants, gradient, scratch):  # type: ignore[no-untyped-def]  # noqa: ARG001
    """Half the squared distance of `x` (2,) to the disc p: center x, center y, radius."""
    dx, dy = x[0] - p[0], x[1] - p[1]
    distance = math.sqrt(dx * dx + dy * dy)
    outside = max(0.0, distance - p[2])
    factor = outside / distance if distance > 0.0 else 0.0
    gradient[0], gradient[1] = factor * dx, factor * dy
    return 0.5 * outside * outside


@kernel
def differences(y: FloatArray, c: int, back: int) -> tuple[float, float]:
    """First and second difference of a coordinate over steps, which are `back` entries apart."""
    previous = y[c - back] if c >= back else 0.0
    first = y[c] - previous
    return first, first - (previous - (y[c - 2 * back] if c >= 2 * back else 0.0))


@kernel
def motion_change(
    step: FloatArray, constraints: Constraints, m: int
) -> tuple[float, float, float, float]:
    """Change of `motion` along `step`."""
    back = constraints.initial_velocities.size
    px, ax = differences(step, 2 * m, back)
    py, ay = differences(step, 2 * m + 1, back)
    return px, py, ax, ay


@kernel
def motion(y: FloatArray, constraints: Constraints, m: int) -> tuple[float, float, float, float]:
    """Velocity and change of velocity at a point: (vx, vy, wx, wy)."""
    vx, vy, wx, wy = motion_change(y, constraints, m)
    initial = constraints.initial_velocities
    if 2 * m < initial.size:
        return vx, vy, wx - initial[2 * m], wy - initial[2 * m + 1]
    return vx, vy, wx, wy


@kernel
def slacks(y: FloatArray, constraints: Constraints, out: FloatArray) -> float:
    """Write the slacks (6 k H,); return the least of them, NaN where y is not finite."""
    centers = constraints.centers
    least = math.inf
    for m in range(constraints.radii.size):
        c, j = 2 * m, ROWS * m
        vx, vy, wx, wy = motion(y, constraints, m)
        dx, dy = y[c] - centers[c], y[c + 1] - centers[c + 1]
        out[j], out[j + 1], out[j + 2], out[j + 3] = 1.0 - vx, 1.0 - vy, 1.0 + vx, 1.0 + vy
        out[j + 4] = constraints.acceleration - wx * wx - wy * wy
        out[j + 5] = constraints.radii[m] - dx * dx - dy * dy
        for row in range(j, j + ROWS):
            if not out[row] >= least:
                least = out[row]
    return least


@kernel
def add_jacobian_transpose(
    y: FloatArray, z: FloatArray, constraints: Constraints, out: FloatArray
) -> None:
    """Add J^T z to `out`."""
    centers = constraints.centers
    back = constraints.initial_velocities.size
    for m in range(constraints.radii.size):
        c, j = 2 * m, ROWS * m
        _vx, _vy, wx, wy = motion(y, constraints, m)
        bx, by = z[j] - z[j + 2], z[j + 1] - z[j + 3]
        tx, ty = 2.0 * z[j + 4] * wx, 2.0 * z[j + 4] * wy
        dx, dy = y[c] - centers[c], y[c + 1] - centers[c + 1]
        out[c] += bx + tx + 2.0 * z[j + 5] * dx
        out[c + 1] += by + ty + 2.0 * z[j + 5] * dy
        if c >= back:
            out[c - back] -= bx + 2.0 * tx
            out[c + 1 - back] -= by + 2.0 * ty
        if c >= 2 * back:
            out[c - 2 * back] += tx
            out[c + 1 - 2 * back] += ty


@kernel
def slack_changes(
    y: FloatArray, step: FloatArray, constraints: Constraints, out: FloatArray
) -> None:
    """Write the changes -J `step` of all slacks, to first order (6 k H,)."""
    centers = constraints.centers
    for m in range(constraints.radii.size):
        c, j = 2 * m, ROWS * m
        _vx, _vy, wx, wy = motion(y, constraints, m)
        px, py, ax, ay = motion_change(step, constraints, m)
        dx, dy = y[c] - centers[c], y[c + 1] - centers[c + 1]
        out[j], out[j + 1], out[j + 2], out[j + 3] = -px, -py, px, py
        out[j + 4] = -2.0 * (wx * ax + wy * ay)
        out[j + 5] = -2.0 * (dx * step[c] + dy * step[c + 1])


@kernel
def second_order_terms(step: FloatArray, constraints: Constraints, out: FloatArray) -> None:
    """Write the second-order decrease of every slack along `step` (6 k H,), due to the discs."""
    for m in range(constraints.radii.size):
        c, j = 2 * m, ROWS * m
        _px, _py, ax, ay = motion_change(step, constraints, m)
        out[j], out[j + 1], out[j + 2], out[j + 3] = 0.0, 0.0, 0.0, 0.0
        out[j + 4] = ax * ax + ay * ay
        out[j + 5] = step[c] * step[c] + step[c + 1] * step[c + 1]


@kernel
def max_step_length(
    y: FloatArray, step: FloatArray, fraction: float, slack: FloatArray, constraints: Constraints
) -> float:
    """Largest multiple of `step`, at most 1, that takes no more than a fraction of any slack."""
    centers = constraints.centers
    length = 1.0
    for m in range(constraints.radii.size):
        c, j = 2 * m, ROWS * m
        _vx, _vy, wx, wy = motion(y, constraints, m)
        px, py, ax, ay = motion_change(step, constraints, m)
        for row, rate in ((j, px), (j + 1, py), (j + 2, -px), (j + 3, -py)):
            if rate * length > fraction * slack[row]:
                length = fraction * slack[row] / rate
        length = length_in_disc(wx, wy, ax, ay, fraction * slack[j + 4], length)
        if slack[j + 5] < math.inf:
            dx, dy = y[c] - centers[c], y[c + 1] - centers[c + 1]
            length = length_in_disc(dx, dy, step[c], step[c + 1], fraction * slack[j + 5], length)
    return length


@kernel
def length_in_disc(x: float, y: float, dx: float, dy: float, margin: float, length: float) -> float:
    """Largest multiple of (dx, dy), at most `length`, by which |(x, y)|^2 grows by `margin`."""
    outward, square = x * dx + y * dy, dx * dx + dy * dy
    if length * (2.0 * outward + length * square) <= margin:
        return length
    root = math.sqrt(outward * outward + square * margin)
    # both forms are the same root; each is exact where the other cancels
    return min(length, margin / (outward + root) if outward > 0.0 else (root - outward) / square)


@kernel
def add_curvature(
    y: FloatArray, z: FloatArray, slack: FloatArray, constraints: Constraints, band: FloatArray
) -> None:
    """Add the constraints' part of the condensed Newton matrix to the lower `band`.

    `band` (2 k H, 4 k + 2): row r holds the entries (r, r - 4 k - 1) to (r, r).
    """
    centers = constraints.centers
    back = constraints.initial_velocities.size
    for m in range(constraints.radii.size):
        c, j = 2 * m, ROWS * m
        _vx, _vy, wx, wy = motion(y, constraints, m)
        east = z[j] / slack[j] + z[j + 2] / slack[j + 2]
        north = z[j + 1] / slack[j + 1] + z[j + 3] / slack[j + 3]
        xx, xy, yy = disc_curvature(wx, wy, z[j + 4], slack[j + 4])
        for p in range(min(3, c // back + 1)):
            for q in range(p, min(3, c // back + 1)):
                first, second = FIRST[p] * FIRST[q], SECOND[p] * SECOND[q]
                block = second * xx + first * east, second * xy, second * yy + first * north
                add_block(band, c - p * back, c - q * back, block)
        if slack[j + 5] < math.inf:
            dx, dy = y[c] - centers[c], y[c + 1] - centers[c + 1]
            add_block(band, c, c, disc_curvature(dx, dy, z[j + 5], slack[j + 5]))


@kernel
def disc_curvature(x: float, y: float, z: float, slack: float) -> tuple[float, float, float]:
    """Condensed curvature (xx, xy, yy) of the bound on |(x, y)|^2, with its multiplier z."""
    outer, diagonal = 4.0 * z / slack, 2.0 * z
    return diagonal + outer * x * x, outer * x * y, diagonal + outer * y * y


@kernel
def add_block(band: FloatArray, row: int, column: int, block: tuple[float, float, float]) -> None:
    """Add a symmetric block (xx, xy, yy) at (row, column), on the diagonal its lower half."""
    last = band.shape[1] - 1
    band[row, last + column - row] += block[0]
    band[row + 1, last + column - row - 1] += block[1]
    band[row + 1, last + column - row] += block[2]
    if row != column:
        band[row, last + column + 1 - row] += block[1]


@kernel
def factor(band: FloatArray, added: float, out: FloatArray) -> bool:
    """Write the Cholesky factor of a band plus `added` times the identity.

    Returns whether the matrix is positive definite; without that, `out` is incomplete.
    """
    last = band.shape[1] - 1
    for r in range(band.shape[0]):
        first = max(0, r - last)
        for c in range(first, r + 1):
            total = band[r, last + c - r]
            if c == r:
                total += added
            for m in range(max(first, c - last), c):
                total -= out[r, last + m - r] * out[c, last + m - c]
            if c < r:
                out[r, last + c - r] = total / out[c, last]
            elif total > 0.0:
                out[r, last] = math.sqrt(total)
            else:
                return False
    return True


@kernel
def solve(band: FloatArray, x: FloatArray) -> None:
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
