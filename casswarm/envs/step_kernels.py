"""A step of many swarms at once: velocities, survivors, ends of runs, and potentials.

The transition of `casswarm.chain.transition` and the draws of `casswarm.chain.monte_carlo`, for
swarms that may be at different steps of different runs.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from ..chain.monte_carlo import write_uniforms
from ..compiled.kernels import kernel
from ..motion.planar_kernels import motion_set, projected, violation
from ..typing import BoolArray, FloatArray, IntArray

_ROUNDING = 2.0**-50  # more than the error of 1 - risk


class Swarms(NamedTuple):
    """State of B swarms of n members; the entries of those known to be lost are zero."""

    positions: FloatArray  # (B, n, 2), X(t)
    velocities: FloatArray  # (B, n, 2), V(t-1)
    alive: BoolArray  # (B, n)
    late: IntArray  # (B, n), steps until a loss is known; 0 for the living, and for known losses
    steps: IntArray  # (B,), t
    seeds: Any  # (B,) uint64, of the random numbers
    runs: Any  # likewise


class Moves(NamedTuple):
    """Motion of B swarms in a step: new positions, velocities, and rates."""

    positions: FloatArray  # (B, n, 2), X(t+1)
    velocities: FloatArray  # (B, n, 2), V(t)
    rates: FloatArray  # (B, n), at X(t+1)
    saturated: IntArray  # (B,), number of velocities that were projected


class Limits(NamedTuple):
    """Limits of motion with their tolerances, and the target and the horizon at which runs end.

    Velocities are executed as they are up to an excess of `allowed`, and counted above `counted`,
    both relative to v_max.
    """

    motion: FloatArray  # (n, 3) or (1, 3), as of `planar_kernels.motion_set`
    v_max: float
    allowed: float
    counted: float
    dt: float
    east: float
    north: float
    radius: float
    arrivals: int
    counting: BoolArray  # (n,)
    n_steps: int
    delay: int  # number of steps after which losses are known; n_steps for never


class Ends(NamedTuple):
    """Outcome of a step: arrival of a member, end of the run, and survivors."""

    success: BoolArray
    ended: BoolArray
    survivors: IntArray


@kernel
def move(
    actions: FloatArray,
    active: BoolArray,
    swarms: Swarms,
    limits: Limits,
    sets: FloatArray,
    moves: Moves,
) -> int:
    """Write where the active swarms move; return the first action that is not finite, or -1.

    The return value is the index of the state times n plus that of the member. `sets` (1, 13) is
    overwritten.
    """
    n = len(swarms.alive[0])
    for b in range(active.size):
        moves.saturated[b] = 0
        if not active[b]:
            continue
        for i in range(n):
            if not swarms.alive[b, i] and swarms.late[b, i] == 0:
                moves.velocities[b, i, 0], moves.velocities[b, i, 1] = 0.0, 0.0
                moves.positions[b, i, 0], moves.positions[b, i, 1] = 0.0, 0.0
                continue
            vx, vy = actions[b, i, 0], actions[b, i, 1]
            if not (math.isfinite(vx) and math.isfinite(vy)):
                return b * n + i
            previous = swarms.velocities[b, i]
            motion_set(previous[0], previous[1], limits.motion, i, sets, 0)
            excess = violation(vx, vy, sets, 0) / limits.v_max
            if excess > limits.allowed:
                vx, vy, _ = projected(vx, vy, sets, 0)
            if excess > limits.counted:
                moves.saturated[b] += 1
            moves.velocities[b, i, 0], moves.velocities[b, i, 1] = vx, vy
            moves.positions[b, i, 0] = swarms.positions[b, i, 0] + limits.dt * vx
            moves.positions[b, i, 1] = swarms.positions[b, i, 1] + limits.dt * vy
    return -1


@kernel
def advance(
    active: BoolArray,
    swarms: Swarms,
    moves: Moves,
    limits: Limits,
    draws: FloatArray,
    ends: Ends,
) -> None:
    """Draw the survivors of the active swarms and advance them; `draws` (n,) is overwritten.

    A run ends when `arrivals` living members that count are in the target, with the last
    destruction, or at the horizon.
    """
    for b in range(active.size):
        if not active[b]:
            continue
        write_uniforms(swarms.seeds[b], np.uint64(swarms.steps[b]), swarms.runs[b], draws)
        survivors, inside = 0, 0
        for i in range(draws.size):
            risk = limits.dt * moves.rates[b, i]
            # 1 - risk is below exp(-risk), so that most need no exponential
            survives = draws[i] < 1.0 - risk - _ROUNDING or draws[i] < math.exp(-risk)
            alive = swarms.alive[b, i] and survives
            late = 0
            if not alive:
                late = limits.delay if swarms.alive[b, i] else max(swarms.late[b, i] - 1, 0)
            swarms.alive[b, i], swarms.late[b, i] = alive, late
            believed = alive or late > 0
            for axis in range(2):
                swarms.positions[b, i, axis] = moves.positions[b, i, axis] if believed else 0.0
                swarms.velocities[b, i, axis] = moves.velocities[b, i, axis] if believed else 0.0
            if alive:
                survivors += 1
                east = moves.positions[b, i, 0] - limits.east
                north = moves.positions[b, i, 1] - limits.north
                near = max(abs(east), abs(north)) <= limits.radius  # most need no root
                if near and limits.counting[i]:
                    inside += math.hypot(east, north) <= limits.radius
        arrived = inside >= limits.arrivals
        swarms.steps[b] += 1
        ends.success[b], ends.survivors[b] = arrived, survivors
        ends.ended[b] = arrived or survivors == 0 or swarms.steps[b] >= limits.n_steps


class RiskTable(NamedTuple):
    """Lower bounds of the risk to go, bilinear between the nodes of a grid, constant outwards."""

    values: Any  # (N+1, nx, ny), at every step
    east: float  # of the first node
    north: float
    spacing: float
    slack: float  # bound on the rounding of values


@kernel
def cell(coordinate: float, nodes: int) -> tuple[int, float]:
    """First node and fraction of the cell of a coordinate in spacings from the first node."""
    inside = min(max(coordinate, 0.0), nodes - 1.0)
    first = min(int(inside), nodes - 2)
    return first, inside - first


@kernel
def risk_to_go(table: RiskTable, step: int, east: float, north: float) -> float:
    """Lower bound of the risk to go from a place at a step."""
    values = table.values[step]
    i, u = cell((east - table.east) / table.spacing, values.shape[0])
    j, v = cell((north - table.north) / table.spacing, values.shape[1])
    left = (1.0 - v) * values[i, j] + v * values[i, j + 1]
    right = (1.0 - v) * values[i + 1, j] + v * values[i + 1, j + 1]
    return max(0.0, (1.0 - u) * left + u * right - table.slack)  # type: ignore[no-any-return]


@kernel
def write_potentials(
    table: RiskTable,
    steps: IntArray,
    positions: FloatArray,
    alive: BoolArray,
    ended: BoolArray,
    potentials: FloatArray,
) -> None:
    """Write the potentials (B,) of B states, see `casswarm.envs.batch`; 0 where a run ended."""
    for b in range(ended.size):
        failure = 1.0
        if not ended[b]:
            for i in range(alive.shape[1]):
                if alive[b, i]:
                    at = positions[b, i]
                    failure *= -math.expm1(-risk_to_go(table, steps[b], at[0], at[1]))
        potentials[b] = 1.0 - failure
