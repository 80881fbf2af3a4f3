"""Factors of the joint plan's Newton matrices by a Riccati recursion, and solutions by them.

A plan is a linear-quadratic problem to second order: with p the deviation of the law over m sets of
living members, X and V those of positions and velocities (w = 2n entries each), and u = V(k),

    p(k) = S_k p(k-1) + B_k X(k),  X(k) = X(k-1) + u,

where entry 0 of p, of the empty set, collects the cost of runs that have ended. The cost of the
steps from k on is a quadratic form P of the state (p, X, V)(k-1), with D = m + 2w entries, once
their velocities are eliminated: each step is a Cholesky factorisation of w rows. These are the
pivots of a factorisation of the whole matrix in the velocities, from the last step to the first, so
that it is positive definite if all of them are; see e.g. Wright, Solution of discrete-time optimal
control problems on parallel computers, Parallel Computing 16, 1990. The work is about T D^2 w + T
3^n D instead of (T w)^3.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from ..compiled.kernels import allocating_kernel, kernel
from ..typing import FloatArray


class Stages(NamedTuple):
    """The quadratic model of a plan with T steps.

    Parameters
    ----------
    transitions : (T, 3^n)
        Entries of S_k' in the rows of all sets, for all their subsets in ascending order.
    by_outcome, by_set : (T, m, w)
        B_k, and the mixed derivatives of the cost in p(k-1) and X(k).
    positions, changes : (T, w, w)
        Second derivatives in X(k), and in V(k) - V(k-1).
    limits : (T, w)
        Weights of V(k).
    terminal : (m,)
        Costs of the sets that are alive at the end; of entry 0, 1.
    slope, bend : float
        First and second derivative of the objective in the expected cost.
    """

    transitions: FloatArray
    by_outcome: FloatArray
    by_set: FloatArray
    positions: FloatArray
    changes: FloatArray
    limits: FloatArray
    terminal: FloatArray
    slope: Any  # float, or of all instances
    bend: Any


class Factor(NamedTuple):
    """Triangular pivots (T, w, w) of all steps, and their rows in the other entries (T, w, D)."""

    pivots: FloatArray
    gains: FloatArray


@kernel
def add_over_subsets(
    transition: FloatArray, columns: int, values: FloatArray, out: FloatArray
) -> None:
    """Write S' values to the first columns of `out`; rows of both are sets."""
    place = 0
    for d in range(len(values)):
        target = out[d]
        for c in range(columns):
            target[c] = 0.0
        subset, more = 0, True
        while more:
            factor, row = transition[place], values[subset]
            for c in range(columns):
                target[c] += factor * row[c]
            place += 1
            more = subset != d
            subset = (subset - d) & d


@kernel
def pull_law(k: int, stages: Stages, cost: FloatArray, rows: FloatArray) -> None:
    """Replace p(k) by p(k-1) and X(k) in the form `cost` (D, D), and add the costs of step k.

    The rows of p(k-1) are written to `rows` (m, D); in `cost`, those of X and V are replaced where
    they are used.
    """
    by_outcome, by_set = stages.by_outcome[k], stages.by_set[k]
    sets, width = by_outcome.shape
    size = len(cost)
    for d in range(sets):
        for r in range(width):
            factor, target, row = by_outcome[d, r], cost[sets + r], cost[d]
            for c in range(size):
                target[c] += factor * row[c]
    for d in range(sets):
        for r in range(width):
            cost[d, sets + r] = cost[sets + r, d]
    add_over_subsets(stages.transitions[k], size, cost[:sets], rows)
    for d in range(sets):
        for c in range(sets):
            cost[c, d] = rows[d, c]
    add_over_subsets(stages.transitions[k], sets, cost[:sets], rows)
    for r in range(width):
        target = cost[sets + r]
        for d in range(sets):
            factor = target[d]
            for c in range(width):
                target[sets + c] += factor * by_outcome[d, c]
        for c in range(width):
            target[sets + c] += stages.positions[k, r, c]
    for d in range(sets):
        for c in range(width):
            rows[d, sets + c] += stages.slope * by_set[d, c]


@kernel
def eliminate(
    k: int, shift: float, stages: Stages, cost: FloatArray, rows: FloatArray, factor: Factor
) -> bool:
    """Factorise the equations of V(k); False if they are not positive definite."""
    pivot, gain, changes = factor.pivots[k], factor.gains[k], stages.changes[k]
    sets, width = len(rows), len(pivot)
    last = sets + width
    for r in range(width):
        for d in range(sets):
            gain[r, d] = rows[d, sets + r] + rows[d, last + r]
        for c in range(width):
            of_positions = cost[sets + r, sets + c] + cost[sets + c, last + r]
            gain[r, sets + c] = of_positions
            gain[r, last + c] = -changes[r, c]
            of_velocities = cost[sets + r, last + c] + cost[last + r, last + c]
            pivot[r, c] = of_positions + of_velocities + changes[r, c]
        pivot[r, r] += stages.limits[k, r] + shift
    for r in range(width):
        for c in range(r):
            step = pivot[r, c]
            for i in range(c):
                step -= pivot[r, i] * pivot[c, i]
            subtract(step / pivot[c, c], gain[c], gain[r])
            pivot[r, c] = step / pivot[c, c]
        square = pivot[r, r]
        for c in range(r):
            square -= pivot[r, c] * pivot[r, c]
        if not square > 0.0:
            return False
        pivot[r, r] = math.sqrt(square)
        inverse = 1.0 / pivot[r, r]
        for i in range(gain.shape[1]):
            gain[r, i] *= inverse
    return True


@kernel
def subtract(factor: float, row: FloatArray, target: FloatArray) -> None:
    """Subtract a multiple of a row."""
    for i in range(row.size):
        target[i] -= factor * row[i]


