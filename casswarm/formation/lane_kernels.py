"""The spectral projected gradient method for several problems at a time, in lanes.

A row has a number of every lane, and operations on rows are vector instructions: the objective
(`lane_objective_kernels`), the projection and the line search, with selections in place of
branches. A lane takes its next problem when it has ended, and lanes that find none left make
room. What happens in a lane does not depend on the others, to the last bit.

The method is that of `casswarm.formation.search_kernels`, without Newton steps.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from ..compiled.kernels import allocating_kernel, kernel
from ..motion.planar_kernels import ROUNDING, nearest
from ..typing import FloatArray, IntArray
from .lane_objective_kernels import ALIVE, EAST, LANES, NORTH, PULL_EAST, PULL_NORTH, ROWS, WEIGHT
from .spectral_kernels import LONGEST, MEMORY, SHORTEST, SUFFICIENT

BOX, CORNERS, WITHIN, FROM, AT, SLOPE, WAY, TRIED = 0, 13, 17, 21, 23, 25, 27, 29
"""Rows of a member's motion: set (see `planar_kernels`), crossings of its first two circles, how
far a point may be from the discs' centres (squared) and from the box to be in them up to rounding,
position, velocity, gradient, direction, and velocity of the trial."""

MOTION_ROWS = 31

F, DESCENT, LENGTH, METRIC, UNIT, DT, TICKS, FRESH, ACCEPTED = range(9)
SQUARES, CURVATURES, FARTHEST, REFERENCE, STEP = range(9, 14)
"""Rows of the numbers of lanes."""

NUMBER_ROWS = 14

TINY = 1e-300  # a positive number, in place of zero


class Lanes(NamedTuple):
    """Arrays of the lanes, rows by `LANES`."""

    members: FloatArray  # (n, ROWS, LANES), see `lane_objective_kernels`
    motions: FloatArray  # (n, MOTION_ROWS, LANES)
    numbers: FloatArray  # (NUMBER_ROWS, LANES)
    history: FloatArray  # (MEMORY, LANES), the last objectives
    values: FloatArray  # (LANES,)
    pairs: FloatArray  # (n (n - 1) LANES,)
    job: IntArray  # (LANES,)
    own_set: FloatArray  # (1, 13)


@allocating_kernel
def empty_lanes(n: int) -> Lanes:
    """Arrays for n members."""
    return Lanes(
        np.zeros(n * ROWS * LANES),
        np.zeros(n * MOTION_ROWS * LANES),
        np.zeros(NUMBER_ROWS * LANES),
        np.zeros(MEMORY * LANES),
        np.zeros(LANES),
        np.zeros(n * n * LANES + LANES),
        np.zeros(LANES, np.int64),
        np.zeros((1, 13)),
    )


@kernel
def take_trials(lanes: Lanes, active: int) -> None:
    """Write the velocities and positions of the trials."""
    numbers = lanes.numbers
    n = lanes.members.size // (ROWS * LANES)
    for i in range(n):
        member, motion = lanes.members[i * ROWS * LANES :], lanes.motions[i * MOTION_ROWS * LANES :]
        for k in range(active):
            length, dt = numbers[LENGTH * LANES + k], numbers[DT * LANES + k]
            vx = motion[AT * LANES + k] + length * motion[WAY * LANES + k]
            vy = motion[(AT + 1) * LANES + k] + length * motion[(WAY + 1) * LANES + k]
            motion[TRIED * LANES + k], motion[(TRIED + 1) * LANES + k] = vx, vy
            member[EAST + k] = motion[FROM * LANES + k] + dt * vx
            member[NORTH + k] = motion[(FROM + 1) * LANES + k] + dt * vy


@kernel
def judge(lanes: Lanes, active: int, place: int) -> None:
    """Write which trials are accepted, and the lengths of the next where they are not.

    Objectives that are accepted are kept at a place of the history.
    """
    numbers, values, history = lanes.numbers, lanes.values, lanes.history
    for k in range(active):
        numbers[REFERENCE * LANES + k] = -math.inf
    for c in range(history.size // LANES):
        row = history[c * LANES :]
        for k in range(active):
            numbers[REFERENCE * LANES + k] = max(numbers[REFERENCE * LANES + k], row[k])
    row = history[place * LANES :]
    for k in range(active):
        f, slope = numbers[F * LANES + k], numbers[DESCENT * LANES + k]
        reference, length = numbers[REFERENCE * LANES + k], numbers[LENGTH * LANES + k]
        trial_f, fresh = values[k], numbers[FRESH * LANES + k] > 0.0
        accepted = fresh or trial_f <= reference + SUFFICIENT * length * slope
        quadratic = -0.5 * length * length * slope / (trial_f - f - length * slope)
        within = 0.1 * length <= quadratic and quadratic <= 0.9 * length
        quadratic = quadratic if within else 0.5 * length
        numbers[ACCEPTED * LANES + k] = 1.0 if accepted else 0.0
        numbers[LENGTH * LANES + k] = 1.0 if accepted else quadratic
        numbers[F * LANES + k] = trial_f if accepted else f
        numbers[SQUARES * LANES + k], numbers[CURVATURES * LANES + k] = 0.0, 0.0
        numbers[FARTHEST * LANES + k] = 0.0
        row[k] = trial_f if accepted else row[k]


@kernel
def take_steps(lanes: Lanes, active: int) -> None:
    """Accept trials, and write spectral step sizes and the points that are to be projected."""
    numbers, n = lanes.numbers, lanes.members.size // (ROWS * LANES)
    for i in range(n):
        member, motion = lanes.members[i * ROWS * LANES :], lanes.motions[i * MOTION_ROWS * LANES :]
        for k in range(active):
            accepted, dt = numbers[ACCEPTED * LANES + k] > 0.0, numbers[DT * LANES + k]
            x, y = motion[AT * LANES + k], motion[(AT + 1) * LANES + k]
            sx, sy = motion[TRIED * LANES + k] - x, motion[(TRIED + 1) * LANES + k] - y
            gx, gy = motion[SLOPE * LANES + k], motion[(SLOPE + 1) * LANES + k]
            new_gx, new_gy = dt * member[PULL_EAST + k], dt * member[PULL_NORTH + k]
            numbers[SQUARES * LANES + k] += sx * sx + sy * sy
            numbers[CURVATURES * LANES + k] += sx * (new_gx - gx) + sy * (new_gy - gy)
            gx, gy = new_gx if accepted else gx, new_gy if accepted else gy
            numbers[FARTHEST * LANES + k] = max(numbers[FARTHEST * LANES + k], gx * gx + gy * gy)
            motion[SLOPE * LANES + k], motion[(SLOPE + 1) * LANES + k] = gx, gy
            motion[AT * LANES + k] = motion[TRIED * LANES + k] if accepted else x
            motion[(AT + 1) * LANES + k] = motion[(TRIED + 1) * LANES + k] if accepted else y
    for k in range(active):
        metric, curvature = numbers[METRIC * LANES + k], numbers[CURVATURES * LANES + k]
        spectral = numbers[SQUARES * LANES + k] / max(abs(curvature), TINY)
        first = numbers[UNIT * LANES + k] / math.sqrt(max(numbers[FARTHEST * LANES + k], TINY))
        spectral = first if numbers[FRESH * LANES + k] > 0.0 else spectral
        spectral = min(max(spectral, SHORTEST * metric), LONGEST * metric)
        accepted = numbers[ACCEPTED * LANES + k] > 0.0
        numbers[STEP * LANES + k] = spectral if accepted else numbers[STEP * LANES + k]
        numbers[DESCENT * LANES + k], numbers[FARTHEST * LANES + k] = 0.0, 0.0
    for i in range(n):
        motion = lanes.motions[i * MOTION_ROWS * LANES :]
        for k in range(active):
            step = numbers[STEP * LANES + k]
            motion[WAY * LANES + k] = motion[AT * LANES + k] - step * motion[SLOPE * LANES + k]
            motion[(WAY + 1) * LANES + k] = (
                motion[(AT + 1) * LANES + k] - step * motion[(SLOPE + 1) * LANES + k]
            )


@kernel
def project_lanes(motion: FloatArray, active: int, unresolved: FloatArray) -> float:
    """Replace the points in `WAY` by the nearest ones of a member's sets.

    The box and the first two discs, where the nearest point of one of them or of the two discs is
    in all; elsewhere the lane is marked. Returns the number of these.
    """
    marked = 0.0
    for k in range(active):
        px, py = motion[WAY * LANES + k], motion[(WAY + 1) * LANES + k]
        left, low = motion[k], motion[LANES + k]
        right, high = motion[2 * LANES + k], motion[3 * LANES + k]
        ax, ay, ar = motion[4 * LANES + k], motion[5 * LANES + k], motion[6 * LANES + k]
        bx, by, br = motion[7 * LANES + k], motion[8 * LANES + k], motion[9 * LANES + k]
        within_a, within_b = motion[WITHIN * LANES + k], motion[(WITHIN + 1) * LANES + k]
        within_c, beside = motion[(WITHIN + 2) * LANES + k], motion[(WITHIN + 3) * LANES + k]
        # the nearest point of the two discs: of the first, of the second, or a crossing
        dx, dy = px - ax, py - ay
        square = dx * dx + dy * dy
        outside, ratio = square > ar * ar, ar / math.sqrt(square)
        qx, qy = ax + ratio * dx if outside else px, ay + ratio * dy if outside else py
        dx, dy = qx - bx, qy - by
        of_first = dx * dx + dy * dy <= within_b
        dx, dy = px - bx, py - by
        ratio = br / math.sqrt(dx * dx + dy * dy)
        sx, sy = bx + ratio * dx, by + ratio * dy
        dx, dy = sx - ax, sy - ay
        of_second = dx * dx + dy * dy <= within_a
        ux, uy = motion[CORNERS * LANES + k], motion[(CORNERS + 1) * LANES + k]
        vx, vy = motion[(CORNERS + 2) * LANES + k], motion[(CORNERS + 3) * LANES + k]
        dx, dy, ex, ey = px - ux, py - uy, px - vx, py - vy
        nearer = dx * dx + dy * dy <= ex * ex + ey * ey
        ux, uy = ux if nearer else vx, uy if nearer else vy
        ux, uy = sx if of_second else ux, sy if of_second else uy
        qx, qy = qx if of_first else ux, qy if of_first else uy
        # or the nearest point of the box, if it is in the discs
        sx, sy = min(max(px, left), right), min(max(py, low), high)
        dx, dy, ex, ey = sx - ax, sy - ay, sx - bx, sy - by
        of_box = dx * dx + dy * dy <= within_a and ex * ex + ey * ey <= within_b
        qx, qy = sx if of_box else qx, sy if of_box else qy
        sx, sy = min(max(qx, left), right), min(max(qy, low), high)
        dx, dy = sx - motion[10 * LANES + k], sy - motion[11 * LANES + k]
        resolved = max(abs(sx - qx), abs(sy - qy)) <= beside and dx * dx + dy * dy <= within_c
        motion[WAY * LANES + k] = sx if resolved else px
        motion[(WAY + 1) * LANES + k] = sy if resolved else py
        unresolved[k] = 0.0 if resolved else 1.0
    for k in range(active):
        marked += unresolved[k]
    return marked


@kernel
def project_alone(motion: FloatArray, k: int, own_set: FloatArray) -> None:
    """Replace a lane's point in `WAY` by the nearest one of the member's set, whatever its case."""
    for c in range(13):
        own_set[0, c] = motion[c * LANES + k]
    x, y = motion[WAY * LANES + k], motion[(WAY + 1) * LANES + k]
    px, py, exists = nearest(x, y, own_set, 0)
    if not exists:
        px = min(max(x, own_set[0, 0]), own_set[0, 2])
        py = min(max(y, own_set[0, 1]), own_set[0, 3])
    motion[WAY * LANES + k], motion[(WAY + 1) * LANES + k] = px, py


@kernel
def directions(lanes: Lanes, active: int) -> None:
    """Project the points, and write the directions to them, their slopes and largest lengths."""
    numbers, n = lanes.numbers, lanes.members.size // (ROWS * LANES)
    for i in range(n):
        motion = lanes.motions[i * MOTION_ROWS * LANES :]
        unresolved = lanes.values
        if project_lanes(motion, active, unresolved) > 0.0:
            for k in range(active):
                if unresolved[k] > 0.0:
                    project_alone(motion, k, lanes.own_set)
        for k in range(active):
            dx = motion[WAY * LANES + k] - motion[AT * LANES + k]
            dy = motion[(WAY + 1) * LANES + k] - motion[(AT + 1) * LANES + k]
            motion[WAY * LANES + k], motion[(WAY + 1) * LANES + k] = dx, dy
            numbers[DESCENT * LANES + k] += (
                dx * motion[SLOPE * LANES + k] + dy * motion[(SLOPE + 1) * LANES + k]
            )
            numbers[FARTHEST * LANES + k] = max(numbers[FARTHEST * LANES + k], dx * dx + dy * dy)


class Tasks(NamedTuple):
    """J starts that are to be improved."""

    problem: IntArray  # (J,), which problem a start is of
    x: FloatArray  # (J, 2n), feasible starts, which the ends replace
    f: FloatArray  # (J,), objectives of the ends; not finite where one of a step is not
    counts: IntArray  # (J, 2), iterations and evaluations


class Limits(NamedTuple):
    """Where a lane ends."""

    tolerance: float  # longest member's part of a step, as of `search_kernels.converged`
    decrease: float  # predicted by the step, relative to the objective
    ticks: int


class Jobs(NamedTuple):
    """Starts of B problems to be improved in lanes."""

    p: FloatArray  # (B, 6n + 4)
    sets: FloatArray  # (B, n, 13)
    scale: FloatArray  # (B, 2)
    tasks: Tasks
    count: int  # of tasks, the first ones
    limits: Limits


@kernel
def load(lanes: Lanes, k: int, jobs: Jobs, job: int) -> None:
    """Let a lane begin a job."""
    n, row = jobs.sets.shape[1], jobs.tasks.problem[job]
    p, numbers = jobs.p[row], lanes.numbers
    lanes.job[k] = job
    for i in range(n):
        member, motion = lanes.members[i * ROWS * LANES :], lanes.motions[i * MOTION_ROWS * LANES :]
        member[ALIVE + k], member[WEIGHT + k] = p[4 * n + i], p[5 * n + i]
        for c in range(13):
            motion[c * LANES + k] = jobs.sets[row, i, c]
        write_crossings(motion, k)
        write_tolerances(motion, k)
        for c in range(2):
            motion[(FROM + c) * LANES + k] = p[2 * i + c]
            motion[(AT + c) * LANES + k] = jobs.tasks.x[job, 2 * i + c]
            motion[(SLOPE + c) * LANES + k], motion[(WAY + c) * LANES + k] = 0.0, 0.0
    unit = jobs.scale[row, 0]
    numbers[UNIT * LANES + k], numbers[METRIC * LANES + k] = unit, unit * unit / jobs.scale[row, 1]
    numbers[FRESH * LANES + k], numbers[LENGTH * LANES + k] = 1.0, 1.0
    numbers[F * LANES + k], numbers[DESCENT * LANES + k] = 0.0, 0.0
    numbers[TICKS * LANES + k], numbers[DT * LANES + k] = 0.0, p[6 * n + 2]
    for c in range(MEMORY):
        lanes.history[c * LANES + k] = -math.inf


@kernel
def write_crossings(motion: FloatArray, k: int) -> None:
    """Write the points where a member's first two circles cross; NaN where they do not."""
    small, large = 4, 7
    if motion[9 * LANES + k] < motion[6 * LANES + k]:
        small, large = 7, 4
    cx, cy, r = (
        motion[small * LANES + k],
        motion[(small + 1) * LANES + k],
        motion[(small + 2) * LANES + k],
    )
    radius = motion[(large + 2) * LANES + k]
    dx, dy = motion[large * LANES + k] - cx, motion[(large + 1) * LANES + k] - cy
    distance = math.sqrt(dx * dx + dy * dy)
    along = 0.5 * distance + (r - radius) * ((r + radius) / (2.0 * distance))
    valid = distance > 0.0 and -r <= along and along <= r and radius < math.inf
    across = math.sqrt(max(r - along, 0.0)) * math.sqrt(max(r + along, 0.0)) if valid else math.nan
    ux, uy = dx / distance, dy / distance
    motion[CORNERS * LANES + k] = cx + along * ux - across * uy
    motion[(CORNERS + 1) * LANES + k] = cy + along * uy + across * ux
    motion[(CORNERS + 2) * LANES + k] = cx + along * ux + across * uy
    motion[(CORNERS + 3) * LANES + k] = cy + along * uy - across * ux


