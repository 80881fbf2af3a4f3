"""Limits of acceleration of guides, and a proven bound on the risk of the paths that obey them."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from ..._util.constants import SPEED_TOL
from ...typing import FloatArray
from .grid import UNIT, Relaxation

if TYPE_CHECKING:
    from ...scenario import Scenario

QUANTUM = 2.0**-26
"""Lengths in units of the largest step, and risks in units of about the least one, are rounded
outwards to multiples of it. So the proof does not depend on the last digits of its data, in which
scenarios in different units differ: its search would lead them to different, valid bounds."""


def power_of_two(value: float) -> float:
    """The largest power of two up to a positive value."""
    return 2.0 ** (math.frexp(value)[1] - 1)


def floored(values: FloatArray, scale: float) -> FloatArray:
    """Values rounded down to multiples of `QUANTUM`, relative to about `scale`."""
    quantum = QUANTUM * power_of_two(scale)
    return np.asarray(np.floor(values / quantum) * quantum)


class AccelerationLimits(NamedTuple):
    """Limits on second differences of positions.

    Parameters
    ----------
    later : float
        Bound on |X(t+1) - 2 X(t) + X(t-1)|, t >= 1.
    first : float
        Bound on |X(1) - X(0) - `displacement`|; infinite if the first velocity is free.
    displacement : (2,)
        dt V(-1).
    """

    later: float
    first: float
    displacement: FloatArray

    def in_steps(self, step: float) -> AccelerationLimits:
        """The limits in units of the length `step`, rounded outwards to multiples of `QUANTUM`."""

        def bound(length: float) -> float:
            return math.ceil(length * (1 + 8 * UNIT) / QUANTUM) * QUANTUM

        displacement = np.round(self.displacement / step / QUANTUM) * QUANTUM
        first = self.first if math.isinf(self.first) else bound(self.first / step + 2 * QUANTUM)
        return AccelerationLimits(bound(self.later / step), first, displacement)


@dataclass(frozen=True)
class AccelerationBound:
    """A proven lower bound on the risk of the paths that obey the limits of acceleration, too.

    Parameters
    ----------
    bound : float
        No path that obeys the limits of speed and acceleration and ends, by step N, at most
        `radius` from the target's centre has less risk.
    best : float
        Least known risk of such a path.
    radius : float
    reason : str
        Why the proof ended.
    regions : int
        Number of regions of paths that were bounded.
    seconds : float
    """

    bound: float
    best: float
    radius: float
    reason: str
    regions: int
    seconds: float

    @property
    def gap(self) -> float:
        """(best - bound) / best."""
        return (self.best - self.bound) / self.best


def acceleration_limits(scenario: Scenario) -> AccelerationLimits:
    """The limits of a scenario's guides, with the chain's tolerance and rounded outwards."""
    dt, swarm = scenario.time.dt, scenario.swarm
    task = Relaxation.from_scenario(scenario)
    extent = float(np.abs([task.start, task.center]).max() + task.steps * task.step)
    excess = SPEED_TOL * swarm.v_max * dt + 64 * UNIT * extent

    def bound(a_max: float) -> float:
        return dt * math.sqrt(a_max) * (1 + 8 * UNIT) + excess

    free = swarm.velocity == "guide" or not scenario.guide.acceleration_limited
    displacement = np.zeros(2) if free else dt * np.asarray(swarm.velocity, float)
    first = math.inf if free else bound(swarm.a_max)
    return AccelerationLimits(bound(scenario.guide_a_max), first, displacement)