@kernel
def reduce_cost(changes: FloatArray, cost: FloatArray, rows: FloatArray, gain: FloatArray) -> None:
    """Write the form of the state before a step, whose velocities are eliminated, to `cost`."""
    sets, width = len(rows), len(gain)
    last = sets + width
    for d in range(sets):
        for c in range(last):
            cost[d, c] = rows[d, c]
        for r in range(width):
            cost[sets + r, d] = rows[d, sets + r]
            cost[last + r, d] = cost[d, last + r] = 0.0
    for r in range(width):
        for c in range(width):
            cost[last + r, sets + c] = cost[sets + r, last + c] = 0.0
            cost[last + r, last + c] = changes[r, c]
    for i in range(len(cost)):
        for r in range(width):
            subtract(gain[r, i], gain[r], cost[i])


@kernel
def factorise_one(
    shift: float, stages: Stages, cost: FloatArray, rows: FloatArray, factor: Factor
) -> bool:
    """Factorise the matrix of one plan plus a shift of its diagonal; whether it is positive."""
    sets = len(rows)
    cost[:] = 0.0
    for d in range(sets):
        for c in range(sets):
            cost[d, c] = stages.bend * stages.terminal[d] * stages.terminal[c]
    for k in range(len(stages.limits) - 1, -1, -1):
        pull_law(k, stages, cost, rows)
        if not eliminate(k, shift, stages, cost, rows, factor):
            return False
        if k:
            reduce_cost(stages.changes[k], cost, rows, factor.gains[k])
    return True


@allocating_kernel
def factorise(
    plans: tuple[int, int],
    tried: FloatArray,
    stages: Stages,
    factors: Factor,
    shifts: FloatArray,
) -> None:
    """Write the factors of these of b plans, whose arrays have this axis in front.

    `tried` (b, m) are the shifts to try, in order, and `shifts` (b,) those taken, NaN for none.
    """
    size, sets = factors.gains.shape[-1], stages.by_set.shape[2]
    cost, rows = np.empty((size, size)), np.empty((sets, size))
    for b in range(plans[0], plans[1]):
        shifts[b] = np.nan
        one = Stages(
            stages.transitions[b],
            stages.by_outcome[b],
            stages.by_set[b],
            stages.positions[b],
            stages.changes[b],
            stages.limits[b],
            stages.terminal[b],
            stages.slope[b],
            stages.bend[b],
        )
        factor = Factor(factors.pivots[b], factors.gains[b])
        for shift in tried[b]:
            if factorise_one(shift, one, cost, rows, factor):
                shifts[b] = shift
                break


@allocating_kernel
def solve(plans: tuple[int, int], stages: Stages, factors: Factor, right: FloatArray) -> None:
    """Replace right-hand sides (b, T, w) by the solutions, in these of b plans."""
    steps = right.shape[1]
    size, sets = factors.gains.shape[-1], stages.by_set.shape[2]
    state, law = np.empty(size), np.empty(sets)
    for b in range(plans[0], plans[1]):
        state[:] = 0.0
        for k in range(steps - 1, -1, -1):
            parts = stages.transitions[b, k], stages.by_outcome[b, k], right[b, k]
            backward(*parts, factors.pivots[b, k], factors.gains[b, k], state, law)
        state[:] = 0.0
        for k in range(steps):
            parts = stages.transitions[b, k], stages.by_outcome[b, k], right[b, k]
            forward(*parts, factors.pivots[b, k], factors.gains[b, k], state, law)


@kernel
def backward(
    transition: FloatArray,
    by_outcome: FloatArray,
    right: FloatArray,
    pivot: FloatArray,
    gain: FloatArray,
    state: FloatArray,
    law: FloatArray,
) -> None:
    """Eliminate the velocities of a step from linear terms of the state; `right` is reduced."""
    sets, width = by_outcome.shape
    last = sets + width
    place = 0
    for d in range(sets):
        for r in range(width):
            state[sets + r] += by_outcome[d, r] * state[d]
        law[d] = 0.0
        subset, more = 0, True
        while more:
            law[d] += transition[place] * state[subset]
            place += 1
            more = subset != d
            subset = (subset - d) & d
    for d in range(sets):
        state[d] = law[d]
    for r in range(width):
        value = right[r] - state[sets + r] - state[last + r]
        state[last + r] = 0.0
        for c in range(r):
            value -= pivot[r, c] * right[c]
        right[r] = value / pivot[r, r]
    for r in range(width):
        for i in range(state.size):
            state[i] += gain[r, i] * right[r]


@kernel
def forward(
    transition: FloatArray,
    by_outcome: FloatArray,
    right: FloatArray,
    pivot: FloatArray,
    gain: FloatArray,
    state: FloatArray,
    law: FloatArray,
) -> None:
    """Replace `right` by the velocities of a step, and the state by the one after it."""
    sets, width = by_outcome.shape
    last = sets + width
    for r in range(width):
        for i in range(state.size):
            right[r] -= gain[r, i] * state[i]
    for r in range(width - 1, -1, -1):
        for c in range(r + 1, width):
            right[r] -= pivot[c, r] * right[c]
        right[r] /= pivot[r, r]
        state[sets + r] += right[r]
        state[last + r] = right[r]
    place = 0
    for d in range(sets):
        law[d] = 0.0
    for d in range(sets):
        subset, more = 0, True
        while more:
            law[subset] += transition[place] * state[d]
            place += 1
            more = subset != d
            subset = (subset - d) & d
    for d in range(sets):
        for r in range(width):
            law[d] += by_outcome[d, r] * state[sets + r]
        state[d] = law[d]
