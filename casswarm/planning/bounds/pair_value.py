"""The value function of two members: approximate success probabilities of every joint state."""

from __future__ import annotations

from dataclasses import dataclass, field
from itertools import product
from typing import TYPE_CHECKING

import numpy as np

from ...scenario.io import require_scenario
from ...typing import FloatArray
from .pair_bound import first_program
from .pair_tube import PairBlock

if TYPE_CHECKING:
    from ...scenario import Scenario

_MAX_NODES = 5_000_000


@dataclass(frozen=True, eq=False)
class PairValueFunction:
    """Largest success probability of two members along the nodes of a grid, without a_max.

    The values are those of a policy on the nodes, up to interpolation of a survivor's. They are not
    bounds; `casswarm.planning.bounds.pair_bound` proves one.

    Parameters
    ----------
    origin : (2,)
        Position of node (0, 0).
    shifts : (2, 2)
        By which positions are beyond those on the grid; 0 unless a member can never arrive.
    spacing : float
    step : float
        Largest change of a coordinate in a time step.
    blocks : tuple of PairBlock
        Nodes of both members, for steps 1 to N.
    values : tuple of ndarray
        Success probability at the nodes, before losses of that step are drawn.
    """

    origin: FloatArray
    shifts: FloatArray
    spacing: float
    step: float
    blocks: tuple[PairBlock, ...] = field(repr=False)
    values: tuple[FloatArray, ...] = field(repr=False)

    @classmethod
    def from_scenario(cls, scenario: Scenario, max_nodes: int = _MAX_NODES) -> PairValueFunction:
        """Value function of a scenario of two members, on a grid of about `max_nodes` nodes.

        Raises
        ------
        PlanningError
            As `casswarm.planning.bounds.pair_bound`.
        """
        require_scenario("PairValueFunction.from_scenario", scenario)
        program = first_program(scenario, max_nodes, certified=False)
        _, kept = program.backward()
        return cls(
            program.task.start,
            scenario.positions - program.starts,
            program.spacing,
            program.task.step,
            tuple(blocks[0] for blocks in program.blocks[1:]),
            tuple(values[0] for values in kept),
        )

    def after(self, step: int, positions: FloatArray) -> FloatArray:
        """Interpolated success probability (B,) of being at positions (B, 2, 2) at a step, from 1.

        It includes the losses of that step; 0 outside the grid.
        """
        if not 1 <= step <= len(self.values):
            return np.zeros(len(positions))
        block, values = self.blocks[step - 1], self.values[step - 1]
        at = ((positions - self.shifts - self.origin) / self.spacing).reshape(-1, 4) - block.low
        last = np.array(values.shape) - 1
        inside = ((at >= 0) & (at <= last)).all(axis=1)
        cells = np.clip(np.floor(at).astype(int), 0, last - 1)
        fractions = at - cells
        total = np.zeros(len(at))
        for corner in product((0, 1), repeat=4):
            weights = np.where(corner, fractions, 1 - fractions).prod(axis=1)
            total += weights * values[tuple((cells + corner).T)]
        return np.where(inside, total, 0.0)

    def path(self, starts: FloatArray) -> FloatArray:
        """Positions (N+1, 2, 2) along the best nodes from the starts, while both are alive."""
        position = (starts - self.shifts - self.origin).ravel() / self.spacing
        reach = self.step / self.spacing * (1 + 1e-9)
        path = [position]
        for block, values in zip(self.blocks, self.values, strict=True):
            first = np.maximum(np.ceil(position - reach).astype(int) - block.low, 0)
            last = np.floor(position + reach).astype(int) - block.low
            window = values[tuple(slice(a, b + 1) for a, b in zip(first, last, strict=True))]
            best = np.unravel_index(int(window.argmax()), window.shape)
            position = np.asarray(block.low + first + best, float)
            path.append(position)
        return self.origin + self.shifts + self.spacing * np.array(path).reshape(-1, 2, 2)
