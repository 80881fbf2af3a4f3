"""Batches of states for the spectral projected gradient: starts, and the verified answer."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from ...._util.jit import allocating_kernel, kernel
from ....typing import FloatArray, IntArray
from .engine import Results
from .face_newton_kernels import STEP, Problem, Workspace, copy
from .multistart_kernels import (
    Starts,
    count_hits,
    empty_starts,
    needs_start,
    orient,
    write_start,
)
from .outcome_kernels import CONVERGED, NOT_FINITE
from .spg_kernels import minimise, project, verify, workspace

COARSE = 1e-3  # tolerance to which starts are compared
SPREAD = 2.0  # standard deviation of further starts, in radii of the smallest disc


class Batch(NamedTuple):
    """B problems: initial guesses x0 (B, 2n), p (B, np), scale (B, 2), sets (B, n, 10)."""

    x0: FloatArray
    p: FloatArray
    constants: FloatArray
    scale: FloatArray
    sets: FloatArray


class Method(NamedTuple):
    """Options of `SpectralProjectedGradient`, and the displacements of starts (`Starts`)."""

    initial: int
    directions: FloatArray
    tolerance: float
    max_iter: int


class Scratch(NamedTuple):
    """Arrays that the solve of a state overwrites; `x` and `best` (2n,) are points."""

    work: Workspace
    starts: Starts
    x: FloatArray
    best: FloatArray


@allocating_kernel
def scratch_for(members: int, method: Method) -> Scratch:
    """Arrays for states of so many members."""
    starts = empty_starts(method.initial, method.directions, 1)
    return Scratch(workspace(members), starts, np.empty(2 * members), np.empty(2 * members))


@kernel
def place_starts(guess: FloatArray, problem: Problem, scratch: Scratch) -> None:
    """Write where the starts of a state lie: around its guess, by the size of the sets."""
    sets, starts, places = problem.sets, scratch.starts, scratch.work.vectors[STEP]
    for i in range(sets.shape[0]):
        radius = min(sets[i, 6], sets[i, 9])
        starts.spread[0, i] = SPREAD * radius if radius < math.inf else 0.0
        places[2 * i], places[2 * i + 1] = sets[i, 4] + sets[i, 7], sets[i, 5] + sets[i, 8]
    orient(guess, places, starts, 0)


@kernel
def solve(
    guess: FloatArray,
    problem: Problem,
    method: Method,
    scratch: Scratch,
    verified: FloatArray,
    counts: IntArray,
) -> int:
    """Solve a state from its guess; write its residuals, return the outcome.

    The guess's projection in `scratch.best` is replaced by the solution. From every start the state
    is solved coarsely, and from the best of the ends to tolerance.
    """
    work, starts, x, best = scratch
    if starts.initial > 1:
        place_starts(guess, problem, scratch)
    elif verify(best, problem, work, verified) <= method.tolerance:  # a solution in closed form
        counts[1] += 1
        return CONVERGED
    least, hits, solved = math.inf, 0, 0
    while needs_start(solved, hits, starts):
        write_start(solved, guess, starts, 0, x)
        project(x, problem.sets, x)
        f, outcome = minimise(x, problem, COARSE, method.max_iter, work, counts)
        if outcome != NOT_FINITE:
            hits = count_hits(f, least, hits)
            if f < least:
                least = f
                copy(x, best)
        solved += 1
    _f, outcome = minimise(best, problem, method.tolerance, method.max_iter, work, counts)
    verify(best, problem, work, verified)
    return outcome


@allocating_kernel
def minimise_batch(
    rows: tuple[int, int], evaluate: Any, batch: Batch, method: Method, results: Results
) -> None:
    """Solve the states ``rows[0]`` to ``rows[1] - 1`` and verify the answers."""
    members = batch.sets.shape[1]
    scratch, numbers = scratch_for(members, method), np.empty(members * (members + 8))
    for row in range(rows[0], rows[1]):
        problem = Problem(
            evaluate, batch.p[row], batch.constants, batch.sets[row], batch.scale[row], numbers
        )
        project(batch.x0[row], problem.sets, scratch.best)
        results.outcome[row] = solve(
            batch.x0[row], problem, method, scratch, results.verified[row], results.counts[row]
        )
        copy(scratch.best, results.x[row])
