"""Nearest point of a box and up to three discs in the plane, and velocities that limits allow.

The cases are those of `casswarm.motion.planar`, which proves them. A set is a
row of thirteen numbers (`casswarm.motion.planar.PlanarSets.packed`)::

    lower x, lower y, upper x, upper y, and of each disc: center x, center y, radius

where an infinite radius means that the disc is absent.
"""

from __future__ import annotations

import math
from typing import TypeAlias

from ..compiled.kernels import kernel
from ..typing import BoolArray, FloatArray

ROUNDING = 2.0**-46  # 64 units of rounding, 1.4e-14
DISCS = (4, 7, 10)  # where a row's discs begin
WIDTH = 13  # numbers of a row

PAIRS = ((4, 7), (4, 10), (7, 10))
Candidate: TypeAlias = tuple[float, float, bool]


@kernel
def clip(value: float, low: float, high: float) -> float:
    """Nearest number to `value` between `low` and `high`."""
    return min(max(value, low), high)


@kernel
def within(x: float, y: float, sets: FloatArray, i: int) -> bool:
    """Return True if a point lies in all discs of set i, up to rounding; False for NaN."""
    for k in DISCS:
        cx, cy, r = sets[i, k], sets[i, k + 1], sets[i, k + 2]
        dx, dy = x - cx, y - cy
        square = dx * dx + dy * dy
        if not square <= r * r:  # so that most need no root
            slack = ROUNDING * (max(abs(x), abs(y)) + max(abs(cx), abs(cy)) + r)
            if not math.sqrt(square) - r <= slack:
                return False
    return True


@kernel
def nearer(
    x: float, y: float, px: float, py: float, sets: FloatArray, i: int, best: Candidate
) -> Candidate:
    """The clipped point (x, y) if it is in set i and nearer to (px, py) than `best`, or `best`."""
    x, y = clip(x, sets[i, 0], sets[i, 2]), clip(y, sets[i, 1], sets[i, 3])
    if within(x, y, sets, i):
        # |p - q|^2 - |p - x|^2 without the cancellation that spoils it far from the set
        gain = (x - best[0]) * ((px - x) + (px - best[0])) + (y - best[1]) * (
            (py - y) + (py - best[1])
        )
        if not best[2] or gain > 0.0:
            return x, y, True
    return best


@kernel
def half_chord(line: float, center: float, r: float) -> float:
    """Half the chord that a circle cuts from a line: 0 where they touch up to rounding, or -1."""
    away = abs(line - center)
    if r - away > -ROUNDING * (abs(line) + abs(center) + r):
        return math.sqrt(max(r - away, 0.0)) * math.sqrt(r + away)
    return -1.0


@kernel
def nearest(px: float, py: float, sets: FloatArray, i: int) -> Candidate:
    """Nearest point of set i to (px, py), and whether there is one: (x, y, exists)."""
    x, y = clip(px, sets[i, 0], sets[i, 2]), clip(py, sets[i, 1], sets[i, 3])
    if within(x, y, sets, i):
        return x, y, True
    for k in DISCS:
        cx, cy, r = sets[i, k], sets[i, k + 1], sets[i, k + 2]
        dx, dy = px - cx, py - cy
        distance = math.sqrt(dx * dx + dy * dy)
        if distance > r:
            x, y = cx + r / distance * dx, cy + r / distance * dy
            inx, iny = clip(x, sets[i, 0], sets[i, 2]), clip(y, sets[i, 1], sets[i, 3])
            slack = ROUNDING * (max(abs(x), abs(y)) + max(abs(cx), abs(cy)) + r)
            if max(abs(inx - x), abs(iny - y)) <= slack and within(inx, iny, sets, i):
                return inx, iny, True
    return nearest_crossing(px, py, sets, i)


@kernel
def nearest_to_anchor(sets: FloatArray, i: int) -> Candidate:
    """Nearest point of set i to the centre of its least disc, and whether the set has a point."""
    k = DISCS[1] if sets[i, DISCS[1] + 2] < sets[i, DISCS[0] + 2] else DISCS[0]
    k = DISCS[2] if sets[i, DISCS[2] + 2] < sets[i, k + 2] else k
    return nearest(sets[i, k], sets[i, k + 1], sets, i)


@kernel
def projected(px: float, py: float, sets: FloatArray, i: int) -> Candidate:
    """`nearest`, and for slivers as thin as rounding, which have candidates only from within."""
    x, y, exists = nearest(px, py, sets, i)
    if not exists:
        x, y, exists = nearest_to_anchor(sets, i)
    return x, y, exists


