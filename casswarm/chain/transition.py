"""The deterministic part of a step of the chain, shared by sampling and enumeration.

The paper's section II.C: observe positions and living members, decide, move; then member i survives
with probability exp(-dt lambda_i(X(t+1), alive(t))).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from .._util.constants import SPEED_TOL
from ..policies.base import Policy
from ..policies.decision import checked_velocities
from ..problems.step import Motion
from ..typing import BoolArray, FloatArray, IntArray
from .lattice import Lattice
from .states import States

if TYPE_CHECKING:
    from ..scenario import Scenario

COUNTS = ("infeasible", "solver_failures", "fallbacks", "saturated")
"""Counts of a step: infeasible, failures and fallbacks as in `Decision`, and the number of members
whose velocity was projected to respect v_max and a_max."""

SATURATION_TOL = 1e-9
"""Excess over v_max or a_max, relative to v_max, up to which a projected velocity is not counted:
solvers meet limits to about this accuracy."""


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
    counts : dict of name to (B,) int
        The counts of `COUNTS`.
    """

    velocities: FloatArray
    positions: FloatArray
    survival: FloatArray
    inside: BoolArray
    counts: dict[str, IntArray]


def transition(
    scenario: Scenario,
    policy: Policy,
    step: int,
    states: States,
    lattice: Lattice | None = None,
) -> Transition:
    """Advance B states from `step` to step + 1; on a lattice, to lattice points.

    Raises
    ------
    PolicyError, HazardError
        Velocities or rates of the wrong shape, or not finite.
    """
    positions, previous_velocities, alive = map(
        _read_only, (states.positions, states.previous_velocities, states.alive)
    )
    decision = policy.decide(step, positions, previous_velocities, alive)
    commanded = checked_velocities(policy.name, step, decision.velocities, alive)
    sets = Motion.from_scenario(scenario).sets(previous_velocities)
    excess = np.where(alive, sets.violation(commanded) / scenario.swarm.v_max, 0.0)
    exceeds = excess > SPEED_TOL
    velocities = commanded.copy()
    if exceeds.any():
        velocities[exceeds] = sets[exceeds].project(commanded[exceeds])
    if lattice is None:
        following = positions + scenario.time.dt * velocities
    else:
        velocities, following = lattice.moved(step, positions, velocities, sets)
    saturated = (excess > SATURATION_TOL).sum(axis=1)
    counts = decision.infeasible, decision.failures, decision.fallbacks, saturated
    return Transition(
        velocities=velocities,
        positions=following,
        survival=np.exp(-scenario.time.dt * scenario.hazard.rates(following, alive)),
        inside=scenario.target.contains(following),
        counts=dict(zip(COUNTS, counts, strict=True)),
    )


def _read_only(array: NDArray[Any]) -> NDArray[Any]:
    """A view that a policy cannot write to, so that it cannot change the state."""
    view = array.view()
    view.flags.writeable = False
    return view
