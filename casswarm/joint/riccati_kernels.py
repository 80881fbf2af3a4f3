"""Factors of the joint plan's Newton matrices by a Riccati recursion, and solutions by them.

A plan is a linear-quadratic problem to second order: with p the deviation of the law over m sets of
living members, X and V those of positions and velocities (w = 2n entries each), and u = V(k),

    p(k) = S_k p(k-1) + B_k X(k),  X(k) = X(k-1) + u,

where entry 0 of p, of the empty set, collects the cost of runs that have ended. If the hazard is
not known, p holds the laws in all cases, m sets each, weighted by their prior. The cost of the
steps from k on is a quadratic form P of the state (p, X, V)(k-1), with D = m + 2w entries, once
their velocities are eliminated: each step is a Cholesky factorisation of w rows. These are the
pivots of a factorisation of the whole matrix in the velocities, from the last step to the first, so
that it is positive definite if all of them are; see e.g. Wright, Solution of discrete-time optimal
control problems on parallel computers, Parallel Computing 16, 1990. The work is about T D^2 w + T
3^n D instead of (T w)^3.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from ..compiled.kernels import allocating_kernel, kernel
from ..typing import FloatArray


class Stages(NamedTuple):
    """The quadratic models of plans with T steps; all arrays have the axis of plans in front."""

    transitions: FloatArray  # (T, 3^n), of S_k' in the rows of all sets, for subsets in order
    by_outcome: FloatArray  # (T, m, w), B_k
    by_set: FloatArray  # (T, m, w), mixed derivatives of the cost in p(k-1) and X(k)
    positions: FloatArray  # (T, w, w), second derivatives in X(k)
    changes: FloatArray  # (T, w, w), in V(k) - V(k-1)
    limits: FloatArray  # (T, w), weights of V(k)
    terminal: FloatArray  # (m,), costs of the sets that are alive at the end; of entry 0, 1
    slope: FloatArray  # (), derivative of the objective in the expected cost
    bend: FloatArray  # (), second derivative


class Factor(NamedTuple):
    """Factors of the models of plans, this axis in front."""

    pivots: FloatArray  # (T, w, w), triangular, of all steps
    gains: FloatArray  # (T, w, D), their rows in the other entries


@kernel
def add_over_subsets(
    transition: FloatArray, sets: int, columns: int, values: FloatArray, out: FloatArray
) -> None:
    """Write S' values to the first columns of `out`; rows of both are the m sets of each case."""
    place = 0
    for row_of_set in range(len(values)):
        d = row_of_set & (sets - 1)
        first = row_of_set - d
        target = out[row_of_set, :columns]
        target[:] = 0.0
        subset, more = 0, True
        while more:
            factor, row = transition[place], values[first + subset]
            for c in range(columns):
                target[c] += factor * row[c]
            place += 1
            more = subset != d
            subset = (subset - d) & d


