"""Survivors of a step, outcome by outcome, and groups of equal states.

Each of the living members is destroyed, or survives and moves on, or survives and is absorbed by
the target. A run goes on if nobody is absorbed and somebody survives.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..compiled.kernels import allocating_kernel, kernel
from ..typing import BoolArray, FloatArray, IntArray


class Step(NamedTuple):
    """S states of n members and how they move, before survival is drawn.

    Parameters
    ----------
    weights : (S,)
        Probability of every state.
    survival, arrival : (S, n)
        Probability that a member survives the step, and that it is absorbed if it does.
    alive : (S, n)
        Whether a member is alive before it.
    """

    weights: FloatArray
    survival: FloatArray
    arrival: FloatArray
    alive: BoolArray


class Outcomes(NamedTuple):
    """Outcomes in which the run goes on, in the order of their states.

    Parameters
    ----------
    parents : (K,)
        State before the step.
    survived : (K, n)
    masses : (K,)
    """

    parents: IntArray
    survived: BoolArray
    masses: FloatArray


class Totals(NamedTuple):
    """Sums over all outcomes.

    Parameters
    ----------
    population : (n+1,)
        Mass of the outcomes with k survivors.
    survivors : (n+1,)
        The same of absorbed runs.
    members : (n,)
        Mass of the absorbed runs that a member survives.
    arrival : (1,)
        Mass of the runs that are absorbed by an arrival.
    pruned : (S,)
        Mass that was pruned from every state; -1 where the state was not split.
    """

    population: FloatArray
    survivors: FloatArray
    members: FloatArray
    arrival: FloatArray
    pruned: FloatArray

    @classmethod
    def zeros(cls, states: int, n: int) -> Totals:
        """Totals of S states of n members before anything is added."""
        sizes = n + 1, n + 1, n, 1, states
        return cls._make(np.zeros(size) for size in sizes)


class Search(NamedTuple):
    """Stack of the depth-first enumeration of one state's outcomes.

    Parameters
    ----------
    members : (n,)
        Indices of the k living members.
    branch : (n+1,)
        Next branch at every depth: 0 survives, 1 is destroyed, 2 both done.
    mass, bound : (n+1,)
        Mass of the partial outcome, and largest probability of completing it.
    survivors, stays : (n+1,)
        Number of survivors of the partial outcome, and probability that none of them is absorbed.
    survived : (n,)
    counts : (3, n+1)
        `Totals.population`, `survivors` and `members` of this state.
    """

    members: IntArray
    branch: IntArray
    mass: FloatArray
    bound: FloatArray
    survivors: IntArray
    stays: FloatArray
    survived: BoolArray
    counts: FloatArray


@kernel
def begin(step: Step, state: int, search: Search) -> int:
    """Prepare the enumeration of a state; return its number k of living members."""
    members, bound, k = search.members, search.bound, 0
    for i in range(search.survived.size):
        search.survived[i] = False
        if step.alive[state, i]:
            members[k] = i
            k += 1
    bound[k] = 1.0
    for d in range(k - 1, -1, -1):
        p = step.survival[state, members[d]]
        bound[d] = bound[d + 1] * max(p, 1.0 - p)
    search.counts[:] = 0.0
    search.mass[0], search.branch[0] = step.weights[state], 0
    search.survivors[0], search.stays[0] = 0, 1.0
    return k


@kernel
def count(d: int, search: Search) -> tuple[float, float]:
    """Count the outcome at depth d: (mass that goes on, mass that arrives)."""
    mass, survivors, stays = search.mass[d], search.survivors[d], search.stays[d]
    search.counts[0, survivors] += mass
    arriving = mass * (1.0 - stays)
    ending = arriving if survivors > 0 else mass
    if ending > 0.0:
        search.counts[1, survivors] += ending
        for i in range(search.survived.size):
            if search.survived[i]:
                search.counts[2, i] += ending
    return mass * stays if survivors > 0 else 0.0, arriving


@kernel
def enumerate_outcomes(
    step: Step, state: int, cutoff: float, outcomes: Outcomes, filled: int, search: Search
) -> tuple[int, float, float]:
    """Enumerate a state's outcomes: (number of those in the buffer, mass arrived, mass pruned)."""
    k, capacity, n = begin(step, state, search), outcomes.masses.size, search.survived.size
    members, branches, masses = search.members, search.branch, search.mass
    arrived, pruned, d = 0.0, 0.0, 0
    while d >= 0:
        if d == k:
            going, arriving = count(d, search)
            arrived += arriving
            if going > 0.0 and filled < capacity:
                outcomes.parents[filled], outcomes.masses[filled] = state, going
                for i in range(n):
                    outcomes.survived[filled, i] = search.survived[i]
                filled += 1
            elif going > 0.0:
                search.counts[0, search.survivors[d]] -= going
                pruned += going
            d -= 1
            continue
        branch, i = branches[d], members[d]
        branches[d] = branch + 1
        search.survived[i] = branch == 0
        if branch == 2:
            d -= 1
            continue
        p = step.survival[state, i]
        mass = masses[d] * (p if branch == 0 else 1.0 - p)
        if mass <= 0.0:
            continue
        if mass * search.bound[d + 1] < cutoff or (filled == capacity and d + 1 < k):
            pruned += mass
            continue
        stays = 1.0 - step.arrival[state, i] if branch == 0 else 1.0
        search.survivors[d + 1] = search.survivors[d] + (1 - branch)
        search.stays[d + 1] = search.stays[d] * stays
        d += 1
        masses[d], branches[d] = mass, 0
    return filled, arrived, pruned