@kernel
def fix(x: float, y: float, sets: FloatArray, i: int) -> None:
    """Make set i a point: a box of zero width, with the discs absent."""
    sets[i, 0], sets[i, 1], sets[i, 2], sets[i, 3] = x, y, x, y
    for k in DISCS:
        sets[i, k + 2] = math.inf


@kernel
def approach(sets: FloatArray, i: int) -> bool:
    """Make set i its point nearest to disc 1, regardless of that disc; False if it has none."""
    sets[i, DISCS[1] + 2] = math.inf
    x, y, exists = projected(sets[i, DISCS[1]], sets[i, DISCS[1] + 1], sets, i)
    fix(x, y, sets, i)
    return exists


@kernel
def nearest_crossing(px: float, py: float, sets: FloatArray, i: int) -> Candidate:
    """Nearest feasible crossing of circles with lines of the box or with each other."""
    best = (px, py, False)
    for k in DISCS:
        cx, cy, r = sets[i, k], sets[i, k + 1], sets[i, k + 2]
        if r < math.inf:
            for side in range(4):
                line, across = sets[i, side], cy if side % 2 == 0 else cx
                half = half_chord(line, cx if side % 2 == 0 else cy, r)
                if half >= 0.0:
                    for end in (across - half, across + half):
                        x, y = (line, end) if side % 2 == 0 else (end, line)
                        best = nearer(x, y, px, py, sets, i, best)
    for first, second in PAIRS:
        if sets[i, first + 2] < math.inf and sets[i, second + 2] < math.inf:
            best = nearest_of_circles(px, py, sets, i, (first, second), best)
    return best


@kernel
def nearest_of_circles(
    px: float, py: float, sets: FloatArray, i: int, pair: tuple[int, int], best: Candidate
) -> Candidate:
    """The nearer feasible crossing of two circles, if it is nearer than `best`."""
    # from the smaller circle: an error of `along`, however large, keeps the points on it, and
    # takes them off the larger one by the order of rounding only
    small, large = pair
    if sets[i, large + 2] < sets[i, small + 2]:
        small, large = large, small
    cx, cy, r = sets[i, small], sets[i, small + 1], sets[i, small + 2]
    dx, dy, radius = sets[i, large] - cx, sets[i, large + 1] - cy, sets[i, large + 2]
    distance = math.sqrt(dx * dx + dy * dy)
    if distance > 0.0:
        along = 0.5 * distance + (r - radius) * ((r + radius) / (2.0 * distance))
        along = clip(along, -r, r)
        across = math.sqrt(r - along) * math.sqrt(r + along)
        ux, uy = dx / distance, dy / distance
        x, y = cx + along * ux, cy + along * uy
        best = nearer(x - across * uy, y + across * ux, px, py, sets, i, best)
        best = nearer(x + across * uy, y - across * ux, px, py, sets, i, best)
    return best


@kernel
def violation(x: float, y: float, sets: FloatArray, i: int) -> float:
    """Largest distance of a point to the box or a disc of set i; 0 inside, NaN for NaN."""
    dx = x - clip(x, sets[i, 0], sets[i, 2])
    dy = y - clip(y, sets[i, 1], sets[i, 3])
    largest = math.sqrt(dx * dx + dy * dy) if dx != 0.0 or dy != 0.0 else 0.0
    for k in DISCS:
        dx, dy, r = x - sets[i, k], y - sets[i, k + 1], sets[i, k + 2]
        square = dx * dx + dy * dy
        if square > r * r:  # so that most need no root
            largest = max(largest, math.sqrt(square) - r)
    return largest + 0.0 * (x + y)


@kernel
def nearest_batch(
    points: FloatArray, sets: FloatArray, projections: FloatArray, exists: BoolArray
) -> None:
    """Write the nearest points (M, 2) of sets (M, 13), and whether they exist (M,).

    A point that is not finite gives NaN, which counts as existing.
    """
    for i in range(points.shape[0]):
        if math.isfinite(points[i, 0]) and math.isfinite(points[i, 1]):
            x, y, exists[i] = projected(points[i, 0], points[i, 1], sets, i)
            projections[i, 0], projections[i, 1] = x, y
        else:
            projections[i, 0], projections[i, 1], exists[i] = math.nan, math.nan, True


