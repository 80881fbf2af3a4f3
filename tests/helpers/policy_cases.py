"""Policies of all kinds, each with a scenario, its guide, and states around it."""

from __future__ import annotations

from functools import cache

import numpy as np
from parametric_cases import START, steering
from small_scenarios import small, three_members

import casswarm as csw
from casswarm.policies import Observation, Policy

MEMBERS = [(0.0, 0.0), (0.4, -0.3), (-0.3, 0.35), (0.1, 0.6)]


@cache
def scenario(name: str = "leader") -> csw.Scenario:
    """Four members and a radar near the straight line, or what a policy is for."""
    if name == "optimal":
        starts, radars = [(0.0, 0.0), (0.3, 0.2)], [(1.2, 0.4), (1.6, -0.9)]
        return small(starts, (2.2, 0.0), radars, 6, hazard__alpha_1=8.0)
    if name in ("parametric", "model"):
        return three_members(swarm__velocity=[1.0, 0.2])
    return small(MEMBERS, (4.0, 1.5), [(2.0, 0.2)], 14, guide__search="local", guide__a_max=0.3)


@cache
def planned(scenario: csw.Scenario) -> csw.Guide:
    return csw.plan(scenario, certify=False)


def guide(name: str = "leader") -> csw.Guide:
    return planned(scenario(name))


class Model:
    """Towards the target, and towards the first neighbour, as the observation shows them."""

    def __init__(self, observation: Observation) -> None:
        self.target, others = observation.slices["position"], observation.slices["others"]
        self.neighbour = slice(others.start + 1, others.start + 3)

    def __call__(self, observations):
        return -1.6 * observations[..., self.target] + 2.0 * observations[..., self.neighbour]


@cache
def policy(name: str, **options) -> Policy:
    """Policy of a name, with options of `make_policy`; "naive, ipopt" is solved by Ipopt."""
    of = scenario(name)
    if name == "parametric":
        return csw.ParametricPolicy(steering, np.append(START, np.zeros(14)), of)
    if name == "model":
        return csw.as_policy(Model(Observation.from_scenario(of)), of, name="model")
    named, _, solver = name.partition(", ")
    return csw.make_policy(named, of, guide(name), **{"solver": solver or "auto"} | options)


def states(name: str, batch: int, seed: int, step: int = 2):
    """States around the guide at a step, with zero entries of the destroyed."""
    path, n, rng = guide(name), scenario(name).n, np.random.default_rng(seed)
    alive = rng.random((batch, n)) < 0.7
    alive[:, 0] |= ~alive.any(axis=1)
    positions = path.positions[step] + rng.normal(0, 0.15, (batch, n, 2))
    previous_velocities = path.velocities[step - 1] + rng.normal(0, 0.2, (batch, n, 2))
    living = alive[..., None]
    return positions * living, np.clip(previous_velocities, -2, 2) * living, alive
