"""Batches of states: their starts, solved together in lanes or one by one, and verified.

From every start a state is solved coarsely; where the first starts do not agree, rounds of further
ones follow (see `spectral_kernels`). Few members are solved in lanes; large swarms, and problems
without an objective for lanes, one by one (`search_kernels`), as is what lanes leave above
tolerance. A state's answer does not depend on the others in a batch.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from ..compiled.kernels import allocating_kernel, kernel
from ..typing import FloatArray, IntArray
from .face_kernels import STEP, Problem, Workspace, copy
from .lane_kernels import Jobs, Lanes, Limits, Tasks, empty_lanes, solve_jobs
from .search_kernels import Method, descend, minimise, project, verify, workspace
from .spectral_kernels import (
    CONVERGED,
    NOT_FINITE,
    Results,
    Starts,
    count_hits,
    empty_starts,
    needs_start,
    orient,
    write_start,
)

COARSE = 1e-3  # tolerance to which starts are compared
DECREASE = 1e-5  # predicted relative decrease at which they are compared in lanes
START_SPREAD = 2.0  # standard deviation of further starts, in radii of the smallest disc
ROUND = 3  # times as many starts in further rounds as in the first: all lanes of a state
CHUNK = 256  # starts that are solved together, in lanes
FEW = 32  # states that are solved together, where each is solved alone
ITERATIONS = 300  # of a lane, after which the state goes on by itself


class Objective(NamedTuple):
    """Compiled objectives of a problem, see `casswarm.compiled.kernels.objective`."""

    evaluate: Any
    evaluate_lanes: Any  # `evaluate` where there is none
    in_lanes: bool
    constants: FloatArray


class Shared(NamedTuple):
    """The rest of an `Objective`.

    Numba finds the type of a record with functions anew in each call, which takes as long as a
    decision in one state.
    """

    in_lanes: bool
    constants: FloatArray


class Batch(NamedTuple):
    """B problems: initial guesses x0 (B, 2n), p (B, np), scale (B, 2), sets (B, n, 13)."""

    x0: FloatArray
    p: FloatArray
    scale: FloatArray
    sets: FloatArray


class Scratch(NamedTuple):
    """Arrays that the solve of a chunk of states overwrites."""

    work: Workspace
    numbers: FloatArray  # of the objective
    lanes: Lanes
    starts: Starts
    tasks: Tasks
    least: FloatArray  # (chunk,), least objective of a state's starts so far
    hits: IntArray  # (chunk,), how often it was found
    solved: IntArray  # (chunk,), starts so far


@allocating_kernel
def scratch_for(members: int, states: int, in_lanes: bool, method: Method) -> Scratch:
    """Arrays for chunks of so many states of so many members."""
    jobs = states * (ROUND * method.initial if method.initial > 1 else 1)
    return Scratch(
        workspace(members),
        np.empty(members * (members + 8)),
        empty_lanes(members if in_lanes else 0),
        empty_starts(method.initial, method.directions, states),
        Tasks(
            np.empty(jobs, np.int64),
            np.empty((jobs, 2 * members)),
            np.empty(jobs),
            np.empty((jobs, 2), np.int64),
        ),
        np.empty(states),
        np.empty(states, np.int64),
        np.empty(states, np.int64),
    )


@kernel
def chunk_size(objective: Objective, method: Method) -> int:
    """Number of states that are solved together."""
    return max(1, CHUNK // method.initial) if objective.in_lanes else FEW


@kernel
def place_starts(guess: FloatArray, sets: FloatArray, row: int, scratch: Scratch) -> None:
    """Write where the starts of a state lie: around its guess, by the size of the sets."""
    starts, places = scratch.starts, scratch.work.vectors[STEP]
    for i in range(sets.shape[0]):
        radius = min(sets[i, 6], sets[i, 9])
        starts.spread[row, i] = START_SPREAD * radius if radius < math.inf else 0.0
        places[2 * i], places[2 * i + 1] = sets[i, 4] + sets[i, 7], sets[i, 5] + sets[i, 8]
    orient(guess, places, starts, row)


@kernel
def write_round(batch: Batch, scratch: Scratch) -> int:
    """Write the next starts of the states that need some; return their number."""
    tasks, starts, count = scratch.tasks, scratch.starts, 0
    for row in range(batch.x0.shape[0]):
        solved, wanted = scratch.solved[row], starts.initial
        if starts.initial == 1:
            wanted = 1 - solved
        elif needs_start(solved, scratch.hits[row], starts):
            wanted = min(wanted if solved == 0 else ROUND * wanted, len(starts.directions) - solved)
        else:
            wanted = 0
        for index in range(solved, solved + wanted):
            tasks.problem[count] = row
            if starts.initial == 1:
                copy(batch.x0[row], tasks.x[count])
            else:
                write_start(index, batch.x0[row], starts, row, tasks.x[count])
            project(tasks.x[count], batch.sets[row], tasks.x[count])
            count += 1
        scratch.solved[row] += wanted
    return count


@kernel
def run_tasks(
    objective: Objective, batch: Batch, method: Method, count: int, scratch: Scratch
) -> None:
    """Improve the starts of the first `count` tasks, in lanes where that is possible.

    Several starts of a state are improved coarsely, a single one to tolerance.
    """
    tasks, tolerance, max_iter = scratch.tasks, method.tolerance, method.max_iter
    coarse = method.initial > 1
    if objective.in_lanes:
        decrease, tolerance = (DECREASE, 0.0) if coarse else (0.0, tolerance)
        limits = Limits(tolerance, decrease, min(max_iter, ITERATIONS))
        jobs = Jobs(batch.p, batch.sets, batch.scale, tasks, count, limits)
        solve_jobs(objective.evaluate_lanes, objective.constants, jobs, scratch.lanes)
        return
    for task in range(count):
        row, counts = tasks.problem[task], tasks.counts[task]
        counts[0], counts[1] = 0, 0
        problem = Problem(
            objective.evaluate,
            batch.p[row],
            objective.constants,
            batch.sets[row],
            batch.scale[row],
            scratch.numbers,
        )
        limit = COARSE if coarse else tolerance
        f, outcome = minimise(tasks.x[task], problem, limit, max_iter, scratch.work, counts)
        tasks.f[task] = f if outcome != NOT_FINITE else math.nan


@kernel
def read_round(count: int, scratch: Scratch, results: Results) -> None:
    """Keep the best ends, and count how often the least minimum was found."""
    tasks = scratch.tasks
    for task in range(count):
        row, f = tasks.problem[task], tasks.f[task]
        results.counts[row, 0] += tasks.counts[task, 0]
        results.counts[row, 1] += tasks.counts[task, 1]
        if math.isfinite(f):
            scratch.hits[row] = count_hits(f, scratch.least[row], scratch.hits[row])
            if f < scratch.least[row]:
                scratch.least[row] = f
                copy(tasks.x[task], results.x[row])


@kernel
def finish(
    objective: Objective, batch: Batch, row: int, method: Method, scratch: Scratch, results: Results
) -> bool:
    """Verify a state's point, after further steps where it needs them; whether it needed none.

    The paper's method, which has a constant step, takes all its steps here.
    """
    problem = Problem(
        objective.evaluate,
        batch.p[row],
        objective.constants,
        batch.sets[row],
        batch.scale[row],
        scratch.numbers,
    )
    x, counts, verified = results.x[row], results.counts[row], results.verified[row]
    if method.step > 0.0:
        results.outcome[row] = descend(x, problem, method, scratch.work, counts)
        verify(x, problem, scratch.work, verified)
        return True
    counts[1] += 1
    results.outcome[row] = CONVERGED
    if verify(x, problem, scratch.work, verified) <= method.tolerance:
        return True
    if scratch.solved[row] > 0:
        _f, results.outcome[row] = minimise(
            x, problem, method.tolerance, method.max_iter, scratch.work, counts
        )
        verify(x, problem, scratch.work, verified)
    return False


@kernel
def solve_chunk(
    objective: Objective, batch: Batch, method: Method, scratch: Scratch, results: Results
) -> None:
    """Solve states from their guesses; write their solutions and residuals.

    The guesses' projections in `results.x` are replaced by the solutions. From every start a state
    is solved coarsely, and from the best of the ends to tolerance. A guess that is a solution, in
    closed form, is only verified.
    """
    states, alone = batch.x0.shape[0], method.step > 0.0 or not objective.in_lanes
    for row in range(states):
        scratch.least[row], scratch.hits[row], scratch.solved[row] = math.inf, 0, 0
        if method.initial > 1:
            place_starts(batch.x0[row], batch.sets[row], row, scratch)
        elif alone and finish(objective, batch, row, method, scratch, results):
            scratch.least[row], scratch.solved[row] = -math.inf, 1
    count = write_round(batch, scratch)
    while count > 0:
        run_tasks(objective, batch, method, count, scratch)
        read_round(count, scratch, results)
        count = write_round(batch, scratch)
    for row in range(states):
        if scratch.least[row] > -math.inf:
            finish(objective, batch, row, method, scratch, results)


@allocating_kernel
def minimise_batch(
    rows: tuple[int, int],
    evaluate: Any,
    evaluate_lanes: Any,
    shared: Shared,
    batch: Batch,
    method: Method,
    results: Results,
) -> None:
    """Solve the states ``rows[0]`` to ``rows[1] - 1`` and verify the answers."""
    objective = Objective(evaluate, evaluate_lanes, shared.in_lanes, shared.constants)
    members, chunk = batch.sets.shape[1], chunk_size(objective, method)
    scratch = scratch_for(members, min(chunk, rows[1] - rows[0]), objective.in_lanes, method)
    for first in range(rows[0], rows[1], chunk):
        end = min(first + chunk, rows[1])
        for row in range(first, end):
            project(batch.x0[row], batch.sets[row], results.x[row])
        own = Batch(
            batch.x0[first:end], batch.p[first:end], batch.scale[first:end], batch.sets[first:end]
        )
        part = Results(
            results.x[first:end],
            results.verified[first:end],
            results.outcome[first:end],
            results.counts[first:end],
        )
        solve_chunk(objective, own, method, scratch, part)
