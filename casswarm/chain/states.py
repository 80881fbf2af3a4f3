"""Batches of states with probabilities: aggregation of equal states, splitting by survivors."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from .._util.jit import contiguous
from ..typing import BoolArray, FloatArray, IntArray
from .transition import Transition

if TYPE_CHECKING:
    from ..scenario import Scenario

OUTCOME_BYTES = 1 << 26
"""Size of the buffer of outcomes: bounds memory."""


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
    def initial(cls, scenario: Scenario, initial_velocities: FloatArray) -> States:
        """The initial state, with probability 1."""
        alive = np.ones((1, scenario.n), bool)
        positions, velocities = scenario.positions[None], initial_velocities[None]
        return cls(positions.copy(), velocities.copy(), alive, np.ones(1))

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

    def aggregated(self, tolerance: float = 0.0) -> States:
        """Identify equal states or, above zero, states in the same cell of a grid of that width.

        The most probable state represents the others.
        """
        if len(self) < 2:
            return self
        keys: tuple[NDArray[np.generic], ...] = (self.positions, self.previous_velocities)
        if tolerance > 0:
            keys = tuple(np.round(np.asarray(key, float) / tolerance) + 0.0 for key in keys)
        first, inverse = distinct_states(*keys, self.alive)
        if len(first) == len(self):
            return self
        weights = np.bincount(inverse, self.weights, len(first)).astype(np.float64)
        if tolerance > 0:
            order = np.lexsort((-self.weights, inverse))
            first = order[np.searchsorted(inverse[order], np.arange(len(first)))]
        return States(
            self.positions[first], self.previous_velocities[first], self.alive[first], weights
        )


@dataclass
class AbsorptionStatistics:
    """Statistics of an enumeration so far: masses of absorbed runs, and expected counts.

    Parameters
    ----------
    arrival : (N+1,)
    survivors : (n+1,)
    members : (n,)
    population : (N+1, n+1)
        Mass of the states with k alive that were reached at step t, absorbed or not.
    ended : (N+1, n+1)
        Mass of the runs that were absorbed at step t with k alive.
    states : int
        Number of states solved.
    infeasible, failures : float
        Expected numbers of infeasible member-steps and of solver failures.
    """

    arrival: FloatArray
    survivors: FloatArray
    members: FloatArray
    population: FloatArray
    ended: FloatArray
    states: int = 0
    infeasible: float = 0.0
    failures: float = 0.0

    @classmethod
    def initial(cls, scenario: Scenario) -> AbsorptionStatistics:
        """Statistics at step 0, where all members are alive."""
        n, steps = scenario.n, scenario.n_steps
        population = np.zeros((steps + 1, n + 1))
        population[0, n] = 1.0
        ended = np.zeros_like(population)
        return cls(np.zeros(steps + 1), np.zeros(n + 1), np.zeros(n), population, ended)

    def absorb(self, states: States) -> None:
        """Add states at the horizon."""
        self.survivors += np.bincount(
            states.alive.sum(axis=1), states.weights, minlength=len(self.survivors)
        )
        self.members += states.weights @ states.alive

    def count(self, states: States, move: Transition) -> None:
        """Add states that were solved, with what their decisions report."""
        self.states += len(states)
        self.infeasible += float(states.weights @ move.infeasible)
        self.failures += float(states.weights @ move.solver_failures)


def split(
    move: Transition,
    states: States,
    step: int,
    cutoff: float,
    max_pruned_fraction: float,
    statistics: AbsorptionStatistics,
    pruned: FloatArray,
) -> Iterator[States]:
    """Yield the states after a step in which the run goes on, in batches of `OUTCOME_BYTES`.

    Absorbed runs are added to `statistics`. The mass that was pruned from every state is written to
    `pruned` (S,): outcomes less probable than `cutoff`, or too many for the buffer. It is -1 where
    it would exceed the fraction `max_pruned_fraction` of the state, which is then not split.
    """
    from . import state_kernels  # Numba takes a second to import

    n = states.alive.shape[1]
    capacity = min(OUTCOME_BYTES // (33 * n + 8), len(states) << min(n, 20))
    outcomes = state_kernels.Outcomes(
        np.empty(capacity, np.int64), np.empty((capacity, n), bool), np.empty(capacity)
    )
    data = state_kernels.Step(
        contiguous(states.weights),
        contiguous(move.survival),
        contiguous(states.alive),
        contiguous(move.inside),
    )
    first = 0
    while first < len(states):
        arrival, survivors = np.zeros(1), np.zeros(n + 1)
        population, members = statistics.population[step + 1], statistics.members
        totals = state_kernels.Totals(arrival, population, survivors, members, pruned)
        first, filled = state_kernels.split(
            first, data, cutoff, max_pruned_fraction, outcomes, totals
        )
        statistics.arrival[step + 1] += arrival[0]
        statistics.survivors += survivors
        statistics.ended[step + 1] += survivors
        origin, alive = outcomes.parents[:filled], outcomes.survived[:filled].copy()
        living = alive[..., None]
        yield States(
            np.where(living, move.positions[origin], 0.0),
            np.where(living, move.velocities[origin], 0.0),
            alive,
            outcomes.masses[:filled].copy(),
        )


def distinct_states(*arrays: NDArray[np.generic]) -> tuple[IntArray, IntArray]:
    """Distinct rows of arrays with a common first axis, compared bit by bit.

    Returns
    -------
    first : (D,) int
        The first row of every distinct state, ascending.
    inverse : (B,) int
        Index, among the D, of every row.
    """
    from .state_kernels import group  # Numba takes a second to import

    count = len(arrays[0])
    columns = [np.ascontiguousarray(a).reshape(count, math.prod(a.shape[1:])) for a in arrays]
    widths = [column.shape[1] * column.itemsize for column in columns]
    words = np.zeros((count, -(-sum(widths) // 8)), np.uint64)
    ends = np.cumsum(widths)
    for column, end, width in zip(columns, ends, widths, strict=True):
        words.view(np.uint8)[:, end - width : end] = column.view(np.uint8)
    slots = np.full(1 << (2 * count).bit_length(), -1)
    first, inverse = np.empty(count, np.int64), np.empty(count, np.int64)
    return first[: group(words, slots, first, inverse)], inverse
