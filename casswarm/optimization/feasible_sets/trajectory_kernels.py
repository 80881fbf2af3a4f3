"""Limits of trajectories: slacks, their derivatives, and banded factors; one state at a time.

A trajectory of k members over H steps is y (2 k H,), step by step, member by member: displacements
from the initial positions, in units in which no component of a velocity exceeds 1. With y_{-1} = 0,

    v_s = y_s - y_{s-1},   w_s = v_s - v_{s-1},   v_{-1} = `initial_velocities`,

and every member has six constraints g >= 0 a step, each a slack::

    1 - v_x, 1 - v_y, 1 + v_x, 1 + v_y, acceleration - |w|^2, radii[i, s] - |y_s - centers[i, s]|^2

The last two bounds are squares; an infinite one means that the constraint is absent, and its slack
is infinite. J below is the Jacobian of -g.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from ..._util.jit import kernel, objective
from ...typing import FloatArray

ROWS = 6  # constraints of a member at a step


class Constraints(NamedTuple):
    """Data of the constraints above for k members over H steps.

    Parameters
    ----------
    initial_velocities : (k, 2)
    acceleration : float
        Square of the largest change of a velocity in a step.
    centers : (k, H, 2)
    radii : (k, H)
        Squared.
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
def motion(
    y: FloatArray, constraints: Constraints, s: int, i: int
) -> tuple[float, float, float, float]:
    """Velocity and change of velocity of member i at step s: (vx, vy, wx, wy)."""
    members = constraints.radii.shape[0]
    c, back = 2 * (s * members + i), 2 * members
    if s == 0:
        initial = constraints.initial_velocities
        return y[c], y[c + 1], y[c] - initial[i, 0], y[c + 1] - initial[i, 1]
    vx, vy = y[c] - y[c - back], y[c + 1] - y[c + 1 - back]
    if s == 1:
        return vx, vy, vx - y[c - back], vy - y[c + 1 - back]
    px, py = y[c - back] - y[c - 2 * back], y[c + 1 - back] - y[c + 1 - 2 * back]
    return vx, vy, vx - px, vy - py


@kernel
def motion_change(
    step: FloatArray, members: int, s: int, i: int
) -> tuple[float, float, float, float]:
    """Change of `motion` along `step`."""
    c, back = 2 * (s * members + i), 2 * members
    if s == 0:
        return step[c], step[c + 1], step[c], step[c + 1]
    px, py = step[c] - step[c - back], step[c + 1] - step[c + 1 - back]
    if s == 1:
        return px, py, px - step[c - back], py - step[c + 1 - back]
    ax, ay = step[c - back] - step[c - 2 * back], step[c + 1 - back] - step[c + 1 - 2 * back]
    return px, py, px - ax, py - ay


@kernel
def slacks(y: FloatArray, constraints: Constraints, out: FloatArray) -> float:
    """Write the slacks (6 k H,); return the least of them, NaN where y is not finite."""
    centers, radii = constraints.centers, constraints.radii
    members, steps = radii.shape
    least = math.inf
    for s in range(steps):
        for i in range(members):
            c = 2 * (s * members + i)
            j = 3 * c
            vx, vy, wx, wy = motion(y, constraints, s, i)
            dx, dy = y[c] - centers[i, s, 0], y[c + 1] - centers[i, s, 1]
            out[j], out[j + 1], out[j + 2], out[j + 3] = 1.0 - vx, 1.0 - vy, 1.0 + vx, 1.0 + vy
            out[j + 4] = constraints.acceleration - wx * wx - wy * wy
            out[j + 5] = radii[i, s] - dx * dx - dy * dy
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
    members, steps = constraints.radii.shape
    back = 2 * members
    for s in range(steps):
        for i in range(members):
            c = 2 * (s * members + i)
            j = 3 * c
            _vx, _vy, wx, wy = motion(y, constraints, s, i)
            bx, by = z[j] - z[j + 2], z[j + 1] - z[j + 3]
            tx, ty = 2.0 * z[j + 4] * wx, 2.0 * z[j + 4] * wy
            dx, dy = y[c] - centers[i, s, 0], y[c + 1] - centers[i, s, 1]
            out[c] += bx + tx + 2.0 * z[j + 5] * dx
            out[c + 1] += by + ty + 2.0 * z[j + 5] * dy
            if s > 0:
                out[c - back] -= bx + 2.0 * tx
                out[c + 1 - back] -= by + 2.0 * ty
            if s > 1:
                out[c - 2 * back] += tx
                out[c + 1 - 2 * back] += ty


