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
from .lane_objective_kernels import (
    ALIVE,
    EAST,
    GRADIENT_EAST,
    GRADIENT_NORTH,
    LANES,
    NORTH,
    ROWS,
    WEIGHT,
)
from .spectral_kernels import LONGEST, MEMORY, SHORTEST, SUFFICIENT

SET_ROWS, MOTION_ROWS, NUMBER_ROWS = 13, 31, 14

LEFT, LOW, RIGHT, HIGH, A_X, A_Y, A_R, B_X, B_Y, B_R, C_X, C_Y, C_R = range(
    0, SET_ROWS * LANES, LANES
)
"""Where the rows of a member's set begin: its box and three discs, as in `planar_kernels`."""

U_X, U_Y, V_X, V_Y, IN_A, IN_B, IN_C, AT_BOX = range(C_R + LANES, 21 * LANES, LANES)
"""Crossings of the first two circles; how far a point may be from the discs' centres, squared, and
from the box, to be in them up to rounding."""

FROM_X, FROM_Y, AT_X, AT_Y, G_X, G_Y, DIRECTION_X, DIRECTION_Y, TRIED_X, TRIED_Y = range(
    AT_BOX + LANES, MOTION_ROWS * LANES, LANES
)
"""Position, velocity, gradient, direction, and velocity of the trial."""

F, DESCENT, LENGTH, METRIC, UNIT, DT, ITERATIONS, FRESH, ACCEPTED = range(0, 9 * LANES, LANES)
SQUARES, CURVATURES, LARGEST, REFERENCE, STEP = range(9 * LANES, NUMBER_ROWS * LANES, LANES)
"""Rows of the numbers of lanes."""

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
            length, dt = numbers[LENGTH + k], numbers[DT + k]
            vx = motion[AT_X + k] + length * motion[DIRECTION_X + k]
            vy = motion[AT_Y + k] + length * motion[DIRECTION_Y + k]
            motion[TRIED_X + k], motion[TRIED_Y + k] = vx, vy
            member[EAST + k] = motion[FROM_X + k] + dt * vx
            member[NORTH + k] = motion[FROM_Y + k] + dt * vy