@kernel
def write_tolerances(motion: FloatArray, k: int) -> None:
    """Write up to what distances points count as in the discs and the box: up to rounding."""
    for disc in range(3):
        row = 4 + 3 * disc
        center = max(abs(motion[row * LANES + k]), abs(motion[(row + 1) * LANES + k]))
        radius = motion[(row + 2) * LANES + k]
        radius += ROUNDING * (2.0 * center + 2.0 * radius)
        motion[(WITHIN + disc) * LANES + k] = radius * radius
    largest = 0.0
    for side in range(4):
        largest = max(largest, abs(motion[side * LANES + k]))
    motion[(WITHIN + 3) * LANES + k] = ROUNDING * largest


@kernel
def store(lanes: Lanes, k: int, jobs: Jobs) -> None:
    """Write the end of a lane's job."""
    job = lanes.job[k]
    for i in range(jobs.sets.shape[1]):
        motion = lanes.motions[i * MOTION_ROWS * LANES :]
        for c in range(2):
            jobs.tasks.x[job, 2 * i + c] = motion[(AT + c) * LANES + k]
    jobs.tasks.f[job] = lanes.numbers[F * LANES + k] + 0.0 * lanes.numbers[DESCENT * LANES + k]
    ticks = int(lanes.numbers[TICKS * LANES + k])
    jobs.tasks.counts[job, 0], jobs.tasks.counts[job, 1] = ticks, ticks


