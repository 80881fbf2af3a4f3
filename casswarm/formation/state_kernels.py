"""Formation problems state by state: leader, parameters, sets, guess, and the verified decision.

For every state: its problem and scale, the solution by the spectral projected gradient, and the
verification. What `casswarm.policies.formation_policies` otherwise does in arrays, for any solver.

`casswarm.problems.formation` states the problems. These kernels write what distinguishes one state
from another, both for its records (`Formation`) and for policies that solve in the same pass.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from ..compiled.kernels import allocating_kernel, kernel
from ..motion.planar_kernels import (
    WIDTH,
    approach,
    fix,
    motion_set,
    nearest_to_anchor,
    projected,
)
from ..typing import BoolArray, FloatArray, IntArray
from .face_kernels import copy
from .multistart_kernels import (
    Batch,
    Objective,
    Scratch,
    Shared,
    chunk_size,
    scratch_for,
    solve_chunk,
)
from .search_kernels import Method
from .spectral_kernels import Results


@kernel
def separation(positions: FloatArray, row: int, i: int, points: FloatArray) -> float:
    """Distance of a member to its state's point."""
    east, north = positions[row, i, 0] - points[row, 0], positions[row, i, 1] - points[row, 1]
    return math.sqrt(east * east + north * north)


@kernel
def nearest_living(
    positions: FloatArray, alive: BoolArray, points: FloatArray, tie: float, members: IntArray
) -> None:
    """Write the first living member that is nearest to the points (B, 2), up to `tie`; 0 if none.

    A distance that is not finite counts as infinite.
    """
    for row in range(positions.shape[0]):
        least = math.inf
        members[row] = 0
        for i in range(positions.shape[1]):
            distance = separation(positions, row, i, points)
            if alive[row, i] and distance < least:
                least = distance
        for i in range(positions.shape[1] - 1, -1, -1):
            distance = separation(positions, row, i, points)
            if alive[row, i] and distance <= least + tie:
                members[row] = i


class States(NamedTuple):
    """B states before a step."""

    positions: FloatArray  # (B, n, 2)
    previous_velocities: FloatArray  # (B, n, 2)
    alive: BoolArray  # (B, n)
    goals: FloatArray  # (B, 2), X*(t+1)
    leaders: IntArray  # (B,), members that move to the goal; -1 for none


class Terms(NamedTuple):
    """Common terms of the formation problems of a batch."""

    dt: float
    v_max: float
    motion: FloatArray  # (n, 3) or (1, 3), as of `planar_kernels.motion_set`
    at_goal: float  # distance from the goal up to which a leader has reached it
    corridor: float  # the corridor's radius in units of velocity; negative for leader protection
    gathers: bool  # whether protectors begin close to the leader, which minimises its rate
    follower_weight: float  # weight of their rates


class StateProblem(NamedTuple):
    """The problem of a state; of B states, with a leading axis."""

    p: FloatArray  # (6n + 4,), parameters in the order of `formation_nlp`
    guess: FloatArray  # (2n,), feasible initial guess
    sets: FloatArray  # (n, 13), see ``planar_kernels``; points where not free, 0 for the destroyed
    free: BoolArray  # (n,), as of `Formation`
    infeasible: BoolArray  # (n,), as of `Formation`


@kernel
def state_problem(states: States, row: int, terms: Terms, out: StateProblem) -> bool:
    """Write the problem of a state.

    Returns False, and writes no problem, if a number is not finite or a member's limits of motion
    allow no velocity: the previous one is too far from v_max.
    """
    finite = write_parameters(states, row, terms, out.p)
    if not finite:
        return False
    if terms.corridor < 0.0:
        return leader_problem(states, row, terms, out)
    return corridor_problem(states, row, terms, out)


@kernel
def write_parameters(states: States, row: int, terms: Terms, p: FloatArray) -> bool:
    """Write all parameters but the weights, which are 0; return whether they are finite."""
    n = states.alive.shape[1]
    total = 0.0
    for i in range(n):
        for c in range(2):
            p[2 * i + c] = states.positions[row, i, c]
            p[2 * (n + i) + c] = states.previous_velocities[row, i, c]
            total += 0.0 * p[2 * i + c] + 0.0 * p[2 * (n + i) + c]
        p[4 * n + i], p[5 * n + i] = states.alive[row, i], 0.0
    p[6 * n], p[6 * n + 1] = states.goals[row, 0], states.goals[row, 1]
    p[6 * n + 2], p[6 * n + 3] = terms.dt, terms.v_max
    finite: bool = total + 0.0 * p[6 * n] + 0.0 * p[6 * n + 1] == 0.0
    return finite


