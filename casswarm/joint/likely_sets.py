"""Success of an open-loop plan of many members: its most probable sets of living members."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from ..grid.nodes import UNIT
from ..typing import BoolArray, FloatArray, IntArray, Interval
from .plan_distribution import PlanDistribution

if TYPE_CHECKING:
    from ..scenario import Scenario

MAX_MEMBERS = 62
"""Maximum number of members, which are bits of a mask."""

MAX_SETS = 4096
"""Number of sets that are followed from a step to the next."""

NEGLIGIBLE = 1e-11
"""Probability of an outcome of a step that is not followed."""

CORE = 10
"""Number of members whose sets bound the success of all sets that are not followed."""

_TOGETHER = 64  # sets whose outcomes are listed before equal ones are joined


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
    """Follow the most probable sets of members along trajectories.

    Parameters
    ----------
    scenario : Scenario
        Of at most `MAX_MEMBERS` members.
    positions : (T+1, n, 2)
    max_sets : int
        Equal probabilities are treated alike: all of them are followed, or none.
    """
    steps, n = len(positions) - 1, positions.shape[1]
    inside = scenario.target.contains(positions[1:])
    masks, masses = np.array([(1 << n) - 1], np.int64), np.ones(1)
    arrived = failed = left = rescued = 0.0
    core, terms = _Core.of(scenario, positions), 0
    for step in range(steps):
        if not masks.size:
            break
        masks, masses, rest = _after_step(scenario, positions[step + 1], masks, masses)
        terms += len(masks)
        arriving = (masks & _mask(inside[step])) != 0
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

    Parameters
    ----------
    members : (c,) int
    failures : (N, 2^c)
        From all steps after the first on.
    """

    members: IntArray
    failures: FloatArray

    @classmethod
    def of(cls, scenario: Scenario, positions: FloatArray) -> _Core | None:
        """The members of least risk alone; None if more members can increase rates."""
        if scenario.hazard_table.kind != "saturation":
            return None
        risks = scenario.hazard.single_agent_rates(positions[1:]).sum(axis=0)
        members = np.sort(np.argsort(risks, kind="stable")[:CORE])
        distribution = PlanDistribution.from_positions(scenario, positions[:, members])
        return cls(members, distribution.failures[1:])

    def success(self, step: int, masks: IntArray) -> FloatArray:
        """Lower bounds on the success of sets, (m,), after a step."""
        bits = (masks[:, None] >> self.members & 1) << np.arange(len(self.members))
        return np.asarray(1.0 - self.failures[step, bits.sum(axis=1)])


def _after_step(
    scenario: Scenario, positions: FloatArray, masks: IntArray, masses: FloatArray
) -> tuple[IntArray, FloatArray, float]:
    """Masks and probabilities of the sets after a step at positions (n, 2); what is left out."""
    n = len(positions)
    alive = (masks[:, None] >> np.arange(n) & 1).astype(bool)
    lost = -np.expm1(-scenario.time.dt * scenario.hazard.set_rates(positions[None], alive)[0])
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
    """Whether each is among the `count` greatest; equal ones are treated alike."""
    if len(values) <= count:
        return np.ones(len(values), bool)
    return np.asarray(values > np.partition(values, -count - 1)[-count - 1])


def _mask(members: BoolArray) -> int:
    return sum(1 << int(member) for member in np.flatnonzero(members))