@kernel
def pull_law(b: int, k: int, stages: Stages, cost: FloatArray, rows: FloatArray) -> None:
    """Replace p(k) by p(k-1) and X(k) in the form `cost` (D, D), and add the costs of step k.

    The rows of p(k-1) are written to `rows` (m, D); in `cost`, those of X and V are replaced where
    they are used.
    """
    by_outcome, by_set, slope = stages.by_outcome[b, k], stages.by_set[b, k], stages.slope[b]
    transition, positions = stages.transitions[b, k], stages.positions[b, k]
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
    add_over_subsets(transition, 1 << width // 2, size, cost[:sets], rows)
    for d in range(sets):
        for c in range(sets):
            cost[c, d] = rows[d, c]
    add_over_subsets(transition, 1 << width // 2, sets, cost[:sets], rows)
    for r in range(width):
        target = cost[sets + r]
        for d in range(sets):
            factor = target[d]
            for c in range(width):
                target[sets + c] += factor * by_outcome[d, c]
        for c in range(width):
            target[sets + c] += positions[r, c]
    for d in range(sets):
        for c in range(width):
            rows[d, sets + c] += slope * by_set[d, c]


@kernel
def eliminate(
    limits: FloatArray,
    changes: FloatArray,
    shift: float,
    cost: FloatArray,
    rows: FloatArray,
    pivot: FloatArray,
    gain: FloatArray,
) -> bool:
    """Factorise the equations of V(k); False if they are not positive definite."""
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
        pivot[r, r] += limits[r] + shift
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
    b: int, shift: float, stages: Stages, cost: FloatArray, rows: FloatArray, factors: Factor
) -> bool:
    """Factorise the matrix of a plan plus a shift of its diagonal; whether it is positive."""
    cost[:] = 0.0
    terminal, changes = stages.terminal[b], stages.changes[b]
    for d in range(len(rows)):
        for c in range(len(rows)):
            cost[d, c] = stages.bend[b] * terminal[d] * terminal[c]
    for k in range(len(changes) - 1, -1, -1):
        pivot, gain = factors.pivots[b, k], factors.gains[b, k]
        pull_law(b, k, stages, cost, rows)
        if not eliminate(stages.limits[b, k], changes[k], shift, cost, rows, pivot, gain):
            return False
        if k:
            reduce_cost(changes[k], cost, rows, gain)
    return True


@allocating_kernel
def factorise(
    plans: tuple[int, int], tried: FloatArray, stages: Stages, factors: Factor, shifts: FloatArray
) -> None:
    """Write the factors of these of b plans.

    `tried` (b, m) are the shifts to try, in order, and `shifts` (b,) those taken, NaN for none.
    """
    size, sets = factors.gains.shape[-1], stages.by_set.shape[2]
    cost, rows = np.empty((size, size)), np.empty((sets, size))
    for b in range(plans[0], plans[1]):
        shifts[b] = np.nan
        for shift in tried[b]:
            if factorise_one(b, shift, stages, cost, rows, factors):
                shifts[b] = shift
                break


@allocating_kernel
def solve(plans: tuple[int, int], stages: Stages, factors: Factor, right: FloatArray) -> None:
    """Replace right-hand sides (b, T, w) by the solutions, in these of b plans."""
    size, sets = factors.gains.shape[-1], stages.by_set.shape[2]
    state, law = np.empty((size, 1)), np.empty((sets, 1))
    for b in range(plans[0], plans[1]):
        state[:] = 0.0
        for k in range(right.shape[1] - 1, -1, -1):
            backward(b, k, stages, factors, right[b, k], state, law)
        state[:] = 0.0
        for k in range(right.shape[1]):
            forward(b, k, stages, factors, right[b, k], state[:, 0], law[:, 0])


@kernel
def backward(
    b: int,
    k: int,
    stages: Stages,
    factors: Factor,
    right: FloatArray,
    state: FloatArray,
    law: FloatArray,
) -> None:
    """Eliminate the velocities of a step from linear terms of the state; `right` is reduced."""
    by_outcome, pivot, gain = stages.by_outcome[b, k], factors.pivots[b, k], factors.gains[b, k]
    sets, width = by_outcome.shape
    last = sets + width
    for d in range(sets):
        for r in range(width):
            state[sets + r, 0] += by_outcome[d, r] * state[d, 0]
    add_over_subsets(stages.transitions[b, k], 1 << width // 2, 1, state[:sets], law)
    for d in range(sets):
        state[d, 0] = law[d, 0]
    for r in range(width):
        value = right[r] - state[sets + r, 0] - state[last + r, 0]
        state[last + r, 0] = 0.0
        for c in range(r):
            value -= pivot[r, c] * right[c]
        right[r] = value / pivot[r, r]
    for r in range(width):
        for i in range(len(state)):
            state[i, 0] += gain[r, i] * right[r]


@kernel
def forward(
    b: int,
    k: int,
    stages: Stages,
    factors: Factor,
    right: FloatArray,
    state: FloatArray,
    law: FloatArray,
) -> None:
    """Replace `right` by the velocities of a step, and the state by the one after it."""
    by_outcome, pivot, gain = stages.by_outcome[b, k], factors.pivots[b, k], factors.gains[b, k]
    transition, place = stages.transitions[b, k], 0
    sets, width = by_outcome.shape
    for r in range(width):
        for i in range(state.size):
            right[r] -= gain[r, i] * state[i]
    for r in range(width - 1, -1, -1):
        for c in range(r + 1, width):
            right[r] -= pivot[c, r] * right[c]
        right[r] /= pivot[r, r]
        state[sets + r] += right[r]
        state[sets + width + r] = right[r]
    law[:] = 0.0
    for row_of_set in range(sets):
        d = row_of_set & ((1 << width // 2) - 1)
        first = row_of_set - d
        subset, more = 0, True
        while more:
            law[first + subset] += transition[place] * state[row_of_set]
            place += 1
            more = subset != d
            subset = (subset - d) & d
    for d in range(sets):
        for r in range(width):
            law[d] += by_outcome[d, r] * state[sets + r]
        state[d] = law[d]
