"""The exact law of an open-loop plan, by the closed recursion over the sets of the living."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from ...problems.joint_instances import end_costs
from ...problems.subsets import subsets
from ...typing import BoolArray, FloatArray
from ..bounds.grid import UNIT

if TYPE_CHECKING:
    from ...scenario import Scenario


@dataclass(frozen=True, eq=False)
class PlanDistribution:
    """What becomes of a swarm whose living members follow given ways.

    Parameters
    ----------
    n : int
    lost : (N, 2^n, n)
        Probability that a member of a set d is destroyed in step t -> t+1; 0 outside d.
    inside : (N, n) bool
        Who is in the target at steps 1..N.
    rounding : float
        What rounding can change of a probability, taking rates for exact to as many units in the
        last place as a sum over members and radars has operations.
    """

    n: int
    lost: FloatArray
    inside: BoolArray
    rounding: float

    @classmethod
    def of(cls, scenario: Scenario, positions: FloatArray) -> PlanDistribution:
        """Law of the ways `positions` (N+1, n, 2), from a step on to the scenario's last."""
        n = positions.shape[1]
        members = subsets(n).members
        states = np.empty((len(members), n, 2))
        lost = np.empty((len(positions) - 1, len(members), n))
        for step, places in enumerate(positions[1:]):
            states[:] = places
            lost[step] = -np.expm1(-scenario.time.dt * scenario.hazard.rates(states, members))
        operations = n + len(scenario.hazard.radar_positions) + 64
        return cls(
            n,
            lost,
            scenario.target.contains(positions[1:]),
            len(lost) * n * operations * UNIT,
        )

    @cached_property
    def success(self) -> tuple[float, float]:
        """Bracket of the probability that some member arrives alive: exact but for rounding."""
        found = 1.0 - self.cost("success")
        return max(0.0, found - self.rounding), min(1.0, found + self.rounding)

    @property
    def failure(self) -> float:
        """Probability that nobody arrives, to relative precision however small it is."""
        return self.cost("success")

    @property
    def arrivals_mean(self) -> float:
        """Mean number of living members in the target when the run ends."""
        return self.n * (1.0 - self.cost("arrivals"))

    @property
    def survivors_mean(self) -> float:
        """Mean number of members alive when the run ends."""
        return self.n * (1.0 - self.cost("survivors"))

    def cost(self, objective: str) -> float:
        """The recursion of `casswarm.problems.joint`, with everybody's true arrivals."""
        sets = subsets(self.n)
        costs, ending = end_costs(objective, self.n, self.inside)
        value = np.ones(2**self.n)
        if objective == "survivors":
            value = 1.0 - sets.members.mean(axis=1)
        for step in reversed(range(len(self.lost))):
            value = sets.expectations(np.where(ending[step], costs[step], value), self.lost[step])
        return float(value[-1])

    @cached_property
    def masses(self) -> FloatArray:
        """Probability (N+1, 2^n) that a run is going on at step t with exactly d alive."""
        return self._forward[0]

    @cached_property
    def arrival(self) -> FloatArray:
        """Probability (N+1,) that the first arrival of a living member is at step t."""
        return self._forward[1]

    @cached_property
    def survival(self) -> FloatArray:
        """Probability (N+1, n) that a member is alive at step t, or was when its run ended."""
        return self._forward[2]

    @cached_property
    def _forward(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        sets, steps = subsets(self.n), len(self.lost)
        masses, arrival = np.zeros((steps + 1, 2**self.n)), np.zeros(steps + 1)
        survival, done = np.ones((steps + 1, self.n)), np.zeros(self.n)
        masses[0, -1] = 1.0
        ending = end_costs("success", self.n, self.inside)[1]
        for step in range(steps):
            following = sets.advanced(masses[step], self.lost[step])
            ended = np.where(ending[step], following, 0.0)
            done = done + ended @ sets.members
            arrival[step + 1] = ended.sum()
            masses[step + 1] = following - ended
            survival[step + 1] = done + masses[step + 1] @ sets.members
        return masses, arrival, survival
