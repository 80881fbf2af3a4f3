"""Random scenarios, paths and plans, with which bounds are attacked."""

from __future__ import annotations

import math

import numpy as np
from small_scenarios import DT, MEMBER, V_MAX, Array, Point, free, small

from casswarm import Scenario
from casswarm.joint import PlanDistribution
from casswarm.typing import Interval

# --- one agent


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


# --- swarms


def some_scenario(rng: np.random.Generator, n: int, steps: int, collides: bool) -> Scenario:
    """Members around the origin and a target that the first of them can reach."""
    far = rng.uniform(0.75, 0.9 * steps * DT * V_MAX + 0.3)
    angle = rng.uniform(0, 2 * np.pi)
    target = (float(far * np.cos(angle)), float(far * np.sin(angle)))
    spread = min(0.5, 0.9 * (far - 0.7))  # outside the target, with the first one central
    starts = rng.uniform(-1.0, 1.0, (n, 2)) * spread
    starts -= starts.mean(axis=0) if n > 1 else starts[0]
    starts *= min(1.0, spread / max(1e-9, np.hypot(*starts.T).max()))
    starts[0] *= 0.0
    radars: list[Point] = []
    while len(radars) < int(rng.integers(1, 4)):
        x, y = rng.uniform(-1, 3, 2)
        if np.hypot(*(starts - [x, y]).T).min() > 0.15:
            radars.append((float(x), float(y)))
    values: dict[str, object] = {"swarm__velocity": (0.0, 0.0), "swarm__a_max": 100.0}
    if collides:
        values |= {"hazard__kind": "saturation+collision"}
        values |= {"hazard__beta_1": 0.2, "hazard__beta_2": 6.0}
    positions = [(float(x), float(y)) for x, y in starts]
    return small(positions, target, radars, steps, **values)


def adversary(scenario: Scenario, rng: np.random.Generator) -> Array:
    """Ways (N+1, n, 2) to the target by a random bend, at random distances from one another."""
    steps, n = scenario.n_steps, scenario.n
    goal = np.array(scenario.target.center)
    bend = 0.5 * goal + rng.normal(0, 0.5, 2) * rng.integers(0, 2)
    spread = rng.choice([0.0, 0.02, 0.2, 0.5]) * rng.normal(size=(n, 2))
    path = np.empty((steps + 1, n, 2))
    path[0] = scenario.positions
    for t in range(1, steps + 1):
        goal_at_step = (bend if 2 * t < steps else goal) + spread * (t < steps)
        reach = 0.999999 * DT * V_MAX
        path[t] = path[t - 1] + np.clip(goal_at_step - path[t - 1], -reach, reach)
    return path


def best_success(
    scenario: Scenario, rng: np.random.Generator, plans: int, trials: int = 0
) -> Interval:
    """Exact success of the best of some random plans after random improvements of each."""
    reach, found = 0.9999999 * DT * V_MAX, []
    for _ in range(plans):
        path: Array = adversary(scenario, rng)
        best, scale = PlanDistribution.from_positions(scenario, path).success, 0.3
        for _ in range(trials):
            velocities = np.diff(path, axis=0)
            together = rng.random() < 0.5
            shape = (len(velocities), 1 if together else scenario.n, 1)
            changed = rng.random(shape) < 0.5
            velocities += scale * reach * rng.normal(size=velocities.shape) * changed
            velocities = np.clip(velocities, -reach, reach)
            trial = np.concatenate([path[:1], path[0] + np.cumsum(velocities, axis=0)])
            success = PlanDistribution.from_positions(scenario, trial).success
            if success.low > best.low:
                path, best = trial, success
            else:
                scale = max(0.01, 0.97 * scale)
        found.append(best)
    return max(found)
