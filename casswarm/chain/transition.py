"""The deterministic part of a step of the chain, shared by sampling and enumeration.

The paper's section II.C: observe positions and living members, decide, move; then member i survives
with probability exp(-dt lambda_i(X(t+1), alive(t))).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ..policies.base import Policy, checked_velocities
from ..problems.formation import Motion
from ..typing import BoolArray, FloatArray, IntArray

if TYPE_CHECKING:
    from ..scenario import Scenario

SATURATION_TOL = 1e-9
"""Excess over v_max or a_max (in units of velocity) up to which a velocity is not projected."""


@dataclass(frozen=True, eq=False)
class Transition:
    """Result of a policy's step from B states, before survival is drawn.

    Parameters
    ----------
    velocities, positions : (B, n, 2)
        V(t), within v_max and a_max, and X(t+1).
    survival : (B, n)
        Probability that a living member survives the step; 1, without meaning, for the destroyed.
    inside : (B, n) bool
        Members in the target zone at X(t+1).
    infeasible, solver_failures, fallbacks : (B,) int
        As in `Decision`.
    saturated : (B,) int
        Number of members whose velocity was projected to respect v_max and a_max.
    """

    velocities: FloatArray
    positions: FloatArray
    survival: FloatArray
    inside: BoolArray
    infeasible: IntArray
    solver_failures: IntArray
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
    """Advance B states, positions and previous velocities (B, n, 2), from `step` to step + 1.

    Raises
    ------
    PolicyError, HazardError
        Velocities or rates of the wrong shape, or not finite.
    """
    decision = policy.decide(step, *map(_read_only, (positions, previous_velocities, alive)))
    commanded = checked_velocities(policy.name, step, decision.velocities, alive)
    velocities, saturated = saturate(scenario, commanded, previous_velocities, alive)
    following = positions + scenario.time.dt * velocities
    return Transition(
        velocities=velocities,
        positions=following,
        survival=np.exp(-scenario.time.dt * scenario.hazard.rates(following, alive)),
        inside=scenario.target.contains(following),
        infeasible=decision.infeasible,
        solver_failures=decision.failures,
        fallbacks=decision.fallbacks,
        saturated=saturated,
    )


def _read_only(array: NDArray[Any]) -> NDArray[Any]:
    """A view that a policy cannot write to, so that it cannot change the state."""
    view = array.view()
    view.flags.writeable = False
    return view


def saturate(
    scenario: Scenario, commanded: FloatArray, previous_velocities: FloatArray, alive: BoolArray
) -> tuple[FloatArray, IntArray]:
    """Velocities (B, n, 2) projected to v_max and a_max, and the number (B,) that changed."""
    sets = Motion.from_scenario(scenario).sets(previous_velocities)
    exceeds = alive & (sets.violation(commanded) > SATURATION_TOL)
    velocities = commanded.copy()
    if exceeds.any():
        velocities[exceeds] = sets[exceeds].project(commanded[exceeds])
    return velocities, exceeds.sum(axis=1)
