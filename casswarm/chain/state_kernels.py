"""Survivors of a step, outcome by outcome, and groups of equal states."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..compiled.kernels import allocating_kernel, kernel
from ..typing import BoolArray, FloatArray, IntArray


class Step(NamedTuple):
    """S states before a step.

    Parameters
    ----------
    weights : (S,)
    survival : (S, n)
        Every member's probability of surviving the step.
    alive, inside : (S, n)
        Whether a member is alive before it, and inside the target after it.
    """

    weights: FloatArray
    survival: FloatArray
    alive: BoolArray
    inside: BoolArray


class Outcomes(NamedTuple):
    """Buffer of outcomes in which the run goes on: parent state, survivors (n,) and mass."""

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
    pruned : (S,)
        Mass that was pruned from every state; -1 where the state was not split.
    """

    population: FloatArray
    survivors: FloatArray
    members: FloatArray
    pruned: FloatArray


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
    survived : (n,)
    counts : (3, n+1)
        `Totals.population`, `survivors` and `members` of this state.
    """

    members: IntArray
    branch: IntArray
    mass: FloatArray
    bound: FloatArray
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
    return k


@kernel
def count(step: Step, state: int, mass: float, search: Search) -> tuple[int, bool, bool]:
    """Count an outcome: (number of survivors, whether the run ends, whether it arrives)."""
    survived, counts = search.survived, search.counts
    survivors, arrives = 0, False
    for i in range(survived.size):
        if survived[i]:
            survivors += 1
            arrives = arrives or step.inside[state, i]
    counts[0, survivors] += mass
    ends = arrives or survivors == 0
    if ends:
        counts[1, survivors] += mass
        for i in range(survived.size):
            if survived[i]:
                counts[2, i] += mass
    return survivors, ends, arrives


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
            survivors, ends, arrives = count(step, state, masses[d], search)
            if arrives:
                arrived += masses[d]
            if not ends and filled < capacity:
                outcomes.parents[filled], outcomes.masses[filled] = state, masses[d]
                for i in range(n):
                    outcomes.survived[filled, i] = search.survived[i]
                filled += 1
            elif not ends:
                search.counts[0, survivors] -= masses[d]
                pruned += masses[d]
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
) -> tuple[int, int, float]:
    """Split states from `first` on by survivors: (next state, outcomes stored, mass arrived).

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
        np.zeros(n, np.bool_),
        np.empty((3, n + 1)),
    )
    filled, arrival = 0, 0.0
    for state in range(first, step.weights.size):
        start, living = filled, 0
        for i in range(n):
            living += step.alive[state, i]
        # a state that may not fit is left for the next call, whose buffer is empty
        if start > 0 and capacity - start < min(1 << min(living, 20), capacity // 4):
            return state, start, arrival
        filled, arrived, pruned = enumerate_outcomes(step, state, cutoff, outcomes, filled, search)
        if pruned > max_pruned_fraction * step.weights[state]:
            totals.pruned[state] = -1.0
            filled = start
            continue
        totals.pruned[state] = pruned
        arrival += arrived
        for i in range(n + 1):
            totals.population[i] += search.counts[0, i]
            totals.survivors[i] += search.counts[1, i]
            if i < n:
                totals.members[i] += search.counts[2, i]
    return step.weights.size, filled, arrival


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
