"""Batches of states with probabilities: equal ones made one, and split by who survives a step."""

from __future__ import annotations

import inspect
import math
from collections.abc import Iterator
from dataclasses import dataclass
from types import ModuleType
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from .._util.jit import compiled_module
from ..typing import BoolArray, FloatArray, IntArray
from . import state_kernels
from .transition import Transition

if TYPE_CHECKING:
    from ..scenario import Scenario

ROOM = 1 << 26
"""Bytes of outcomes that are written at once: bounds memory."""


def _core() -> ModuleType:
    return compiled_module(inspect.getsource(state_kernels))


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
    def start(cls, scenario: Scenario, before: FloatArray) -> States:
        """The initial state, with certainty."""
        alive = np.ones((1, scenario.n), bool)
        return cls(scenario.positions[None].copy(), before[None].copy(), alive, np.ones(1))

    @classmethod
    def joined(cls, parts: list[States]) -> States:
        """All states of the parts, at least one."""
        if len(parts) == 1:
            return parts[0]
        names = ("positions", "previous_velocities", "alive", "weights")
        return cls(*(np.concatenate([getattr(part, name) for part in parts]) for name in names))

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

    def merged(self, tolerance: float = 0.0) -> States:
        """Equal states as one; above zero, states in one cell of a grid of width `tolerance`.

        The heaviest of them stands for all.
        """
        if len(self) < 2:
            return self
        keys: tuple[NDArray[np.generic], ...] = (self.positions, self.previous_velocities)
        if tolerance > 0:
            keys = tuple(np.round(np.asarray(key, float) / tolerance) + 0.0 for key in keys)
        first, back = distinct_states(*keys, self.alive)
        if len(first) == len(self):
            return self
        weights = np.bincount(back, self.weights, len(first)).astype(np.float64)
        if tolerance > 0:
            order = np.lexsort((-self.weights, back))
            first = order[np.searchsorted(back[order], np.arange(len(first)))]
        return States(
            self.positions[first], self.previous_velocities[first], self.alive[first], weights
        )


@dataclass
class AbsorptionStatistics:
    """What is known of the law so far: masses of runs by how they ended, and by time.

    Parameters
    ----------
    arrival : (N+1,)
    survivors : (n+1,)
    members : (n,)
    population : (N+1, n+1)
        Mass of the states with k alive that came about at step t, whether the run ended or not.
    ended : (N+1, n+1)
        Of these, the mass of the runs that ended then.
    """

    arrival: FloatArray
    survivors: FloatArray
    members: FloatArray
    population: FloatArray
    ended: FloatArray

    @classmethod
    def none(cls, scenario: Scenario) -> AbsorptionStatistics:
        """Nothing is known but that everybody is alive at first."""
        n, steps = scenario.n, scenario.n_steps
        population = np.zeros((steps + 1, n + 1))
        population[0, n] = 1.0
        return cls(
            np.zeros(steps + 1),
            np.zeros(n + 1),
            np.zeros(n),
            population,
            np.zeros((steps + 1, n + 1)),
        )

    def end(self, states: States) -> None:
        """Count states at the horizon."""
        self.survivors += np.bincount(
            states.alive.sum(axis=1), states.weights, minlength=len(self.survivors)
        )
        self.members += states.weights @ states.alive


def split(
    move: Transition,
    states: States,
    step: int,
    cutoff: float,
    most_light: float,
    endings: AbsorptionStatistics,
    light: FloatArray,
) -> Iterator[States]:
    """The states after a step in which the run goes on, in parts of at most `ROOM` bytes.

    Runs that end are counted in `endings`. Into `light` (S,) is written what was cut off of every
    state, outcomes lighter than `cutoff` or too many for `ROOM`; -1 where that is more than the
    part `most_light` of the state, which then has not been split at all.
    """
    n = states.alive.shape[1]
    room = min(ROOM // (33 * n + 8), len(states) << min(n, 20))
    parents, masses = np.empty(room, np.int64), np.empty(room)
    fates = np.empty((room, n), bool)
    arrival = np.zeros(1)
    core, first = _core(), 0
    while first < len(states):
        survivors = np.zeros(n + 1)
        arrival[0] = 0.0
        first, filled = core.split(
            first,
            np.ascontiguousarray(states.weights),
            np.ascontiguousarray(move.survival),
            np.ascontiguousarray(states.alive),
            np.ascontiguousarray(move.inside),
            cutoff,
            most_light,
            parents,
            fates,
            masses,
            arrival,
            endings.population[step + 1],
            survivors,
            endings.members,
            light,
        )
        endings.arrival[step + 1] += arrival[0]
        endings.survivors += survivors
        endings.ended[step + 1] += survivors
        origin, kept = parents[:filled], fates[:filled].copy()
        shown = kept[..., None]
        yield States(
            np.where(shown, move.positions[origin], 0.0),
            np.where(shown, move.velocities[origin], 0.0),
            kept,
            masses[:filled].copy(),
        )


def distinct_states(*arrays: NDArray[np.generic]) -> tuple[IntArray, IntArray]:
    """Rows that differ, of arrays with a common first axis, compared bit by bit.

    Returns
    -------
    first : (D,) int
        The first row of every distinct state, ascending.
    back : (B,) int
        Which of the D every row is.
    """
    count = len(arrays[0])
    parts = [np.ascontiguousarray(a).reshape(count, math.prod(a.shape[1:])) for a in arrays]
    widths = [part.shape[1] * part.itemsize for part in parts]
    words = np.zeros((count, -(-sum(widths) // 8)), np.uint64)
    ends = np.cumsum(widths)
    for part, end, width in zip(parts, ends, widths, strict=True):
        words.view(np.uint8)[:, end - width : end] = part.view(np.uint8)
    slots = np.full(1 << (2 * count).bit_length(), -1)
    first, back = np.empty(count, np.int64), np.empty(count, np.int64)
    return first[: _core().grouped(words, slots, first, back)], back
