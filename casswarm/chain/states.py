"""States of the chain with probabilities: split by survivors, aggregated, kept in a frontier.

Each of the living members is destroyed, or survives and moves on, or survives and is absorbed by
the target. A run goes on if nobody is absorbed and somebody survives.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..compiled.kernels import allocating_kernel, kernel
from ..typing import BoolArray, FloatArray, IntArray
from .belief import rounded

if TYPE_CHECKING:
    from ..scenario import Scenario

OUTCOME_BYTES = 1 << 26  # of a buffer of outcomes: bounds memory


class Step(NamedTuple):
    """S states of n members and how they move, before survival is drawn.

    Parameters
    ----------
    weights : (S,)
        Probability of every state.
    survival, arrival : (S, n)
        Probability that a member survives the step, and that it is absorbed if it does.
    alive : (S, n) bool
        Whether a member is alive before the step.
    arrivals : int
        Number of members that must be absorbed in the step to end the run; from 2 on, `arrival` is
        0 or 1.
    """

    weights: FloatArray
    survival: FloatArray
    arrival: FloatArray
    alive: BoolArray
    arrivals: int


class Outcomes(NamedTuple):
    """K outcomes in which the run goes on, in the order of their states."""

    parents: IntArray  # (K,) state before the step
    survived: BoolArray  # (K, n)
    masses: FloatArray  # (K,)


class Totals(NamedTuple):
    """Sums over all outcomes."""

    population: FloatArray  # (n+1,) mass of the outcomes with k survivors
    survivors: FloatArray  # (n+1,) the same of absorbed runs
    members: FloatArray  # (n,) mass of the absorbed runs that a member survives
    arrival: FloatArray  # (1,) mass of the runs that are absorbed by an arrival
    pruned: FloatArray  # (S,) mass pruned from every state; -1 where it was not split

    @classmethod
    def zeros(cls, states: int, n: int) -> Totals:
        """Totals of S states of n members before anything is added."""
        sizes = n + 1, n + 1, n, 1, states
        return cls._make(np.zeros(size) for size in sizes)


class Search(NamedTuple):
    """Stack of the depth-first enumeration of the outcomes of one state with k living members."""

    members: IntArray  # (n,) the living ones
    branch: IntArray  # (n+1,) next at every depth: 0 survives, 1 is destroyed, 2 both done
    mass: FloatArray  # (n+1,) of the partial outcome
    bound: FloatArray  # (n+1,) largest probability of completing it
    survivors: IntArray  # (n+1,) number in the partial outcome
    inside: IntArray  # (n+1,) number of those that are absorbed, if that is certain
    stays: FloatArray  # (n+1,) probability that too few of them are absorbed
    survived: BoolArray  # (n,)
    counts: FloatArray  # (3, n+1) `Totals.population`, `survivors` and `members` of this state


@dataclass(frozen=True, eq=False)
class States:
    """S states and their probabilities; the entries of those that are known to be lost are zero.

    Parameters
    ----------
    positions, previous_velocities : (S, n, 2)
        Also those of ghosts, members that are lost and not known to be.
    alive : (S, n) bool
    weights : (S,)
    late : (S, n) int, optional
        Number of steps until a loss is known; 0 for the living, and for losses that are known. None
        if all losses are known at once.
    case : (S,) int, optional
        The true case of a hazard that is not known.
    belief : (S, K) int, optional
        Weights of the cases by which members decide, in units of `casswarm.chain.belief`.
    """

    positions: FloatArray
    previous_velocities: FloatArray
    alive: BoolArray
    weights: FloatArray
    late: IntArray | None = None
    case: IntArray | None = None
    belief: IntArray | None = None

    @classmethod
    def initial(
        cls, scenario: Scenario, initial_velocities: FloatArray, *, weighs: bool = False
    ) -> States:
        """The initial states, one for each case of the hazard, with the probability of the case.

        `weighs` tells whether states include the belief of the members.
        """
        prior = np.array([case.weight for case in scenario.cases])
        shape = len(prior), scenario.n
        positions, velocities = (
            np.tile(array, (len(prior), 1, 1)) for array in (scenario.positions, initial_velocities)
        )
        late = None if scenario.delay == 0 else np.zeros(shape, np.int64)
        case = None if len(prior) == 1 else np.arange(len(prior))
        belief = None if case is None or not weighs else rounded(np.tile(prior, (len(prior), 1)))
        return cls(positions, velocities, np.ones(shape, bool), prior, late, case, belief)

    @property
    def believed(self) -> BoolArray:
        """Members (S, n) that are not known to be lost: the living, and ghosts."""
        return self.alive if self.late is None else self.alive | (self.late > 0)

    @classmethod
    def concatenate(cls, batches: list[States]) -> States:
        """All states of one or more batches."""
        if len(batches) == 1:
            return batches[0]
        columns = zip(*(batch._fields for batch in batches), strict=True)
        fields: Any = (None if c[0] is None else np.concatenate(c) for c in columns)
        return cls(*fields)

    @property
    def _fields(self) -> tuple[Any, ...]:
        state = self.positions, self.previous_velocities, self.alive
        return *state, self.weights, self.late, self.case, self.belief

    def __len__(self) -> int:
        return len(self.weights)

    def __getitem__(self, rows: IntArray | BoolArray | slice) -> States:
        fields: Any = (None if array is None else array[rows] for array in self._fields)
        return States(*fields)

    @property
    def mass(self) -> float:
        """Sum of the weights."""
        return float(self.weights.sum())

    def aggregated(self) -> tuple[States, IntArray]:
        """Distinct states, in the order of their first occurrences, and the index of each (S,)."""
        arrays = self._fields
        hidden = [array for array in arrays[4:] if array is not None]
        first, inverse = distinct_states(*arrays[:3], *hidden)
        if len(first) == len(self):
            return self, inverse
        weights = np.bincount(inverse, self.weights, len(first)).astype(np.float64)
        return replace(self[first], weights=weights), inverse


class Frontier:
    """States that an enumeration has not expanded yet: batches for every step 0..N."""

    def __init__(self, steps: int) -> None:
        self.batches: list[list[States]] = [[] for _ in range(steps + 1)]

    def __len__(self) -> int:
        return sum(len(batch) for batches in self.batches for batch in batches)

    @property
    def masses(self) -> FloatArray:
        """Mass (N+1,) of the states of every step."""
        return np.array([sum(batch.mass for batch in batches) for batches in self.batches])

    @property
    def mass(self) -> float:
        """Mass of all states."""
        return float(self.masses.sum())

    def add(self, step: int, states: States) -> None:
        """Add states of a step."""
        if len(states):
            self.batches[step].append(states)

    def pop(self, step: int) -> list[States]:
        """Remove and return the batches of a step."""
        batches, self.batches[step] = self.batches[step], []
        return batches

    def prune(self, max_states: int) -> FloatArray:
        """Remove the least probable states if there are more than `max_states`; half remain.

        Returns the mass (N+1,) removed from every step.
        """
        pruned = np.zeros(len(self.batches))
        count = len(self)
        if count <= max_states:
            return pruned
        weights = np.concatenate([b.weights for batches in self.batches for b in batches])
        rank = count - max_states // 2
        threshold = float(np.partition(weights, rank)[rank])
        for step in range(len(self.batches)):
            for batch in self.pop(step):
                retained = batch.weights >= threshold
                pruned[step] += batch.weights[~retained].sum()
                self.add(step, batch[retained])
        return pruned


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
    search.survivors[0], search.inside[0], search.stays[0] = 0, 0, 1.0
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
        arrival = step.arrival[state, i] if branch == 0 else 0.0
        search.survivors[d + 1] = search.survivors[d] + (1 - branch)
        search.inside[d + 1] = search.inside[d] + (arrival == 1.0)
        if step.arrivals == 1:
            search.stays[d + 1] = search.stays[d] * (1.0 - arrival)
        else:
            search.stays[d + 1] = 0.0 if search.inside[d + 1] >= step.arrivals else 1.0
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
def write_survivors(
    runs: IntArray, rows: IntArray, draws: FloatArray, survival: FloatArray, words: NDArray[Any]
) -> None:
    """Write the row and the bits of the survivors of every run to `words` (B, 1 + n / 64), zeros.

    Member i of run k survives where draws[runs[k], i] < survival[rows[k], i].
    """
    for k in range(rows.size):
        words[k, 0] = np.uint64(rows[k])
        for i in range(survival.shape[1]):
            if draws[runs[k], i] < survival[rows[k], i]:
                words[k, 1 + i // 64] |= np.uint64(1) << np.uint64(i % 64)


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


def outcomes(
    step: Step,
    totals: Totals,
    cutoff: float = 0.0,
    max_pruned_fraction: float = math.inf,
    max_bytes: int = OUTCOME_BYTES,
) -> Iterator[Outcomes]:
    """Yield the outcomes in which the run goes on, in batches.

    Parameters
    ----------
    step : Step
        States before the step.
    totals : Totals
        The other outcomes are added to them; `arrival` and `survivors` are those of a batch.
    cutoff : float
        Outcomes less probable than this are pruned, and so are those too many for the buffer.
    max_pruned_fraction : float
        Largest fraction of a state's probability that may be pruned; a state that would lose more
        is not split.
    max_bytes : int
        Memory of the states that a batch leads to.

    Yields
    ------
    Outcomes
        Views of a buffer, which the next batch overwrites.
    """
    count, n = step.alive.shape
    size = min(max(1, max_bytes // (33 * n + 8)), count << min(n, 20))
    buffer = Outcomes(np.empty(size, np.int64), np.empty((size, n), bool), np.empty(size))
    first = 0
    while first < count:
        totals.arrival[:], totals.survivors[:] = 0.0, 0.0
        first, filled = split(first, step, cutoff, max_pruned_fraction, buffer, totals)
        yield Outcomes._make(array[:filled] for array in buffer)


def distinct_states(*arrays: NDArray[np.generic]) -> tuple[IntArray, IntArray]:
    """Distinct rows of arrays with a common first axis, compared bit by bit.

    Returns
    -------
    first : (D,) int
        The first row of every distinct state, ascending.
    inverse : (B,) int
        Index, among the D, of every row.
    """
    count = len(arrays[0])
    columns = [np.ascontiguousarray(a).reshape(count, math.prod(a.shape[1:])) for a in arrays]
    widths = [column.shape[1] * column.itemsize for column in columns]
    words = np.zeros((count, -(-sum(widths) // 8)), np.uint64)
    ends = np.cumsum(widths)
    for column, end, width in zip(columns, ends, widths, strict=True):
        words.view(np.uint8)[:, end - width : end] = column.view(np.uint8)
    return _distinct(words)


def distinct_survivors(
    runs: IntArray, rows: IntArray, draws: FloatArray, survival: FloatArray
) -> tuple[IntArray, IntArray]:
    """Distinct pairs of a state and the set of its survivors, as `distinct_states` returns them.

    Parameters
    ----------
    runs : (B,) int
        Row among `draws` of every run.
    rows : (B,) int
        Row among `survival` of every run.
    draws : (R, n)
    survival : (D, n)
        Members with draw < survival survive.
    """
    words = np.zeros((len(runs), 1 + -(-survival.shape[1] // 64)), np.uint64)
    write_survivors(runs, rows, draws, survival, words)
    return _distinct(words)


def _distinct(words: NDArray[np.uint64]) -> tuple[IntArray, IntArray]:
    count = len(words)
    slots = np.full(1 << (2 * count).bit_length(), -1)
    first, inverse = np.empty(count, np.int64), np.empty(count, np.int64)
    return first[: group(words, slots, first, inverse)], inverse
