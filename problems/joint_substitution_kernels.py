"""Solutions by the factors of `joint_riccati_kernels`, compiled."""

from __future__ import annotations

import numpy as np

from .._util.jit import allocating_kernel, kernel
from ..typing import FloatArray
from .joint_riccati_kernels import Factor, Stages


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
