"""The exact distribution of an open-loop plan, by recursion over the sets of living members."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from ..grid.nodes import UNIT
from ..hazard import KernelHazard
from ..problems.joint_instances import terminal_costs
from ..problems.subsets import subsets
from ..typing import BoolArray, FloatArray, IntArray, Interval
from .rates import blocked, set_rates, unblocked

if TYPE_CHECKING:
    from ..scenario import Scenario

MAX_EXACT = 10
"""Maximum number of members of plans with an exact distribution."""


@dataclass(frozen=True, eq=False)
class PlanDistribution:
    """Outcome distribution of a swarm whose living members follow given trajectories.

    Parameters
    ----------
    n : int
        Number of members.
    lost : (N, 2^n, n)
        Probability that a member of a set d is lost in step t -> t+1; 0 outside d.
    inside : (N, n) bool
        Whether each member is in the target at steps 1..N.
    rounding : float
        Bound on the rounding error of a probability, if rates are exact to as many units in the
        last place as a sum over members and radars has operations.
    """

    n: int
    lost: FloatArray
    inside: BoolArray
    rounding: float

    @classmethod
    def from_positions(cls, scenario: Scenario, positions: FloatArray) -> PlanDistribution:
        """Distribution of trajectories (N+1, n, 2) from some step to the scenario's last."""
        n = positions.shape[1]
        lost = loss_probabilities(scenario, positions)
        operations = n + len(scenario.hazard.radar_positions) + 64
        return cls(
            n,
            lost,
            scenario.target.contains(positions[1:]),
            len(lost) * n * operations * UNIT,
        )

    @cached_property
    def success(self) -> Interval:
        """The probability that some member arrives alive, exact up to rounding."""
        probability = 1.0 - self.cost("success")
        low, high = max(0.0, probability - self.rounding), min(1.0, probability + self.rounding)
        return Interval(low, high)

    @property
    def failure(self) -> float:
        """Probability that no member arrives, to relative precision however small it is."""
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
        """Expected cost of `casswarm.problems.joint`, with the actual arrivals of all members."""
        return float(self._costs(objective)[0, -1])

    @property
    def failures(self) -> FloatArray:
        """Probability (N+1, 2^n) that no member of a set arrives after a step."""
        return self._costs("success")

    def _costs(self, objective: str) -> FloatArray:
        """Expected costs (N+1, 2^n) of all sets from a step on."""
        costs, ended, last = terminal_costs(objective, self.n, self.inside)
        values = np.empty((len(self.lost) + 1, 2**self.n))
        values[-1] = last
        for step in reversed(range(len(self.lost))):
            after = np.where(ended[step], costs[step], values[step + 1])
            values[step] = subsets(self.n).expectations(after, self.lost[step])
        return values

    @property
    def masses(self) -> FloatArray:
        """Probability (N+1, 2^n) that a run has not ended by step t and exactly d are alive."""
        return self._forward[0]

    @property
    def arrival(self) -> FloatArray:
        """Probability (N+1,) that the first arrival of a living member is at step t."""
        return self._forward[1]

    @property
    def survival(self) -> FloatArray:
        """Probability (N+1, n) that a member is alive at step t, or was when its run ended."""
        return self._forward[2]

    @cached_property
    def _forward(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        sets, steps = subsets(self.n), len(self.lost)
        masses, arrival = np.zeros((steps + 1, 2**self.n)), np.zeros(steps + 1)
        survival, absorbed = np.ones((steps + 1, self.n)), np.zeros(self.n)
        masses[0, -1] = 1.0
        ended = terminal_costs("success", self.n, self.inside)[1]
        for step in range(steps):
            following = sets.advanced(masses[step], self.lost[step])
            ending = np.where(ended[step], following, 0.0)
            absorbed = absorbed + ending @ sets.members
            arrival[step + 1] = ending.sum()
            masses[step + 1] = following - ending
            survival[step + 1] = absorbed + masses[step + 1] @ sets.members
        return masses, arrival, survival


def loss_probabilities(scenario: Scenario, positions: FloatArray) -> FloatArray:
    """Probabilities (..., N, 2^n, n) of losing a member of a set in a step, 0 outside the set.

    Parameters
    ----------
    scenario : Scenario
    positions : (..., N+1, n, 2)
    """
    after, hazard = positions[..., 1:, :, :], scenario.hazard
    n = after.shape[-2]
    members, points = subsets(n).members, after.reshape(-1, n, 2)
    if isinstance(hazard, KernelHazard):
        rates = unblocked(set_rates(hazard, blocked(points)), len(points)) * members
    else:
        states = np.repeat(points, len(members), axis=0)
        rates = hazard.rates(states, np.tile(members, (len(points), 1)))
    lost = -np.expm1(-scenario.time.dt * rates)
    return np.asarray(lost.reshape(*after.shape[:-2], len(members), n))


def prescribed_costs(
    scenario: Scenario, objective: str, positions: FloatArray, arrivals: IntArray
) -> FloatArray:
    """Costs (B,) of plans, as `casswarm.problems.joint` computes them for prescribed arrivals.

    Parameters
    ----------
    scenario : Scenario
    objective : str
    positions : (B, N+1, n, 2)
    arrivals : (B, n) int
        Arrival steps, 0 for members that do not arrive.
    """
    lost, n = loss_probabilities(scenario, positions), positions.shape[2]
    steps = lost.shape[1]
    arriving = np.arange(1, steps + 1)[:, None] == arrivals[:, None]  # (B, N, n)
    costs, ended, last = terminal_costs(objective, n, arriving)
    from .set_kernels import recursion

    shape = len(lost), steps, 2**n
    continues, costs = (np.array(np.broadcast_to(part, shape), float) for part in (~ended, costs))
    return np.asarray(recursion(lost, continues, costs, np.tile(last, (len(lost), 1)))[0][:, -1])
