"""Masses of outcomes by size, and the derivatives of the states before a step.

Of k living members there are 2^k - 1 outcomes in which the run goes on; the number of each has bit
j set if the j-th living member survives.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..compiled.kernels import allocating_kernel, kernel
from ..typing import BoolArray, FloatArray, IntArray
from .outcome_kernels import Step

BINS = 4400
"""Number of bins of masses: bin b has those from 2^(-(b + 1) / 4), exclusively, to 2^(-b / 4)."""


class Edges(NamedTuple):
    """K outcomes of S states in which the run goes on, in the order of their states.

    Parameters
    ----------
    starts : (S+1,)
        Range of every state's outcomes.
    survived : (K, n)
    children : (K,)
        State after the step that an outcome leads to; -1 if it is not followed.
    """

    starts: IntArray
    survived: BoolArray
    children: IntArray


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


def least_mass(last: int) -> float:
    """A mass below those in bins up to `last`, by no more than rounding."""
    return float((1.0 - 1e-12) * 2.0 ** (-(last + 1) / 4))


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
    numbers : (2^n,)
        Numbers of the outcomes that are followed.
    """

    members: IntArray
    stays: FloatArray
    leaves: FloatArray
    absorbed: FloatArray
    levels: FloatArray
    weights: FloatArray
    numbers: IntArray


@kernel
def weigh(step: Step, arrival: NDArray[Any], s: int, scratch: Scratch) -> int:
    """Write the members of state s and what happens to each; their number k.

    `arrival` (S, n) has the probabilities that members are absorbed if they survive.
    """
    k = 0
    for i in range(step.alive.shape[1]):
        if step.alive[s, i]:
            p, a = step.survival[s, i], arrival[s, i]
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


@kernel
def number_outcomes(edges: Edges, s: int, k: int, scratch: Scratch) -> int:
    """Write the numbers of the outcomes of state s, which has k members; return how many."""
    start, stop = edges.starts[s], edges.starts[s + 1]
    for c in range(start, stop):
        number = 0
        for j in range(k):
            number |= int(edges.survived[c, scratch.members[j]]) << j
        scratch.numbers[c - start] = number
    return int(stop - start)


@allocating_kernel
def backward(
    step: Step, inside: BoolArray, edges: Edges, after: Values, to: Values, by: Adjoints
) -> None:
    """Write the values of states before a step, and the derivatives with respect to their moves.

    Parameters
    ----------
    step : Step
        S states.
    inside : (S, n)
        Members that are in the target after the step.
    edges : Edges
    after : Values
        Of the states after the step.
    to : Values
        Written: its `objective` and `success`.
    by : Adjoints
        Zeros; written.
    """
    n = step.alive.shape[1]
    scratch = Scratch(
        np.empty(n, np.int64),
        np.empty(n),
        np.empty(n),
        np.empty(n),
        np.zeros((n + 1, 1 << n)),
        np.empty((n + 1, 1 << n)),
        np.empty(1 << n, np.int64),
    )
    for s in range(step.weights.size):
        k, start, numbers = weigh(step, inside, s, scratch), edges.starts[s], scratch.numbers
        children = edges.children[start : start + number_outcomes(edges, s, k, scratch)]
        leaf = scratch.levels[k]
        leaf[: 1 << k] = 0.0
        for c in range(children.size):
            if children[c] >= 0:
                leaf[numbers[c]] = after.success[children[c]]
        to.success[s] = fold(k, scratch)
        weigh(step, step.arrival, s, scratch)
        for c in range(children.size):
            if children[c] >= 0:
                leaf[numbers[c]] = after.objective[children[c]]
        to.objective[s] = fold(k, scratch)
        unfold(k, step.arrival, s, scratch, by)
        for c in range(children.size):
            if children[c] >= 0:
                weight, child = scratch.weights[k, numbers[c]], children[c]
                for i in range(n):
                    if edges.survived[start + c, i]:
                        for axis in range(2):
                            by.positions[s, i, axis] += weight * after.positions[child, i, axis]
                            by.velocities[s, i, axis] += weight * after.velocities[child, i, axis]