@kernel
def move(lanes: Lanes, source: int, target: int) -> None:
    """Let a lane take over what another one does."""
    for c in range(lanes.members.size // LANES):
        lanes.members[c * LANES + target] = lanes.members[c * LANES + source]
    for c in range(lanes.motions.size // LANES):
        lanes.motions[c * LANES + target] = lanes.motions[c * LANES + source]
    for c in range(NUMBER_ROWS):
        lanes.numbers[c * LANES + target] = lanes.numbers[c * LANES + source]
    for c in range(MEMORY):
        lanes.history[c * LANES + target] = lanes.history[c * LANES + source]
    lanes.job[target] = lanes.job[source]


@kernel
def has_ended(lanes: Lanes, k: int, jobs: Jobs) -> bool:
    """Count a lane's step; return True if it has converged, is exhausted or not finite."""
    numbers = lanes.numbers
    numbers[FRESH * LANES + k] = 0.0
    numbers[TICKS * LANES + k] += 1.0
    limit = jobs.limits.tolerance * numbers[UNIT * LANES + k]
    limit *= min(1.0, numbers[STEP * LANES + k] / numbers[METRIC * LANES + k])
    if numbers[FARTHEST * LANES + k] <= limit * limit:
        return True
    f, slope = numbers[F * LANES + k], numbers[DESCENT * LANES + k]
    if -slope <= jobs.limits.decrease * abs(f):
        return True
    return numbers[TICKS * LANES + k] >= jobs.limits.ticks or not math.isfinite(f + slope)


@kernel
def solve_jobs(evaluate: Any, constants: FloatArray, jobs: Jobs, lanes: Lanes) -> None:
    """Improve the starts."""
    active, following, ticks = min(LANES, jobs.count), 0, 0
    while following < active:
        load(lanes, following, jobs, following)
        following += 1
    while active > 0:
        take_trials(lanes, active)
        evaluate(lanes.members, lanes.values[:active], constants, lanes.values, lanes.pairs)
        judge(lanes, active, ticks % MEMORY)
        take_steps(lanes, active)
        directions(lanes, active)
        ticks, k = ticks + 1, 0
        while k < active:
            if not has_ended(lanes, k, jobs):
                k += 1
                continue
            store(lanes, k, jobs)
            if following < jobs.count:
                load(lanes, k, jobs, following)
                following, k = following + 1, k + 1
            else:  # the last lane makes room, and is looked at next
                active -= 1
                move(lanes, active, k)
