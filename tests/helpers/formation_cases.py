"""Formation problems of typical states."""

import numpy as np

from casswarm import load_scenario
from casswarm.formation import Formation, corridor_formation, leader_formation
from casswarm.motion import Motion, Step


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
