"""One step of the chain, the part that is not random: the same for sampling and for exact laws.

The paper's section II.C: observe positions and who is alive, decide, move; then member i survives
with probability exp(-dt lambda_i(X(t+1), alive(t))).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ..policies.base import Policy, checked_velocities
from ..problems.formation import motion_of
from ..typing import BoolArray, FloatArray, IntArray

if TYPE_CHECKING:
    from ..scenario import Scenario

PHYSICAL = 1e-9
"""Excess over v_max or a_max (in units of velocity) up to which a velocity is left as it is."""


@dataclass(frozen=True, eq=False)
class Transition:
    """What a policy makes of B states in a step.

    Parameters
    ----------
    velocities, positions : (B, n, 2)
        V(t), within v_max and a_max, and X(t+1).
    survival : (B, n)
        Probability that a living member survives the step; 1 for the destroyed, without meaning.
    inside : (B, n) bool
        Who is in the target zone at X(t+1).
    shortfalls, failures, fallbacks : (B,) int
        As in `Decision`.
    saturated : (B,) int
        Members whose velocity had to be changed to respect v_max and a_max.
    """

    velocities: FloatArray
    positions: FloatArray
    survival: FloatArray
    inside: BoolArray
    infeasible: IntArray
    failures: IntArray
    fallbacks: IntArray
    saturated: IntArray


def transition(
    scenario: Scenario,
    policy: Policy,
    step: int,
    positions: FloatArray,
    previous_velocities: FloatArray,
    alive: BoolArray,
) -> Transition:
    """Take B states, positions and previous velocities (B, n, 2), from `step` to step + 1.

    Raises
    ------
    PolicyError, HazardError
        Velocities or rates of the wrong shape, or not finite.
    """
    decision = policy.decide(step, *map(_read_only, (positions, previous_velocities, alive)))
    wanted = checked_velocities(policy.name, step, decision.velocities, alive)
    velocities, saturated = physical(scenario, wanted, previous_velocities, alive)
    following = positions + scenario.time.dt * velocities
    return Transition(
        velocities=velocities,
        positions=following,
        survival=np.exp(-scenario.time.dt * scenario.hazard.rates(following, alive)),
        inside=scenario.target.contains(following),
        infeasible=decision.infeasible,
        failures=decision.failures,
        fallbacks=decision.fallbacks,
        saturated=saturated,
    )


def _read_only(array: NDArray[Any]) -> NDArray[Any]:
    """A view that a policy cannot write into: the dead stay dead."""
    view = array.view()
    view.flags.writeable = False
    return view


def physical(
    scenario: Scenario, wanted: FloatArray, previous_velocities: FloatArray, alive: BoolArray
) -> tuple[FloatArray, IntArray]:
    """Velocities (B, n, 2) within v_max and a_max, and how many had to be changed, (B,)."""
    sets = motion_of(scenario).sets(previous_velocities)
    beyond = alive & (sets.violation(wanted) > PHYSICAL)
    velocities = wanted.copy()
    if beyond.any():
        velocities[beyond] = sets[beyond].project(wanted[beyond])
    return velocities, beyond.sum(axis=1)