@kernel
def jacobian_product(
    y: FloatArray, step: FloatArray, constraints: Constraints, out: FloatArray
) -> None:
    """Write J times `step` (6 k H,)."""
    centers = constraints.centers
    members, steps = constraints.radii.shape
    for s in range(steps):
        for i in range(members):
            c = 2 * (s * members + i)
            j = 3 * c
            _vx, _vy, wx, wy = motion(y, constraints, s, i)
            px, py, ax, ay = motion_change(step, members, s, i)
            dx, dy = y[c] - centers[i, s, 0], y[c + 1] - centers[i, s, 1]
            out[j], out[j + 1], out[j + 2], out[j + 3] = px, py, -px, -py
            out[j + 4] = 2.0 * (wx * ax + wy * ay)
            out[j + 5] = 2.0 * (dx * step[c] + dy * step[c + 1])


@kernel
def second_order_terms(step: FloatArray, members: int, steps: int, out: FloatArray) -> None:
    """Write the second-order decrease of every slack along `step` (6 k H,), due to the discs."""
    for s in range(steps):
        for i in range(members):
            c = 2 * (s * members + i)
            j = 3 * c
            _px, _py, ax, ay = motion_change(step, members, s, i)
            out[j], out[j + 1], out[j + 2], out[j + 3] = 0.0, 0.0, 0.0, 0.0
            out[j + 4] = ax * ax + ay * ay
            out[j + 5] = step[c] * step[c] + step[c + 1] * step[c + 1]


@kernel
def max_step_length(
    y: FloatArray, step: FloatArray, fraction: float, slack: FloatArray, constraints: Constraints
) -> float:
    """Largest multiple of `step`, at most 1, that takes no more than a fraction of any slack."""
    centers = constraints.centers
    members, steps = constraints.radii.shape
    length = 1.0
    for s in range(steps):
        for i in range(members):
            c = 2 * (s * members + i)
            j = 3 * c
            _vx, _vy, wx, wy = motion(y, constraints, s, i)
            px, py, ax, ay = motion_change(step, members, s, i)
            for row, rate in ((j, px), (j + 1, py), (j + 2, -px), (j + 3, -py)):
                if rate * length > fraction * slack[row]:
                    length = fraction * slack[row] / rate
            length = length_in_disc(wx, wy, ax, ay, fraction * slack[j + 4], length)
            if slack[j + 5] < math.inf:
                dx, dy = y[c] - centers[i, s, 0], y[c + 1] - centers[i, s, 1]
                length = length_in_disc(
                    dx, dy, step[c], step[c + 1], fraction * slack[j + 5], length
                )
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
    members, steps = constraints.radii.shape
    back = 2 * members
    for s in range(steps):
        for i in range(members):
            c = 2 * (s * members + i)
            j = 3 * c
            _vx, _vy, wx, wy = motion(y, constraints, s, i)
            east = z[j] / slack[j] + z[j + 2] / slack[j + 2]
            north = z[j + 1] / slack[j + 1] + z[j + 3] / slack[j + 3]
            outer, diagonal = 4.0 * z[j + 4] / slack[j + 4], 2.0 * z[j + 4]
            xx, xy, yy = diagonal + outer * wx * wx, outer * wx * wy, diagonal + outer * wy * wy
            for p in range(min(3, s + 1)):
                factor_p = -2.0 if p == 1 else 1.0
                for q in range(p, min(3, s + 1)):
                    factor_pq = factor_p * (-2.0 if q == 1 else 1.0)
                    sign = (1.0 if p == q else -1.0) if q < 2 else 0.0
                    block = (
                        factor_pq * xx + sign * east,
                        factor_pq * xy,
                        factor_pq * yy + sign * north,
                    )
                    add_block(band, c - p * back, c - q * back, block)
            if slack[j + 5] < math.inf:
                dx, dy = y[c] - centers[i, s, 0], y[c + 1] - centers[i, s, 1]
                outer, diagonal = 4.0 * z[j + 5] / slack[j + 5], 2.0 * z[j + 5]
                block = (diagonal + outer * dx * dx, outer * dx * dy, diagonal + outer * dy * dy)
                add_block(band, c, c, block)


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
def factor(band: FloatArray) -> bool:
    """Replace a band by its Cholesky factor; return whether the matrix is positive definite."""
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
