"""Formation problems of typical states, and of large swarms."""

from dataclasses import dataclass

import casadi as ca
import numpy as np
from window_cases import MOTION

from casswarm import Saturation, SaturationCollision, load_scenario
from casswarm.formation import Formation, corridor_formation, leader_formation
from casswarm.hazard import KernelHazard, regular
from casswarm.motion import Motion, Step

RADARS = ((4.4, 4.6), (4.5, 3.0))
PACE = np.array([0.8, 0.8])


@dataclass(frozen=True)
class Gaussian(KernelHazard):
    """A user's kernels: bell-shaped sources, and a crowd that multiplies."""

    height: float = 2.0

    def source(self, squared_distance):
        return self.height * ca.exp(-0.3 * squared_distance)

    def density(self, squared_distance):
        return ca.exp(-squared_distance)

    def collision(self, squared_distance):
        return 1e-3 / regular(squared_distance)

    def combine(self, source, density, collision):
        return source * ca.exp(-0.5 * density) + collision


HAZARDS = {
    "plain": Saturation(RADARS, alpha_1=4.0, alpha_2=3.0, alpha_3=4.0),
    "strengths": Saturation(RADARS, (0.5, 2.0), alpha_1=1.0, alpha_2=0.0, alpha_3=2.0),
    "collision": SaturationCollision(RADARS, beta_1=0.2, beta_2=6.0),
    "gaussian": Gaussian(RADARS),
}


def formations(name: str, count: int) -> list[Formation]:
    """Problems of typical states: behind the guide's next point, some members destroyed."""
    scenario, rng = load_scenario(name), np.random.default_rng(0)
    goal = np.array([2.0, 1.5])
    alive = rng.random((count, 5)) < 0.8
    alive[:, 0] = True
    step = Step(
        scenario.hazard,
        Motion(scenario.swarm.v_max, scenario.swarm.a_max, scenario.time.dt),
        positions=goal - [0.4, 0.3] + 0.15 * rng.normal(size=(count, 5, 2)),
        previous_velocities=np.array([1.2, 0.9]) + 0.1 * rng.normal(size=(count, 5, 2)),
        alive=alive,
        goals=goal[None],
    )
    corridor = corridor_formation(step, scenario.formation.rho)
    return [leader_formation(step, np.zeros(count, int)), corridor]


def disc(n: int, seed: int = 0, area: float = 0.01, hazard: str = "plain") -> Step:
    """A step of n members at random in and around a corridor of squared radius n times `area`."""
    rng = np.random.default_rng(seed)
    radius = 1.1 * np.sqrt(area * n * rng.random(n))
    angle = rng.uniform(0.0, 2.0 * np.pi, n)
    positions = radius[:, None] * np.stack([np.cos(angle), np.sin(angle)], -1)
    velocities, alive = PACE + rng.normal(0.0, 0.2, (1, n, 2)), np.ones((1, n), bool)
    goal = positions.mean(axis=0) + MOTION.dt * PACE
    return Step(HAZARDS[hazard], MOTION, positions[None], velocities, alive, goal[None])
