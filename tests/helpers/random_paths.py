"""Random scenarios of one agent, and random paths, with which bounds are attacked."""

from __future__ import annotations

import math

import numpy as np
from small_scenarios import MEMBER, Array, free, small

from casswarm import Scenario


def geometry(seed: int, *, limited: bool = False) -> Scenario:
    """One agent among one to four radars, with or without limits of acceleration."""
    rng = np.random.default_rng(seed)
    radars = [(float(x), float(y)) for x, y in rng.uniform(-1, 5, (int(rng.integers(1, 5)), 2))]
    radars = [radar for radar in radars if math.hypot(*radar) > 0.3] or [(2.0, 1.0)]
    target = (float(rng.uniform(2, 5)), float(rng.uniform(-2, 5)))
    steps = int(rng.integers(10, 18))
    if not limited:
        return free(target, radars, steps)
    values: dict[str, object] = {"swarm__a_max": float(rng.uniform(0.05, 1.0))}
    if rng.random() < 0.3:
        values["swarm__velocity"] = rng.uniform(-1, 1, 2).tolist()
    return small(MEMBER, target, radars, steps, guide__margin=0.0, **values)


def random_paths(scenario: Scenario, count: int, seed: int, steps: int | None = None) -> Array:
    """Random paths (m, T+1, 2) within the limits, of those that end in the target, all steps."""
    rng, swarm, dt = np.random.default_rng(seed), scenario.swarm, scenario.time.dt
    T = scenario.n_steps if steps is None else steps
    limits = [math.sqrt(swarm.a_max)] + [math.sqrt(scenario.guide_a_max)] * (T - 1)
    if not scenario.guide.acceleration_limited:
        limits = [math.inf] * T
    unknown, center = swarm.velocity == "guide", np.array(scenario.target.center)
    noise = rng.choice([0.05, 0.3, 1.0], (count, 1))  # some are nearly straight
    velocity = np.tile(0.0 if unknown else swarm.velocity, (count, 1)) + np.zeros((count, 2))
    if unknown:
        velocity += center / (T * dt) + noise * rng.normal(size=(count, 2))
    positions = [np.zeros((count, 2))]
    for t, limit in enumerate(limits):
        wanted = (center - positions[-1]) / ((T - t) * dt)
        change = wanted + noise * rng.normal(size=(count, 2)) - velocity
        if t == 0 and unknown:
            change[:] = 0
        length = np.hypot(*change.T)[:, None]
        velocity = velocity + change * np.minimum(1, limit / np.maximum(length, 1e-300))
        velocity = np.clip(velocity, -swarm.v_max, swarm.v_max)
        positions.append(positions[-1] + dt * velocity)
    paths = np.stack(positions, axis=1)
    return paths[scenario.target.contains(paths[:, -1])]


def risks(scenario: Scenario, paths: Array) -> Array:
    """Risks (m,) of paths, to their ends."""
    rates = scenario.hazard.single_agent_rates(paths[:, 1:])
    return np.asarray(scenario.time.dt * rates.sum(axis=1))
