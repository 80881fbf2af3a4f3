"""Policies in environments, and runs of the same in `simulate`."""

from __future__ import annotations

from typing import Any

import numpy as np

import casswarm as csw
from casswarm.envs import SwarmVectorEnv


def outcomes(env: SwarmVectorEnv, policy: csw.Policy, seed: int, episodes: int) -> dict[str, Any]:
    """Success, survivors, length and saturated velocities of the first runs, as in `Study.runs`."""
    size, steps = env.num_envs, env.scenario.n_steps
    total = size * episodes
    keys = ("success", "survivors", "steps", "saturated", "returns")
    table = {key: np.zeros(total) for key in keys}
    done = np.zeros(total, bool)
    env.reset(seed=seed)
    for _ in range((steps + 1) * episodes):
        swarms = env.batch.swarms
        actions = np.zeros_like(swarms.positions)
        for step in np.unique(swarms.steps[~env.batch.ends.ended]):
            rows = (swarms.steps == step) & ~env.batch.ends.ended
            state = swarms.positions[rows], swarms.velocities[rows], env.batch.believed[rows]
            actions[rows] = policy.velocities(int(step), *state)
        before, resets = swarms.runs.astype(int).copy(), env.batch.ends.ended.copy()
        _, rewards, terminated, truncated, infos = env.step(actions)
        assert not truncated.any()
        last = infos.get("final_info", infos)
        counted = ~resets & (before < total)
        runs = before[counted]
        table["steps"][runs] += 1
        now = np.where(terminated & ("final_info" in infos), last["saturated"], infos["saturated"])
        table["saturated"][runs] += now[counted]
        table["returns"][runs] += rewards[counted]
        ended = counted & terminated
        for key in ("success", "survivors"):
            table[key][before[ended]] = last[key][ended]
        done[before[ended]] = True
        if done.all():
            return table
    raise AssertionError("some runs have not ended")
