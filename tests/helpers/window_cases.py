"""Formation problems over several steps, as test cases."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from casswarm import Saturation, SaturationCollision
from casswarm.formation import Formation, corridor_mpc_formation, leader_mpc_formation
from casswarm.motion import Motion, Step

RADARS = ((3.0, 2.0), (1.0, 3.0))
HAZARD, COLLIDING = Saturation(RADARS), SaturationCollision(RADARS)
DT, RHO = 0.33, 0.05
MOTION = Motion(v_max=2.0, a_max=0.5, dt=DT)
GOAL = np.array([1.0, 1.0])


def window(
    batch: int,
    n: int,
    horizon: int,
    seed: int,
    spread: float = 0.3,
    deaths: float = 0.3,
    hazard: Saturation = HAZARD,
) -> Step:
    """States of members along a curved guide, some of them destroyed."""
    rng = np.random.default_rng(seed)
    alive = rng.random((batch, n)) >= deaths
    alive[:, 0] |= ~alive.any(axis=1)
    previous_velocities = np.clip(rng.normal([1.2, 0.8], 0.6, (batch, n, 2)), -1.9, 1.9)
    positions = GOAL - DT * previous_velocities + rng.normal(0, spread, (batch, n, 2))
    turn = 0.25 * np.arange(horizon)
    pace = 1.4 * np.stack([np.cos(turn), np.sin(turn)], axis=1)
    goals = GOAL + DT * np.concatenate([np.zeros((1, 2)), np.cumsum(pace[1:], axis=0)])
    living = alive[..., None]
    return Step(hazard, MOTION, positions * living, previous_velocities * living, alive, goals)


def leaders_of(data: Step) -> NDArray[np.intp]:
    return np.asarray(data.alive.argmax(axis=1))


def both(data: Step) -> list[Formation]:
    return [leader_mpc_formation(data, leaders_of(data)), corridor_mpc_formation(data, RHO)]
