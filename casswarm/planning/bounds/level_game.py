"""The level game: an upper bound on the success of every policy from the members' levels.

A member's level is the value of a potential at its position, a lower bound on the single-agent risk
that is left to it. In the game the members' levels are all that counts: whoever wants to lower its
own by delta is exposed to a single-agent risk of at least delta, with less protection from members
whose levels stay behind, because they are far away. The value of the game bounds the success of
every policy; the proof, with that of the interpolation, is in ``docs/success-bound.md``.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ...hazard import Hazard
from ...typing import FloatArray
from .grid import UNIT
from .level_game_kernels import Buffers, Moves, best_moves, fill_levels, make_decreasing
from .potential import Potential

_UNITS = 16
"""Units of density of a neighbour."""


@dataclass(frozen=True, eq=False)
class LevelGame:
    """The level game of a potential whose levels fall by at most `potential.largest` in a step.

    Parameters
    ----------
    potential : Potential
        With a finite slope and largest drop.
    cells : int
        Number of levels of the grid by which a level can fall in a step.
    players : tuple of int
        Members whose success counts, which can all reach the target; the others protect them at no
        distance all the time.
    """

    potential: Potential
    cells: int
    players: tuple[int, ...]

    @property
    def hazard(self) -> Hazard:
        """Whose rates count."""
        return self.potential.task.hazard

    @cached_property
    def starts(self) -> FloatArray:
        """Levels of the players at step 0."""
        return self.potential.start_levels[list(self.players)]

    @property
    def members(self) -> int:
        """Number of players."""
        return len(self.players)

    @cached_property
    def spacing(self) -> float:
        """g, the distance of neighbouring levels; a drop is at most `cells` of them."""
        potential = self.potential
        return (potential.largest + potential.slack) * (1 + 1e-9) / self.cells

    @cached_property
    def size(self) -> int:
        """M, the number of levels; higher ones count as the last."""
        return max(2, math.ceil(float(self.starts.max()) / self.spacing) + 1)

    @property
    def work(self) -> float:
        """Number of values that are looked up, about."""
        return look_ups(self.members, self.size, self.cells)

    def value(self) -> float:
        """Upper bound on the success probability of every policy."""
        if self.members == 0:
            return 0.0
        if (self.starts <= 0).any():
            return 1.0
        counts = [math.comb(self.size + k - 1, k) for k in range(self.members + 1)]
        offsets = np.append(0, np.cumsum(counts)).astype(np.int64)
        tables = np.zeros(offsets[-1])
        for alive in range(1, self.members + 1):
            levels = np.zeros((counts[alive], alive), np.int64)
            fill_levels(levels)
            moves, buffers = self._moves(alive), self._buffers(alive)
            for corrected in (False, True):
                best_moves(levels, moves, self._binomials, offsets, corrected, buffers, tables)
            values = tables[offsets[alive] : offsets[alive + 1]]
            if alive < self.members:  # which are interpolated otherwise: see `_least_slopes`
                make_decreasing(levels, self._binomials, values)
        steps = self.potential.task.steps
        rounding = 256 * UNIT * self.members * self.cells * (steps + 1)
        return min(1.0, self._at_start(tables[offsets[-2] :]) + rounding)

    @cached_property
    def _binomials(self) -> np.ndarray:
        n = self.members
        return np.array(
            [[math.comb(i, j) for j in range(n + 2)] for i in range(self.size + n + 1)], np.int64
        )

    @staticmethod
    def _buffers(alive: int) -> Buffers:
        drops, after, fallen, ranks = (
            np.zeros(count, np.int64) for count in (alive, alive, alive, 1 << alive)
        )
        least, most, margin, probability = (np.zeros(alive) for _ in range(4))
        values, low, high = (np.zeros(1 << alive) for _ in range(3))
        by_member = drops, after, fallen, probability, least, most, margin
        return Buffers(*by_member, ranks, values, low, high)

    @cached_property
    def _least_slopes(self) -> FloatArray:
        """For 1, ..., n alive, the least ratio of risk and drop; not increasing."""
        slopes = [float(np.diff(self._risks(k), axis=1).min()) for k in range(1, self.members + 1)]
        return np.asarray(np.minimum.accumulate(slopes) / self.spacing * (1 - 1e-9))

    def _risks(self, alive: int) -> FloatArray:
        """Least risk (S, D + 1) of a member by the density of its neighbours and its drop."""
        dt, total = self.potential.task.dt, alive + len(self.potential.starts) - self.members
        densities: FloatArray = total - alive + np.arange(_UNITS * (alive - 1) + 1) / _UNITS
        rates = np.arange(self.cells + 1, dtype=float) * (self.spacing / dt)
        least = self.hazard.least_rates(total, densities, rates)
        assert least is not None
        least[:, 0] = 0.0
        return dt * least

    def _moves(self, alive: int) -> Moves:
        risks = self._risks(alive)
        rises = np.diff(risks, axis=1)
        slope = self._least_slopes[alive - 1] * self.spacing
        steepness = np.zeros_like(risks)
        steepness[:, 1:] = rises / slope * -math.expm1(-slope)
        surplus = np.exp(rises.max(axis=1))
        behind = np.arange(self.size + 2, dtype=float) * self.spacing
        squared = self.potential.least_squared_distance(behind)
        density = np.where(squared > 0, self.hazard.density_bound(squared), 1.0)
        density = _UNITS * np.minimum(density, 1.0)
        return Moves(np.exp(-risks), steepness, surplus, math.exp(slope), density)

    def _at_start(self, values: FloatArray) -> float:
        """Value of the members' levels at step 0, interpolated in exp(-slope level)."""
        nodes = np.minimum(self.starts / self.spacing, self.size - 1)
        cells = np.minimum(np.floor(nodes).astype(int), self.size - 2)
        slope = self._least_slopes[-1] * self.spacing
        upper = np.expm1(-slope * (nodes - cells)) / math.expm1(-slope)
        total = 0.0
        for corner in itertools.product((0, 1), repeat=self.members):
            weight = float(np.prod(np.where(corner, upper, 1 - upper)))
            levels = np.sort(cells + corner)
            rank = sum(math.comb(int(level) + i, i + 1) for i, level in enumerate(levels))
            total += weight * float(values[rank])
        return total


def look_ups(members: int, size: int, cells: int) -> float:
    """Number of values that `LevelGame.value` looks up for states of all members, about."""
    moves = 0.4 * (cells + 1.0) ** members
    return math.comb(size + members - 1, members) * moves * 2.0**members * (1 + members / 2)