@allocating_kernel
def split(
    first: int,
    step: Step,
    cutoff: float,
    max_pruned_fraction: float,
    outcomes: Outcomes,
    totals: Totals,
) -> tuple[int, int]:
    """Split states from `first` on by survivors: (next state, outcomes stored).

    Outcomes in which the run goes on are written to the buffer until it is full; absorbed runs are
    added to `totals`. Outcomes are enumerated depth first over the living members, and pruned where
    none of them can have the mass `cutoff`. Where more than the fraction `max_pruned_fraction` of a
    state is pruned, the state is not split at all.
    """
    n, capacity = step.alive.shape[1], outcomes.masses.size
    search = Search(
        np.empty(n, np.int64),
        np.empty(n + 1, np.int64),
        np.empty(n + 1),
        np.empty(n + 1),
        np.empty(n + 1, np.int64),
        np.empty(n + 1),
        np.zeros(n, np.bool_),
        np.empty((3, n + 1)),
    )
    filled = 0
    for state in range(first, step.weights.size):
        start, living = filled, 0
        for i in range(n):
            living += step.alive[state, i]
        # a state that may not fit is left for the next call, whose buffer is empty
        if start > 0 and capacity - start < min(1 << min(living, 20), capacity // 4):
            return state, start
        filled, arrived, pruned = enumerate_outcomes(step, state, cutoff, outcomes, filled, search)
        if pruned > max_pruned_fraction * step.weights[state]:
            totals.pruned[state] = -1.0
            filled = start
            continue
        totals.pruned[state] = pruned
        totals.arrival[0] += arrived
        for i in range(n + 1):
            totals.population[i] += search.counts[0, i]
            totals.survivors[i] += search.counts[1, i]
            if i < n:
                totals.members[i] += search.counts[2, i]
    return step.weights.size, filled


@kernel
def group(words: NDArray[Any], slots: IntArray, first: IntArray, inverse: IntArray) -> int:
    """Group equal rows of unsigned integers (B, w); return the number of groups.

    `slots`, more than B and a power of two, holds -1 and is used as a hash table. Written are the
    first row of every group, and the group of every row.
    """
    mask, groups = slots.size - 1, 0
    for row in range(words.shape[0]):
        h = np.uint64(0x9E3779B97F4A7C15)
        for word in range(words.shape[1]):
            h = (h ^ words[row, word]) * np.uint64(0xBF58476D1CE4E5B9)
            h = h ^ (h >> np.uint64(29))
        slot = np.int64(h & np.uint64(mask))
        while True:
            candidate = slots[slot]
            if candidate < 0:
                slots[slot], first[groups], inverse[row] = groups, row, groups
                groups += 1
                break
            equal = True
            for word in range(words.shape[1]):
                if words[row, word] != words[first[candidate], word]:
                    equal = False
                    break
            if equal:
                inverse[row] = candidate
                break
            slot = (slot + 1) & mask
    return groups


@kernel
def write_survivors(
    runs: IntArray,
    rows: IntArray,
    draws: FloatArray,
    survival: FloatArray,
    words: NDArray[Any],
) -> None:
    """Write the row and the bits of the survivors of every run to `words` (B, 1 + n / 64), zeros.

    Member i of run k survives where draws[runs[k], i] < survival[rows[k], i].
    """
    for k in range(rows.size):
        words[k, 0] = np.uint64(rows[k])
        for i in range(survival.shape[1]):
            if draws[runs[k], i] < survival[rows[k], i]:
                words[k, 1 + i // 64] |= np.uint64(1) << np.uint64(i % 64)
