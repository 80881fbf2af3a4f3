"""Problems of casswarm's own kind for every backend: formations of five, and guides."""

from __future__ import annotations

from functools import cache

import numpy as np

from casswarm import Scenario, load_scenario
from casswarm.formation import Formation, corridor_formation, leader_formation
from casswarm.motion import Motion, Step, resample
from casswarm.nlp import Instances, Nlp
from casswarm.problems import GuideTask, guide_instance, guide_nlp

Case = tuple[Nlp, Instances]
COLLISIONS = {"hazard.kind": "saturation+collision", "hazard.beta_1": 0.2, "hazard.beta_2": 6.0}
GATE = {
    "target.center": [8.0, 6.5],
    "swarm.positions": [[0.0, 0.0], [0.5, 0.0], [0.0, 0.5], [-0.5, 0.0], [0.0, -0.5]],
    "hazard.radars": [[4.4, 4.6], [4.5, 3.0]],
    "guide.a_max": 0.2,
}
"""Changes of `paper-1`: a gate close to the start, and more time than the path takes."""

FORMATIONS = ("leader", "constrained", "leader, collisions", "constrained, collisions")


@cache
def formation(name: str) -> Case:
    """One state of five members on their way to the gate, a little out of order."""
    policy, _, rate = name.partition(", ")
    scenario = load_scenario("paper-1").with_values(GATE | (COLLISIONS if rate else {}))
    rng = np.random.default_rng(3)
    here, toward = np.array([3.0, 2.6]), np.array([0.45, 0.35])
    step = Step(
        hazard=scenario.hazard,
        motion=Motion.from_scenario(scenario),
        positions=here + rng.normal(0, 0.15, (1, 5, 2)),
        previous_velocities=toward / scenario.time.dt + rng.normal(0, 0.1, (1, 5, 2)),
        alive=np.ones((1, 5), bool),
        goals=(here + toward)[None],
    )
    made: Formation = (
        leader_formation(step, np.array([0]))
        if policy == "leader"
        else corridor_formation(step, scenario.formation.rho)
    )
    return made.nlp, made.instances


@cache
def guide(t_f: float) -> Case:
    """The guide through the gate that arrives at its last step, from the straight line."""
    scenario = load_scenario("paper-1").with_values(GATE | {"time.t_f": t_f})
    task = _task(scenario)
    nlp = guide_nlp(scenario.hazard, scenario.n_steps)
    line = resample(np.stack([task.start, task.center]), scenario.n_steps, task.dt)
    return nlp, guide_instance(nlp, task, scenario.n_steps, line)


def _task(scenario: Scenario) -> GuideTask:
    return GuideTask.from_scenario(scenario, scenario.positions.mean(axis=0))
