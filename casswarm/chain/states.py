"""Batches of states with probabilities: split by survivors, aggregated, and kept in a frontier."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ..typing import BoolArray, FloatArray, IntArray
from .outcome_kernels import Outcomes, Step, Totals, group, split, write_survivors

if TYPE_CHECKING:
    from ..scenario import Scenario

OUTCOME_BYTES = 1 << 26  # of a buffer of outcomes: bounds memory


@dataclass(frozen=True, eq=False)
class States:
    """S states and their probabilities; the entries of the destroyed are zero.

    Parameters
    ----------
    positions, previous_velocities : (S, n, 2)
    alive : (S, n) bool
    weights : (S,)
    """

    positions: FloatArray
    previous_velocities: FloatArray
    alive: BoolArray
    weights: FloatArray

    @classmethod
    def initial(cls, scenario: Scenario, initial_velocities: FloatArray, copies: int = 1) -> States:
        """The initial state, with probability 1, or several copies of it."""
        positions, velocities = (
            np.tile(array, (copies, 1, 1)) for array in (scenario.positions, initial_velocities)
        )
        return cls(positions, velocities, np.ones((copies, scenario.n), bool), np.ones(copies))

    @classmethod
    def concatenate(cls, batches: list[States]) -> States:
        """All states of one or more batches."""
        if len(batches) == 1:
            return batches[0]
        names = ("positions", "previous_velocities", "alive", "weights")
        return cls(*(np.concatenate([getattr(b, name) for b in batches]) for name in names))

    def __len__(self) -> int:
        return len(self.weights)

    def __getitem__(self, rows: IntArray | BoolArray | slice) -> States:
        return States(
            self.positions[rows],
            self.previous_velocities[rows],
            self.alive[rows],
            self.weights[rows],
        )

    @property
    def mass(self) -> float:
        """Sum of the weights."""
        return float(self.weights.sum())

    def aggregated(self) -> tuple[States, IntArray]:
        """Identify states that are equal to the last bit.

        Returns
        -------
        states : States
            The D distinct ones, in the order of their first occurrences.
        inverse : (S,) int
            Index, among the D, of every state.
        """
        first, inverse = distinct_states(self.positions, self.previous_velocities, self.alive)
        if len(first) == len(self):
            return self, inverse
        weights = np.bincount(inverse, self.weights, len(first)).astype(np.float64)
        return replace(self[first], weights=weights), inverse


class Frontier:
    """States that an enumeration has not expanded yet: batches for every step 0..N.

    Parameters
    ----------
    steps : int
        N.
    """

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

        Returns
        -------
        (N+1,)
            Mass removed from every step.
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


def outcomes(
    step: Step, totals: Totals, cutoff: float = 0.0, max_pruned_fraction: float = math.inf
) -> Iterator[Outcomes]:
    """Yield the outcomes in which the run goes on, in batches of `OUTCOME_BYTES`.

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

    Yields
    ------
    Outcomes
        Views of a buffer, which the next batch overwrites.
    """
    count, n = step.alive.shape
    size = min(OUTCOME_BYTES // (33 * n + 8), count << min(n, 20))
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
