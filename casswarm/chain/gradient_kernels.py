"""Outcomes of a step, which of them are followed, and the derivatives of the states before it.

Each of k living members is destroyed, or survives and moves on, or survives and is absorbed by the
target. A run goes on if nobody is absorbed and somebody survives: these are 2^k - 1 outcomes, whose
numbers have bit j set if the j-th living member survives.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..compiled.kernels import allocating_kernel, kernel
from ..typing import BoolArray, FloatArray, IntArray

BINS = 4400
"""Number of bins of masses: bin b has those from 2^(-(b + 1) / 4), exclusively, to 2^(-b / 4)."""


class Moves(NamedTuple):
    """S states of n members and how they move, before survival is drawn.

    Parameters
    ----------
    weights : (S,)
        Probability of every state.
    survival, arrival : (S, n)
        Probability that a member survives, and that it is absorbed if it does.
    alive, inside : (S, n)
        Whether a member is alive before the step, and in the target after it.
    """

    weights: FloatArray
    survival: FloatArray
    arrival: FloatArray
    alive: BoolArray
    inside: BoolArray


class Outcomes(NamedTuple):
    """K outcomes that are followed, in the order of their states.

    Parameters
    ----------
    starts : (S+1,)
        Range of every state's outcomes.
    parents, numbers : (K,)
        State, and number of the outcome.
    survived : (K, n)
    masses : (K,)
    """

    starts: IntArray
    parents: IntArray
    numbers: IntArray
    survived: BoolArray
    masses: FloatArray


class Values(NamedTuple):
    """Values of S states, and derivatives of the objective.

    Parameters
    ----------
    objective, success : (S,)
        Probability of being absorbed, and of an arrival in the target, of what is followed.
    positions, velocities : (S, n, 2)
        Derivatives with respect to X(t) and V(t-1).
    """

    objective: FloatArray
    success: FloatArray
    positions: FloatArray
    velocities: FloatArray


class Adjoints(NamedTuple):
    """Derivatives of the objective of S states with respect to what happens in their step.

    Parameters
    ----------
    survival, arrival : (S, n)
    positions, velocities : (S, n, 2)
        X(t+1) and V(t), as far as the states after the step depend on them.
    """

    survival: FloatArray
    arrival: FloatArray
    positions: FloatArray
    velocities: FloatArray


@kernel
def mass_bin(mass: float) -> int:
    """Bin of a positive mass."""
    return min(BINS - 1, max(0, math.floor(-4.0 * math.log2(mass))))


@kernel
def spread(moves: Moves, s: int, masses: FloatArray) -> int:
    """Write the masses of the outcomes of state s in which nobody is absorbed; their number 2^k."""
    size = 1
    masses[0] = moves.weights[s]
    for i in range(moves.alive.shape[1]):
        if moves.alive[s, i]:
            p = moves.survival[s, i]
            for o in range(size):
                masses[size + o] = masses[o] * (p * (1.0 - moves.arrival[s, i]))
                masses[o] *= 1.0 - p
            size *= 2
    return size


@allocating_kernel
def count_outcomes(moves: Moves, counts: IntArray, sums: FloatArray) -> None:
    """Add the outcomes in which the run goes on to the numbers and masses (`BINS`,) of all bins."""
    masses = np.empty(1 << moves.alive.shape[1])
    for s in range(moves.weights.size):
        for o in range(1, spread(moves, s, masses)):
            if masses[o] > 0.0:
                b = mass_bin(masses[o])
                counts[b] += 1
                sums[b] += masses[o]


@allocating_kernel
def count_masses(masses: FloatArray, counts: IntArray, sums: FloatArray) -> None:
    """Add masses to the numbers and masses (`BINS`,) of all bins."""
    for mass in masses:
        b = mass_bin(mass)
        counts[b] += 1
        sums[b] += mass


@kernel
def flag_masses(masses: FloatArray, last: int, flags: BoolArray) -> None:
    """Write which masses are in bins up to `last`."""
    for k in range(masses.size):
        flags[k] = mass_bin(masses[k]) <= last


@allocating_kernel
def follow(moves: Moves, last: int, outcomes: Outcomes) -> None:
    """Write the outcomes in which the run goes on and whose masses are in bins up to `last`."""
    n = moves.alive.shape[1]
    masses, filled = np.empty(1 << n), 0
    for s in range(moves.weights.size):
        outcomes.starts[s] = filled
        for o in range(1, spread(moves, s, masses)):
            if masses[o] > 0.0 and mass_bin(masses[o]) <= last:
                outcomes.parents[filled], outcomes.numbers[filled] = s, o
                outcomes.masses[filled] = masses[o]
                bit = 0
                for i in range(n):
                    outcomes.survived[filled, i] = False
                    if moves.alive[s, i]:
                        outcomes.survived[filled, i] = (o >> bit) & 1 == 1
                        bit += 1
                filled += 1
    outcomes.starts[moves.weights.size] = filled


class Scratch(NamedTuple):
    """Of the state whose outcomes are folded; see `fold`.

    Parameters
    ----------
    members : (n,)
        Its k living members.
    stays, leaves, absorbed : (n,)
        Probability that each survives and moves on, is destroyed, and is absorbed.
    levels, weights : (n+1, 2^n)
        Values and probabilities of the outcomes of the members up to each.
    """

    members: IntArray
    stays: FloatArray
    leaves: FloatArray
    absorbed: FloatArray
    levels: FloatArray
    weights: FloatArray


@kernel
def weigh(moves: Moves, arrival: NDArray[Any], s: int, scratch: Scratch) -> int:
    """Write the members of state s and what happens to each; their number k.

    `arrival` (S, n) has the probabilities that members are absorbed if they survive.
    """
    k = 0
    for i in range(moves.alive.shape[1]):
        if moves.alive[s, i]:
            p, a = moves.survival[s, i], arrival[s, i]
            scratch.members[k] = i
            scratch.stays[k], scratch.leaves[k] = p * (1.0 - a), 1.0 - p
            scratch.absorbed[k] = p * a
            k += 1
    return k


@kernel
def fold(k: int, scratch: Scratch) -> float:
    """Probability that a member is absorbed, now or later, given the values of the outcomes.

    The values of the outcomes in which k members move on are ``levels[k]`` (2^k,). Level d is the
    expectation over the members from d on, level 0 that over all.
    """
    levels, nobody = scratch.levels, 1.0
    for d in range(k - 1, -1, -1):
        size, nobody = 1 << d, nobody * (1.0 - scratch.absorbed[d])
        for o in range(size):
            stays, leaves = levels[d + 1, size + o], levels[d + 1, o]
            levels[d, o] = scratch.stays[d] * stays + scratch.leaves[d] * leaves
    return float(1.0 - nobody + levels[0, 0])


@kernel
def unfold(k: int, arrival: FloatArray, s: int, scratch: Scratch, by: Adjoints) -> None:
    """Write the derivatives by the probabilities of state s, and the weights of its outcomes."""
    levels, weights = scratch.levels, scratch.weights
    weights[0, 0] = 1.0
    for j in range(k):
        i, size, to_stay, to_leave = scratch.members[j], 1 << j, 0.0, 0.0
        for o in range(size):
            to_stay += weights[j, o] * levels[j + 1, size + o]
            to_leave += weights[j, o] * levels[j + 1, o]
            weights[j + 1, size + o] = weights[j, o] * scratch.stays[j]
            weights[j + 1, o] = weights[j, o] * scratch.leaves[j]
        others = 1.0  # nobody else is absorbed
        for m in range(k):
            if m != j:
                others *= 1.0 - scratch.absorbed[m]
        a = arrival[s, i]
        by.survival[s, i] = (1.0 - a) * to_stay - to_leave + a * others
        by.arrival[s, i] = (1.0 - scratch.leaves[j]) * (others - to_stay)


@allocating_kernel
def backward(
    moves: Moves, outcomes: Outcomes, children: IntArray, after: Values, to: Values, by: Adjoints
) -> None:
    """Write the values of states before a step, and the derivatives with respect to their moves.

    Parameters
    ----------
    moves, outcomes : Moves, Outcomes
        Of S states, K outcomes.
    children : (K,)
        State after the step that an outcome leads to; -1 if it is not followed.
    after : Values
        Of the states after the step.
    to : Values
        Written: its `objective` and `success`.
    by : Adjoints
        Zeros; written.
    """
    n = moves.alive.shape[1]
    scratch = Scratch(
        np.empty(n, np.int64),
        np.empty(n),
        np.empty(n),
        np.empty(n),
        np.zeros((n + 1, 1 << n)),
        np.empty((n + 1, 1 << n)),
    )
    for s in range(moves.weights.size):
        outcomes_of_state = range(outcomes.starts[s], outcomes.starts[s + 1])
        k = weigh(moves, moves.inside, s, scratch)
        leaf = scratch.levels[k]
        leaf[: 1 << k] = 0.0
        for c in outcomes_of_state:
            if children[c] >= 0:
                leaf[outcomes.numbers[c]] = after.success[children[c]]
        to.success[s] = fold(k, scratch)
        weigh(moves, moves.arrival, s, scratch)
        for c in outcomes_of_state:
            if children[c] >= 0:
                leaf[outcomes.numbers[c]] = after.objective[children[c]]
        to.objective[s] = fold(k, scratch)
        unfold(k, moves.arrival, s, scratch, by)
        for c in outcomes_of_state:
            if children[c] >= 0:
                weight, child = scratch.weights[k, outcomes.numbers[c]], children[c]
                for i in range(n):
                    if outcomes.survived[c, i]:
                        for axis in range(2):
                            by.positions[s, i, axis] += weight * after.positions[child, i, axis]
                            by.velocities[s, i, axis] += weight * after.velocities[child, i, axis]