@kernel
def write_fixed(i: int, out: StateProblem) -> None:
    """Let a member whose set is a point not be free."""
    out.free[i] = False
    out.guess[2 * i], out.guess[2 * i + 1] = out.sets[i, 0], out.sets[i, 1]


@kernel
def write_destroyed(i: int, out: StateProblem) -> None:
    """Let a destroyed member not move."""
    for c in range(4, WIDTH):
        out.sets[i, c] = 0.0
    fix(0.0, 0.0, out.sets, i)
    write_fixed(i, out)
    out.infeasible[i] = False


@kernel
def write_free(i: int, vx: float, vy: float, out: StateProblem) -> bool:
    """Let a member be free, its guess as close to (vx, vy) as allowed; False without any."""
    out.free[i], out.infeasible[i] = True, False
    out.guess[2 * i], out.guess[2 * i + 1], exists = projected(vx, vy, out.sets, i)
    return exists


@kernel
def leader_problem(states: States, row: int, terms: Terms, out: StateProblem) -> bool:
    """Leader protection, problem (6): the leader's velocity is fixed."""
    n, lead, dt, sets, p = states.alive.shape[1], states.leaders[row], terms.dt, out.sets, out.p
    solvable, next_x, next_y = True, 0.0, 0.0
    if states.alive[row, lead]:
        x, y, goal_x, goal_y = p[2 * lead], p[2 * lead + 1], p[6 * n], p[6 * n + 1]
        motion_set(p[2 * (n + lead)], p[2 * (n + lead) + 1], terms.motion, lead, sets, lead)
        vx, vy, solvable = projected((goal_x - x) / dt, (goal_y - y) / dt, sets, lead)
        next_x, next_y = x + dt * vx, y + dt * vy
        fix(vx, vy, sets, lead)
        write_fixed(lead, out)
        out.infeasible[lead] = math.hypot(next_x - goal_x, next_y - goal_y) > terms.at_goal
        p[5 * n + lead] = 1.0
    for i in range(n):
        if not states.alive[row, i]:
            write_destroyed(i, out)
        elif i != lead:
            vx, vy = p[2 * (n + i)], p[2 * (n + i) + 1]
            motion_set(vx, vy, terms.motion, i, sets, i)
            if terms.gathers:  # the closer the better, for every member independently
                vx, vy = (next_x - p[2 * i]) / dt, (next_y - p[2 * i + 1]) / dt
            solvable = write_free(i, vx, vy, out) and solvable
            p[5 * n + i] = terms.follower_weight
    return solvable


@kernel
def corridor_problem(states: States, row: int, terms: Terms, out: StateProblem) -> bool:
    """Constrained trajectory, problem (7); a leader moves to the goal itself."""
    n, lead, dt, sets, p = states.alive.shape[1], states.leaders[row], terms.dt, out.sets, out.p
    solvable = True
    for i in range(n):
        if not states.alive[row, i]:
            write_destroyed(i, out)
            continue
        vx, vy = p[2 * (n + i)], p[2 * (n + i) + 1]
        motion_set(vx, vy, terms.motion, i, sets, i)
        sets[i, 7], sets[i, 8] = (p[6 * n] - p[2 * i]) / dt, (p[6 * n + 1] - p[2 * i + 1]) / dt
        sets[i, 9] = terms.corridor
        p[5 * n + i] = 1.0
        infeasible = not nearest_to_anchor(sets, i)[2]
        if infeasible or i == lead:
            solvable = approach(sets, i) and solvable
            write_fixed(i, out)
        else:
            solvable = write_free(i, vx, vy, out) and solvable
        out.infeasible[i] = infeasible
    return solvable


@kernel
def isolated_rate(
    evaluate: Any,
    p: FloatArray,
    alive: BoolArray,
    constants: FloatArray,
    vectors: FloatArray,
    scratch: FloatArray,
) -> float:
    """Weighted sum of the members' rates if each were alone, at the present positions.

    It is the objective for velocities of 0 with nobody alive, and so without pairs of members; then
    p has `alive` (n,) again. `vectors` (2, 2n) and `scratch` are overwritten.
    """
    n = alive.size
    for i in range(n):
        vectors[0, 2 * i], vectors[0, 2 * i + 1], p[4 * n + i] = 0.0, 0.0, 0.0
    rate: float = evaluate(vectors[0], p, constants, vectors[1], scratch)
    for i in range(n):
        p[4 * n + i] = alive[i]
    return rate


