"""The exact distribution of an open-loop plan, by recursion over the sets of living members."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from typing_extensions import override

from ..grid.nodes import UNIT
from ..hazard import subdivided
from ..problems.joint import terminal_costs
from ..problems.member_sets import subsets
from ..scenario.variations import require_default
from ..typing import BoolArray, FloatArray, IntArray, Interval
from .set_kernels import recursion

if TYPE_CHECKING:
    from ..scenario import Scenario

MAX_EXACT = 10
"""Maximum number of members of plans with an exact distribution."""


MAX_MEMBERS = 62
"""Maximum number of members, which are bits of a mask."""

MAX_SETS = 4096
"""Number of sets that are followed from a step to the next."""

NEGLIGIBLE = 1e-11
"""Probability of an outcome of a step that is not followed."""

CORE = 10
"""Number of members whose sets bound the success of all sets that are not followed."""

_TOGETHER = 64  # sets whose outcomes are listed before equal ones are joined


class OutcomeLaw(ABC):
    """Outcome distribution of n members that follow given trajectories, up to `rounding`."""

    n: int
    rounding: float

    @abstractmethod
    def cost(self, objective: str) -> float:
        """Expected cost of `casswarm.problems.joint`, with the actual arrivals of all members."""

    @property
    @abstractmethod
    def arrival(self) -> FloatArray:
        """Probability (N+1,) that the first arrival of a living member is at step t."""

    @property
    @abstractmethod
    def survival(self) -> FloatArray:
        """Probability (N+1, n) that a member is alive at step t, or was when its run ended."""

    @cached_property
    def success(self) -> Interval:
        """The probability that enough members arrive alive, exact up to rounding."""
        probability = 1.0 - self.cost("success")
        low, high = max(0.0, probability - self.rounding), min(1.0, probability + self.rounding)
        return Interval(low, high)

    @property
    def failure(self) -> float:
        """Probability that too few members arrive, to relative precision however small it is."""
        return self.cost("success")

    @property
    def arrivals_mean(self) -> float:
        """Mean number of living members in the target when the run ends."""
        return self.n * (1.0 - self.cost("arrivals"))

    @property
    def survivors_mean(self) -> float:
        """Mean number of members alive when the run ends."""
        return self.n * (1.0 - self.cost("survivors"))


@dataclass(frozen=True, eq=False)
class CasesDistribution(OutcomeLaw):
    """Outcome distribution for a prior over the cases of a hazard that is not known.

    Parameters
    ----------
    prior : (K,)
    cases : tuple of K PlanDistribution
        If each of the cases is the true one.
    """

    prior: FloatArray
    cases: tuple[PlanDistribution, ...]

    @property
    def n(self) -> int:  # type: ignore[override]
        """Number of members."""
        return self.cases[0].n

    @property
    def rounding(self) -> float:  # type: ignore[override]
        """Bound on the rounding error of a probability."""
        return max(case.rounding for case in self.cases) + len(self.cases) * UNIT

    @override
    def cost(self, objective: str) -> float:
        return float(self.prior @ [case.cost(objective) for case in self.cases])

    @property
    @override
    def arrival(self) -> FloatArray:
        return np.asarray(np.tensordot(self.prior, [case.arrival for case in self.cases], 1))

    @property
    @override
    def survival(self) -> FloatArray:
        return np.asarray(np.tensordot(self.prior, [case.survival for case in self.cases], 1))


def plan_law(
    scenario: Scenario, positions: FloatArray, step: int = 0
) -> PlanDistribution | CasesDistribution:
    """Law of trajectories (N+1, n, 2) from a step on, at which all are alive."""
    cases = [case.scenario for case in scenario.cases]
    laws = [PlanDistribution.from_positions(each, positions, step) for each in cases]
    if len(laws) == 1:
        return laws[0]
    return CasesDistribution(np.array([case.weight for case in scenario.cases]), tuple(laws))


@dataclass(frozen=True, eq=False)
class PlanDistribution(OutcomeLaw):
    """Outcome distribution of a swarm whose living members follow given trajectories.

    Parameters
    ----------
    n : int
        Number of members.
    lost : (N, 2^n, n)
        Probability that a member of a set d is lost in step t -> t+1; 0 outside d.
    inside : (N, n) bool
        Whether each member that counts is in the target at steps 1..N.
    needed : int
        Number of living members in the target that ends a run.
    rounding : float
        Bound on the rounding error of a probability, if rates are exact to as many units in the
        last place as a sum over members and radars has operations.
    """

    n: int
    lost: FloatArray
    inside: BoolArray
    needed: int
    rounding: float

    @classmethod
    def from_positions(
        cls, scenario: Scenario, positions: FloatArray, step: int = 0
    ) -> PlanDistribution:
        """Distribution of trajectories (N+1, n, 2) from a step on, at which all are alive."""
        n = positions.shape[1]
        lost = loss_probabilities(scenario, positions, step)
        operations = n + len(scenario.hazard.radar_positions) + 64
        return cls(
            n,
            lost,
            scenario.swarm.counted(scenario.target.contains(positions[1:])),
            scenario.success.arrivals,
            len(lost) * n * operations * UNIT,
        )

    @override
    def cost(self, objective: str) -> float:
        return float(self._costs(objective)[0, -1])

    @property
    def failures(self) -> FloatArray:
        """Probability (N+1, 2^n) that too few members of a set arrive after a step."""
        return self._costs("success")

    def _costs(self, objective: str) -> FloatArray:
        """Expected costs (N+1, 2^n) of all sets from a step on."""
        costs, ended, last = terminal_costs(objective, self.n, self.inside, self.needed)
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
    @override
    def arrival(self) -> FloatArray:
        return self._forward[1]

    @property
    @override
    def survival(self) -> FloatArray:
        return self._forward[2]

    @cached_property
    def _forward(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        sets, steps = subsets(self.n), len(self.lost)
        masses, arrival = np.zeros((steps + 1, 2**self.n)), np.zeros(steps + 1)
        survival, absorbed = np.ones((steps + 1, self.n)), np.zeros(self.n)
        masses[0, -1] = 1.0
        ended = terminal_costs("success", self.n, self.inside, self.needed)[1]
        for step in range(steps):
            following = sets.advanced(masses[step], self.lost[step])
            ending = np.where(ended[step], following, 0.0)
            absorbed = absorbed + ending @ sets.members
            arrival[step + 1] = ending.sum()
            masses[step + 1] = following - ending
            survival[step + 1] = absorbed + masses[step + 1] @ sets.members
        return masses, arrival, survival


def loss_probabilities(scenario: Scenario, positions: FloatArray, step: int = 0) -> FloatArray:
    """Probabilities (..., N, 2^n, n) of losing a member of a set in a step, 0 outside the set.

    `positions` are (..., N+1, n, 2), from `step` on.
    """
    parts, members = scenario.time.substeps, subsets(positions.shape[-2]).members
    path = np.moveaxis(subdivided(np.moveaxis(positions, -3, 0), parts), 0, -3)
    hazard = scenario.by_parts.hazard
    rates = hazard.set_rates_along(path[..., 1:, :, :], members, parts * step)
    if parts > 1:
        rates = rates.reshape(*rates.shape[:-3], -1, parts, *rates.shape[-2:]).mean(axis=-3)
    return np.asarray(-np.expm1(-scenario.time.dt * rates))


def prescribed_costs(
    scenario: Scenario, objective: str, positions: FloatArray, arrivals: IntArray
) -> FloatArray:
    """Costs (B,) of plans (B, N+1, n, 2), as `casswarm.problems.joint` computes them.

    `arrivals` (B, n) are the prescribed steps, 0 for members that do not arrive. Of several cases
    of the hazard, the means by their weights.
    """
    if len(cases := scenario.cases) > 1:
        each = [prescribed_costs(c.scenario, objective, positions, arrivals) for c in cases]
        mean = np.array([case.weight for case in cases]) @ np.array(each)
        return np.asarray(np.minimum(1.0, mean))
    lost, n = loss_probabilities(scenario, positions), positions.shape[2]
    steps = lost.shape[1]
    arriving = np.arange(1, steps + 1)[:, None] == arrivals[:, None]  # (B, N, n)
    counting, needed = scenario.swarm.counted(arriving), scenario.success.arrivals
    costs, ended, last = terminal_costs(objective, n, counting, needed)
    shape = len(lost), steps, 2**n
    continues, costs = (np.array(np.broadcast_to(part, shape), float) for part in (~ended, costs))
    return np.asarray(recursion(lost, continues, costs, np.tile(last, (len(lost), 1)))[0][:, -1])


@dataclass(frozen=True)
class LikelySets:
    """Proven bounds on the success of a plan, from the sets of living members that are likely.

    Parameters
    ----------
    arrived, failed : float
        Probabilities that a run ends with and without an arrival, along sets that were followed.
    left : float
        Probability of all other runs.
    rescued : float
        Lower bound on the probability that one of those arrives.
    rounding : float
        Bound on the rounding error of a probability, if rates are exact to as many units in the
        last place as a sum over members and radars has operations.
    """

    arrived: float
    failed: float
    left: float
    rescued: float
    rounding: float

    @property
    def success(self) -> Interval:
        """Bounds on the probability that some member arrives alive."""
        low = max(self.arrived, 1.0 - self.failed - self.left) + self.rescued - self.rounding
        return Interval(max(0.0, low), min(1.0, 1.0 - self.failed + self.rounding))


def likely_sets(scenario: Scenario, positions: FloatArray, max_sets: int = MAX_SETS) -> LikelySets:
    """Follow the most probable sets of members along trajectories (T+1, n, 2).

    Equal probabilities are treated alike: all of them are followed, or none.
    """
    require_default(scenario, "time.substeps", "the distribution of more than ten members")
    steps, n = len(positions) - 1, positions.shape[1]
    inside = scenario.target.contains(positions[1:])
    masks, masses = np.array([(1 << n) - 1], np.int64), np.ones(1)
    arrived = failed = left = rescued = 0.0
    core, terms = _Core.of(scenario, positions), 0
    for step in range(steps):
        if not masks.size:
            break
        masks, masses, rest = _after_step(scenario, step, positions[step + 1], masks, masses)
        terms += len(masks)
        arriving = _alive(masks, n)[:, inside[step]].sum(axis=1) >= scenario.success.arrivals
        arrived += masses[arriving].sum()
        failed += masses[masks == 0].sum()
        going_on = ~arriving & (masks != 0)
        masks, masses = masks[going_on], masses[going_on]
        kept = _greatest(masses, max_sets)
        left += rest + masses[~kept].sum()
        if core is not None and not kept.all():
            rescued += (masses[~kept] * core.success(step, masks[~kept])).sum()
        masks, masses = masks[kept], masses[kept]
    failed += masses.sum()
    operations = n + len(scenario.hazard.radar_positions) + 64
    rounding = 2.0 * (steps * n * operations + terms) * UNIT  # of these sets, and of the core
    return LikelySets(float(arrived), float(failed), float(left), float(rescued), rounding)


@dataclass(frozen=True, eq=False)
class _Core:
    """Some members, and the probabilities that all sets of them fail.

    If rates only decrease with more living members, as with saturation without collisions, any set
    succeeds at least as often as its members of the core alone: with the same random numbers, those
    who survive in the smaller set survive in the larger one.
    """

    members: IntArray  # (c,)
    failures: FloatArray  # (N, 2^c), from all steps after the first on

    @classmethod
    def of(cls, scenario: Scenario, positions: FloatArray) -> _Core | None:
        """The members of least risk alone; None if more members can increase rates."""
        if scenario.hazard_table.kind != "saturation":
            return None
        risks = scenario.hazard.rates_along(positions[1:]).sum(axis=0)
        members = np.sort(np.argsort(risks, kind="stable")[:CORE])
        distribution = PlanDistribution.from_positions(scenario, positions[:, members])
        return cls(members, distribution.failures[1:])

    def success(self, step: int, masks: IntArray) -> FloatArray:
        """Lower bounds on the success of sets, (m,), after a step."""
        bits = (masks[:, None] >> self.members & 1) << np.arange(len(self.members))
        return np.asarray(1.0 - self.failures[step, bits.sum(axis=1)])


def _after_step(
    scenario: Scenario, step: int, positions: FloatArray, masks: IntArray, masses: FloatArray
) -> tuple[IntArray, FloatArray, float]:
    """Masks and probabilities of the sets after a step at positions (n, 2); what is left out."""
    alive = _alive(masks, len(positions))
    rates = scenario.hazard.set_rates_along(positions[None], alive, step)[0]
    lost = -np.expm1(-scenario.time.dt * rates)
    parts = [
        _outcomes(masks[some], masses[some], lost[some])
        for some in (slice(k, k + _TOGETHER) for k in range(0, len(masks), _TOGETHER))
    ]
    outcomes = np.concatenate([part[0] for part in parts])
    probabilities = np.concatenate([part[1] for part in parts])
    return *_joined(outcomes, probabilities), math.fsum(part[2] for part in parts)


def _joined(masks: IntArray, masses: FloatArray) -> tuple[IntArray, FloatArray]:
    """Every set once, with the sum of its probabilities."""
    joined, places = np.unique(masks, return_inverse=True)
    return joined, np.asarray(np.bincount(places.ravel(), masses), float)


def _outcomes(
    masks: IntArray, masses: FloatArray, lost: FloatArray
) -> tuple[IntArray, FloatArray, float]:
    """Sets after a step from sets before it, with probabilities (m, n) of losing their members."""
    before, left = np.arange(len(masks)), 0.0
    for member in range(lost.shape[1]):
        dies = lost[before, member]
        dead = masses * dies
        follow = dead > NEGLIGIBLE
        left += float(dead[~follow].sum())
        masks = np.concatenate([masks, masks[follow] & ~(1 << member)])
        masses = np.concatenate([masses * (1.0 - dies), dead[follow]])
        before = np.concatenate([before, before[follow]])
    return *_joined(masks, masses), left


def _greatest(values: FloatArray, count: int) -> BoolArray:
    """Mask of the `count` greatest values; equal ones are treated alike."""
    if len(values) <= count:
        return np.ones(len(values), bool)
    return np.asarray(values > np.partition(values, -count - 1)[-count - 1])


def _alive(masks: IntArray, n: int) -> BoolArray:
    """Which of n members are in the sets of bit masks (m,): (m, n)."""
    return (masks[:, None] >> np.arange(n) & 1).astype(bool)