@kernel
def accept_trials(lanes: Lanes, active: int, place: int) -> None:
    """Write which trials are accepted, and the lengths of the next where they are not.

    Objectives that are accepted are kept at a place of the history.
    """
    numbers, values, history = lanes.numbers, lanes.values, lanes.history
    for k in range(active):
        numbers[REFERENCE + k] = -math.inf
    for c in range(history.size // LANES):
        row = history[c * LANES :]
        for k in range(active):
            numbers[REFERENCE + k] = max(numbers[REFERENCE + k], row[k])
    row = history[place * LANES :]
    for k in range(active):
        f, slope = numbers[F + k], numbers[DESCENT + k]
        reference, length = numbers[REFERENCE + k], numbers[LENGTH + k]
        trial_f, fresh = values[k], numbers[FRESH + k] > 0.0
        accepted = fresh or trial_f <= reference + SUFFICIENT * length * slope
        quadratic = -0.5 * length * length * slope / (trial_f - f - length * slope)
        within = 0.1 * length <= quadratic and quadratic <= 0.9 * length
        quadratic = quadratic if within else 0.5 * length
        numbers[ACCEPTED + k] = 1.0 if accepted else 0.0
        numbers[LENGTH + k] = 1.0 if accepted else quadratic
        numbers[F + k] = trial_f if accepted else f
        numbers[SQUARES + k], numbers[CURVATURES + k] = 0.0, 0.0
        numbers[LARGEST + k] = 0.0
        row[k] = trial_f if accepted else row[k]


@kernel
def take_steps(lanes: Lanes, active: int) -> None:
    """Accept trials, and write spectral step sizes and the points that are to be projected."""
    numbers, n = lanes.numbers, lanes.members.size // (ROWS * LANES)
    for i in range(n):
        member, motion = lanes.members[i * ROWS * LANES :], lanes.motions[i * MOTION_ROWS * LANES :]
        for k in range(active):
            accepted, dt = numbers[ACCEPTED + k] > 0.0, numbers[DT + k]
            x, y = motion[AT_X + k], motion[AT_Y + k]
            sx, sy = motion[TRIED_X + k] - x, motion[TRIED_Y + k] - y
            gx, gy = motion[G_X + k], motion[G_Y + k]
            new_gx, new_gy = dt * member[GRADIENT_EAST + k], dt * member[GRADIENT_NORTH + k]
            numbers[SQUARES + k] += sx * sx + sy * sy
            numbers[CURVATURES + k] += sx * (new_gx - gx) + sy * (new_gy - gy)
            gx, gy = new_gx if accepted else gx, new_gy if accepted else gy
            numbers[LARGEST + k] = max(numbers[LARGEST + k], gx * gx + gy * gy)
            motion[G_X + k], motion[G_Y + k] = gx, gy
            motion[AT_X + k] = motion[TRIED_X + k] if accepted else x
            motion[AT_Y + k] = motion[TRIED_Y + k] if accepted else y
    for k in range(active):
        metric, curvature = numbers[METRIC + k], numbers[CURVATURES + k]
        spectral = numbers[SQUARES + k] / max(abs(curvature), TINY)
        first = numbers[UNIT + k] / math.sqrt(max(numbers[LARGEST + k], TINY))
        spectral = first if numbers[FRESH + k] > 0.0 else spectral
        spectral = min(max(spectral, SHORTEST * metric), LONGEST * metric)
        accepted = numbers[ACCEPTED + k] > 0.0
        numbers[STEP + k] = spectral if accepted else numbers[STEP + k]
        numbers[DESCENT + k], numbers[LARGEST + k] = 0.0, 0.0
    for i in range(n):
        motion = lanes.motions[i * MOTION_ROWS * LANES :]
        for k in range(active):
            step = numbers[STEP + k]
            motion[DIRECTION_X + k] = motion[AT_X + k] - step * motion[G_X + k]
            motion[DIRECTION_Y + k] = motion[AT_Y + k] - step * motion[G_Y + k]


@kernel
def project_lanes(motion: FloatArray, active: int, unresolved: FloatArray) -> float:
    """Replace the points in the place of directions by the nearest ones of a member's sets.

    The box and the first two discs, where the nearest point of one of them or of the two discs is
    in all; elsewhere the lane is marked. Returns the number of these.
    """
    marked = 0.0
    for k in range(active):
        px, py = motion[DIRECTION_X + k], motion[DIRECTION_Y + k]
        left, low = motion[LEFT + k], motion[LOW + k]
        right, high = motion[RIGHT + k], motion[HIGH + k]
        ax, ay, ar = motion[A_X + k], motion[A_Y + k], motion[A_R + k]
        bx, by, br = motion[B_X + k], motion[B_Y + k], motion[B_R + k]
        within_a, within_b = motion[IN_A + k], motion[IN_B + k]
        within_c, beside = motion[IN_C + k], motion[AT_BOX + k]
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
        ux, uy = motion[U_X + k], motion[U_Y + k]
        vx, vy = motion[V_X + k], motion[V_Y + k]
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
        dx, dy = sx - motion[C_X + k], sy - motion[C_Y + k]
        resolved = max(abs(sx - qx), abs(sy - qy)) <= beside and dx * dx + dy * dy <= within_c
        motion[DIRECTION_X + k] = sx if resolved else px
        motion[DIRECTION_Y + k] = sy if resolved else py
        unresolved[k] = 0.0 if resolved else 1.0
    for k in range(active):
        marked += unresolved[k]
    return marked


@kernel
def project_alone(motion: FloatArray, k: int, own_set: FloatArray) -> None:
    """Replace a lane's point like `project_lanes`, whatever the case."""
    for c in range(SET_ROWS):
        own_set[0, c] = motion[c * LANES + k]
    x, y = motion[DIRECTION_X + k], motion[DIRECTION_Y + k]
    px, py, exists = nearest(x, y, own_set, 0)
    if not exists:
        px = min(max(x, own_set[0, 0]), own_set[0, 2])
        py = min(max(y, own_set[0, 1]), own_set[0, 3])
    motion[DIRECTION_X + k], motion[DIRECTION_Y + k] = px, py


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
            dx = motion[DIRECTION_X + k] - motion[AT_X + k]
            dy = motion[DIRECTION_Y + k] - motion[AT_Y + k]
            motion[DIRECTION_X + k], motion[DIRECTION_Y + k] = dx, dy
            numbers[DESCENT + k] += dx * motion[G_X + k] + dy * motion[G_Y + k]
            numbers[LARGEST + k] = max(numbers[LARGEST + k], dx * dx + dy * dy)


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
    iterations: int


class Jobs(NamedTuple):
    """Starts of B problems to be improved in lanes."""

    p: FloatArray  # (B, 6n + 4)
    sets: FloatArray  # (B, n, 13)
    scale: FloatArray  # (B, 2)
    tasks: Tasks
    size: int  # number of tasks, the first ones
    limits: Limits


@kernel
def load(lanes: Lanes, k: int, jobs: Jobs, job: int) -> None:
    """Let a lane begin a job."""
    n, row = jobs.sets.shape[1], jobs.tasks.problem[job]
    p, x, numbers = jobs.p[row], jobs.tasks.x[job], lanes.numbers
    lanes.job[k] = job
    for i in range(n):
        member, motion = lanes.members[i * ROWS * LANES :], lanes.motions[i * MOTION_ROWS * LANES :]
        member[ALIVE + k], member[WEIGHT + k] = p[4 * n + i], p[5 * n + i]
        for c in range(SET_ROWS):
            motion[c * LANES + k] = jobs.sets[row, i, c]
        write_crossings(motion, k)
        write_tolerances(motion, k)
        motion[FROM_X + k], motion[FROM_Y + k] = p[2 * i], p[2 * i + 1]
        motion[AT_X + k], motion[AT_Y + k] = x[2 * i], x[2 * i + 1]
        motion[G_X + k], motion[G_Y + k] = 0.0, 0.0
        motion[DIRECTION_X + k], motion[DIRECTION_Y + k] = 0.0, 0.0
    unit = jobs.scale[row, 0]
    numbers[UNIT + k], numbers[METRIC + k] = unit, unit * unit / jobs.scale[row, 1]
    numbers[FRESH + k], numbers[LENGTH + k] = 1.0, 1.0
    numbers[F + k], numbers[DESCENT + k] = 0.0, 0.0
    numbers[ITERATIONS + k], numbers[DT + k] = 0.0, p[6 * n + 2]
    for c in range(MEMORY):
        lanes.history[c * LANES + k] = -math.inf


@kernel
def write_crossings(motion: FloatArray, k: int) -> None:
    """Write the points where a member's first two circles cross; NaN where they do not."""
    small, large = (B_X, A_X) if motion[B_R + k] < motion[A_R + k] else (A_X, B_X)
    cx, cy, r = motion[small + k], motion[small + LANES + k], motion[small + 2 * LANES + k]
    dx, dy = motion[large + k] - cx, motion[large + LANES + k] - cy
    distance, radius = math.sqrt(dx * dx + dy * dy), motion[large + 2 * LANES + k]
    along = 0.5 * distance + (r - radius) * ((r + radius) / (2.0 * distance))
    across = math.nan
    if distance > 0.0 and radius < math.inf and -r <= along <= r:
        across = math.sqrt(r - along) * math.sqrt(r + along)
    ux, uy = dx / distance, dy / distance
    cx, cy = cx + along * ux, cy + along * uy
    motion[U_X + k], motion[U_Y + k] = cx - across * uy, cy + across * ux
    motion[V_X + k], motion[V_Y + k] = cx + across * uy, cy - across * ux


@kernel
def write_tolerances(motion: FloatArray, k: int) -> None:
    """Write up to what distances points count as in the discs and the box: up to rounding."""
    for x, within in ((A_X, IN_A), (B_X, IN_B), (C_X, IN_C)):
        radius = motion[x + 2 * LANES + k]
        size = max(abs(motion[x + k]), abs(motion[x + LANES + k])) + radius
        radius += 2.0 * ROUNDING * size
        motion[within + k] = radius * radius
    largest = 0.0
    for side in (LEFT, LOW, RIGHT, HIGH):
        largest = max(largest, abs(motion[side + k]))
    motion[AT_BOX + k] = ROUNDING * largest


@kernel
def store(lanes: Lanes, k: int, jobs: Jobs) -> None:
    """Write the end of a lane's job."""
    job, tasks = lanes.job[k], jobs.tasks
    for i in range(jobs.sets.shape[1]):
        motion = lanes.motions[i * MOTION_ROWS * LANES :]
        tasks.x[job, 2 * i], tasks.x[job, 2 * i + 1] = motion[AT_X + k], motion[AT_Y + k]
    tasks.f[job] = lanes.numbers[F + k] + 0.0 * lanes.numbers[DESCENT + k]
    tasks.counts[job, 0] = tasks.counts[job, 1] = int(lanes.numbers[ITERATIONS + k])


@kernel
def move(lanes: Lanes, source: int, target: int) -> None:
    """Let a lane take over what another one does."""
    for rows in (lanes.members, lanes.motions, lanes.numbers, lanes.history):
        for first in range(0, rows.size, LANES):
            rows[first + target] = rows[first + source]
    lanes.job[target] = lanes.job[source]


@kernel
def has_ended(lanes: Lanes, k: int, jobs: Jobs) -> bool:
    """Count a lane's step; return True if it has converged, is exhausted or not finite."""
    numbers = lanes.numbers
    numbers[FRESH + k] = 0.0
    numbers[ITERATIONS + k] += 1.0
    limit = jobs.limits.tolerance * numbers[UNIT + k]
    limit *= min(1.0, numbers[STEP + k] / numbers[METRIC + k])
    if numbers[LARGEST + k] <= limit * limit:
        return True
    f, slope = numbers[F + k], numbers[DESCENT + k]
    if -slope <= jobs.limits.decrease * abs(f):
        return True
    return numbers[ITERATIONS + k] >= jobs.limits.iterations or not math.isfinite(f + slope)


@kernel
def solve_jobs(evaluate: Any, constants: FloatArray, jobs: Jobs, lanes: Lanes) -> None:
    """Improve the starts."""
    active, following, iterations = min(LANES, jobs.size), 0, 0
    while following < active:
        load(lanes, following, jobs, following)
        following += 1
    while active > 0:
        take_trials(lanes, active)
        evaluate(lanes.members, lanes.values[:active], constants, lanes.values, lanes.pairs)
        accept_trials(lanes, active, iterations % MEMORY)
        take_steps(lanes, active)
        directions(lanes, active)
        iterations, k = iterations + 1, 0
        while k < active:
            if not has_ended(lanes, k, jobs):
                k += 1
                continue
            store(lanes, k, jobs)
            if following < jobs.size:
                load(lanes, k, jobs, following)
                following, k = following + 1, k + 1
            else:  # the last lane makes room, and is looked at next
                active -= 1
                move(lanes, active, k)