@kernel
def empty_batch(sets: FloatArray, empty: BoolArray) -> None:
    """Write which sets (M, 13) are empty (M,)."""
    for i in range(sets.shape[0]):
        empty[i] = not nearest_to_anchor(sets, i)[2]


@kernel
def approach_batch(sets: FloatArray, exists: BoolArray) -> None:
    """Apply `approach` to sets (M, 13); write whether they had a point (M,)."""
    for i in range(sets.shape[0]):
        exists[i] = approach(sets, i)


@kernel
def violation_batch(points: FloatArray, sets: FloatArray, distances: FloatArray) -> None:
    """Write the largest distance (M,) of points (M, 2) to the box or a disc of sets (M, 13)."""
    for i in range(points.shape[0]):
        distances[i] = violation(points[i, 0], points[i, 1], sets, i)


@kernel
def motion_set(
    vx: float, vy: float, limits: FloatArray, member: int, sets: FloatArray, i: int
) -> None:
    """Write set i: the velocities that a member's limits allow after (vx, vy).

    `limits` (k, 3) have a row for every member, or one for all: bounds on the components of
    velocities, on their change, and on their length.
    """
    k = member % limits.shape[0]
    v_max, change, speed = limits[k, 0], limits[k, 1], limits[k, 2]
    sets[i, 0], sets[i, 1], sets[i, 2], sets[i, 3] = -v_max, -v_max, v_max, v_max
    sets[i, 4], sets[i, 5], sets[i, 6] = vx, vy, change
    sets[i, 7], sets[i, 8], sets[i, 9] = 0.0, 0.0, math.inf
    sets[i, 10], sets[i, 11], sets[i, 12] = 0.0, 0.0, speed


@kernel
def motion_sets(previous_velocities: FloatArray, limits: FloatArray, sets: FloatArray) -> None:
    """Write the sets (M, 13) of members, in order and again, with previous velocities (M, 2)."""
    for i in range(sets.shape[0]):
        motion_set(previous_velocities[i, 0], previous_velocities[i, 1], limits, i, sets, i)


@kernel
def project_adjoint(
    commanded: FloatArray,
    previous: FloatArray,
    projected: FloatArray,
    limits: FloatArray,
    seeds: FloatArray,
    to_commanded: FloatArray,
    to_previous: FloatArray,
) -> None:
    """Write the products of seeds with the derivatives of M projections; arrays are (M, 2).

    `limits` are those of the members, in order and again, as of `motion_sets`.

    The projection q of p on a box and the disc of radius r around c is the clip of p to the box,
    the point c + r (p - c) / |p - c| of the circle, or a crossing of the circle with a line of the
    box, which does not depend on p: see `casswarm.motion.planar`. At ties of these cases, which are
    of measure zero, the derivative is that of one of them.
    """
    for m in range(commanded.shape[0]):
        v_max = limits[m % limits.shape[0], 0]
        px, py, cx, cy = commanded[m, 0], commanded[m, 1], previous[m, 0], previous[m, 1]
        qx, qy, sx, sy = projected[m, 0], projected[m, 1], seeds[m, 0], seeds[m, 1]
        to_commanded[m, 0], to_commanded[m, 1] = 0.0, 0.0
        to_previous[m, 0], to_previous[m, 1] = 0.0, 0.0
        inx, iny = min(max(px, -v_max), v_max), min(max(py, -v_max), v_max)
        if qx == inx and qy == iny:
            to_commanded[m, 0] = sx if px == inx else 0.0
            to_commanded[m, 1] = sy if py == iny else 0.0
        elif abs(qx) < v_max and abs(qy) < v_max:
            dx, dy = px - cx, py - cy
            distance = math.sqrt(dx * dx + dy * dy)
            ux, uy = dx / distance, dy / distance
            radius = (qx - cx) * ux + (qy - cy) * uy
            along = sx * ux + sy * uy
            gx, gy = radius / distance * (sx - along * ux), radius / distance * (sy - along * uy)
            to_commanded[m, 0], to_commanded[m, 1] = gx, gy
            to_previous[m, 0], to_previous[m, 1] = sx - gx, sy - gy
        elif abs(qy) < v_max:  # q = (line, c_y +- sqrt(r^2 - (line - c_x)^2))
            to_previous[m, 1] = sy
            if qy != cy:
                to_previous[m, 0] = sy * (qx - cx) / (qy - cy)
        elif abs(qx) < v_max:
            to_previous[m, 0] = sx
            if qx != cx:
                to_previous[m, 1] = sx * (qy - cy) / (qx - cx)