@allocating_kernel
def isolated_rates(
    evaluate: Any, p: FloatArray, alive: BoolArray, constants: FloatArray, rates: FloatArray
) -> None:
    """Write `isolated_rate` (B,) of all states."""
    n = alive.shape[1]
    vectors, scratch = np.empty((2, 2 * n)), np.empty(n * (n + 8))
    for row in range(rates.size):
        rates[row] = isolated_rate(evaluate, p[row], alive[row], constants, vectors, scratch)


@kernel
def write_problems(
    states: States, terms: Terms, problems: StateProblem, solvable: BoolArray
) -> None:
    """Write the problems of B states, and which of them could be written."""
    for row in range(solvable.size):
        out = StateProblem(
            problems.p[row],
            problems.guess[row],
            problems.sets[row],
            problems.free[row],
            problems.infeasible[row],
        )
        solvable[row] = state_problem(states, row, terms, out)


class Limits(NamedTuple):
    """Residuals up to which an answer is accepted."""

    violation: float
    stationarity: float


class StepInputs(NamedTuple):
    """States that are to be decided in."""

    states: States
    terms: Terms
    limits: Limits


class StepResults(NamedTuple):
    """Output arrays for B states."""

    velocities: FloatArray  # (B, n, 2)
    verified: FloatArray  # (B, 3), as of the batch solver's `Results`
    infeasible: IntArray  # (B,), members that cannot meet their soft constraint
    accepted: BoolArray  # (B,), whether the residuals are within limits: else nothing else counts


@kernel
def write_velocities(x: FloatArray, sets: FloatArray, velocities: FloatArray) -> bool:
    """Write the nearest velocities in the sets, where hard constraints hold; False without any."""
    complete = True
    for i in range(sets.shape[0]):
        velocities[i, 0], velocities[i, 1], exists = projected(x[2 * i], x[2 * i + 1], sets, i)
        complete = complete and exists
    return complete


@kernel
def pose(
    objective: Objective,
    states: States,
    row: int,
    terms: Terms,
    problems: StateProblem,
    place: int,
    scratch: Scratch,
) -> float:
    """Write the problem of a state at a place; return `isolated_rate`, or NaN if it has none."""
    out = StateProblem(
        problems.p[place],
        problems.guess[place],
        problems.sets[place],
        problems.free[place],
        problems.infeasible[place],
    )
    if not state_problem(states, row, terms, out):
        return math.nan
    return isolated_rate(
        objective.evaluate,
        out.p,
        states.alive[row],
        objective.constants,
        scratch.work.vectors[:2],
        scratch.numbers,
    )


@allocating_kernel
def decide_states(
    rows: tuple[int, int],
    evaluate: Any,
    evaluate_lanes: Any,
    shared: Shared,
    inputs: StepInputs,
    method: Method,
    results: StepResults,
) -> None:
    """Decide in the states ``rows[0]`` to ``rows[1] - 1``."""
    states, terms, limits = inputs
    objective = Objective(evaluate, evaluate_lanes, shared.in_lanes, shared.constants)
    n, chunk = states.alive.shape[1], chunk_size(objective, method)
    size = min(chunk, rows[1] - rows[0])
    scratch = scratch_for(n, size, objective.in_lanes, method)
    problems = StateProblem(
        np.empty((size, 6 * n + 4)),
        np.empty((size, 2 * n)),
        np.empty((size, n, WIDTH)),
        np.empty((size, n), np.bool_),
        np.empty((size, n), np.bool_),
    )
    scale, owner = np.empty((size, 2)), np.empty(size, np.int64)
    solved = Results(
        np.empty((size, 2 * n)),
        np.empty((size, 3)),
        np.empty(size, np.int64),
        np.zeros((size, 2), np.int64),
    )
    for first in range(rows[0], rows[1], chunk):
        posed = 0
        for row in range(first, min(first + chunk, rows[1])):
            results.accepted[row] = False
            rate = pose(objective, states, row, terms, problems, posed, scratch)
            if 0.0 <= rate < math.inf:
                owner[posed] = row
                scale[posed, 0], scale[posed, 1] = terms.v_max, rate if rate > 0.0 else 1.0
                copy(problems.guess[posed], solved.x[posed])
                posed += 1
        batch = Batch(
            problems.guess[:posed], problems.p[:posed], scale[:posed], problems.sets[:posed]
        )
        solve_chunk(objective, batch, method, scratch, solved)
        for place in range(posed):
            row, verified = owner[place], results.verified[owner[place]]
            copy(solved.verified[place], verified)
            results.infeasible[row] = 0
            for i in range(n):
                results.infeasible[row] += problems.infeasible[place, i]
            if verified[1] <= limits.violation and verified[2] <= limits.stationarity:
                results.accepted[row] = write_velocities(
                    solved.x[place], problems.sets[place], results.velocities[row]
                )
