"""Where joint plans start from: the ways of a lone agent, flown by all members in formation."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from scipy.optimize import linear_sum_assignment

from ...problems.formation import Motion
from ...problems.joint_instances import JointTask
from ...typing import FloatArray, IntArray
from ..guide import Guide, integrate
from ..plan import plan_from
from ..polyline import resampled

if TYPE_CHECKING:
    from ...scenario import Scenario

WAYS = 3
"""Ways around the radars, best first, that formations start along."""

_SPACINGS = np.concatenate([[0.0], np.geomspace(0.02, 2.0, 41)])
"""Distances of neighbours that are tried, in units of the target's radius."""

_NOISE = 0.1  # of v_max: perturbations, as slow waves
_WAVES = 4
_PERTURBED = ", perturbed"


@dataclass(frozen=True, eq=False)
class SwarmStart:
    """An initial plan.

    Parameters
    ----------
    origin : str
    arrivals : (n,) int
        Arrival steps to ask for, 0 for a member that cannot arrive.
    velocities : (T, n, 2)
    """

    origin: str
    arrivals: IntArray
    velocities: FloatArray


def single_agent_guide(scenario: Scenario, before: FloatArray) -> Guide:
    """The best guide of a lone agent among all ways and arrival steps, from V(-1) `before` (2,).

    The rim is arrival enough: the members' places in the formation are up to the joint plan.
    """
    free = {
        "guide.arrival": "any",
        "guide.acceleration_limited": True,
        "guide.margin": 1e-3 * scenario.target.radius,
    }
    return plan_from(
        scenario.with_values(free), scenario.guide_start, search="global", before=before
    )


def initial_plans(
    scenario: Scenario, task: JointTask, guide: Guide, own: bool
) -> Iterator[SwarmStart]:
    """Formations along each way, one that divides between two, and members' `own` guides."""
    ways = guide.ways()[:WAYS]
    if not ways:  # no way of a lone agent arrives: straight there, in all the time there is
        line = np.stack([guide.positions[0], task.center])
        yield _formation(scenario, task, "straight", [resampled(line, scenario.n_steps, task.dt)])
        return
    names = [way.sides or "way" for way in ways]
    for name, way in zip(names, ways, strict=True):
        yield _formation(scenario, task, f"formation {name}", [way.velocities])
    if scenario.n > 1 and len(ways) > 1:
        pair = [way.velocities for way in ways[:2]]
        yield _formation(scenario, task, f"divided {names[0]}, {names[1]}", pair)
    if own and scenario.n > 1:
        yield _apart(scenario, task, guide)


def _formation(
    scenario: Scenario, task: JointTask, origin: str, ways: list[FloatArray]
) -> SwarmStart:
    """Members around paths of velocities (T, 2), as near to their places as the limits allow.

    With two ways, members take turns.
    """
    paths = [integrate(scenario.guide_start, velocities, task.dt) for velocities in ways]
    steps = max(map(len, ways))
    references = np.stack(
        [
            np.vstack([path, np.repeat(path[-1:], steps + 1 - len(path), axis=0)])
            for path in (paths[i % len(paths)] for i in range(scenario.n))
        ],
        axis=1,
    )
    asked = np.array([len(ways[i % len(ways)]) for i in range(scenario.n)])
    places = _places(scenario, paths[0], task.distance)
    goals = references + places
    return SwarmStart(origin, _possible(task, asked, scenario.n_steps), follow(task, goals[1:]))


def _apart(scenario: Scenario, task: JointTask, guide: Guide) -> SwarmStart:
    """Every member along a guide of its own."""
    guides = [
        plan_from(scenario, start, search="global", before=before, near=guide)
        for start, before in zip(task.start, task.before, strict=True)
    ]
    steps = max(g.arrival for g in guides)
    goals = np.stack([[g.reference(t + 1) for g in guides] for t in range(steps)])
    asked = np.array([g.arrival for g in guides])
    return SwarmStart("own guides", _possible(task, asked, scenario.n_steps), follow(task, goals))


def follow(task: JointTask, goals: FloatArray) -> FloatArray:
    """Velocities (T, n, 2) to goals (T, n, 2), one a step, within v_max and a_max."""
    motion = Motion(task.v_max, task.a_max, task.dt)
    places, previous_velocities = task.start, task.before
    found = np.empty_like(goals)
    for step, goal in enumerate(goals):
        found[step] = motion.toward(places, previous_velocities, goal)
        places, previous_velocities = places + task.dt * found[step], found[step]
    return found


def perturbed(start: SwarmStart, task: JointTask, rng: np.random.Generator) -> SwarmStart:
    """The plan with slow random waves in every member's velocity."""
    steps, n, _ = start.velocities.shape
    phases = np.linspace(0.0, np.pi, steps)[:, None] * np.arange(_WAVES)
    amplitudes = rng.normal(size=(_WAVES, n, 2)) / np.sqrt(_WAVES)
    waves = np.tensordot(np.cos(phases), amplitudes, axes=1)
    return replace(
        start,
        origin=f"{start.origin.removesuffix(_PERTURBED)}{_PERTURBED}",
        velocities=start.velocities + _NOISE * task.v_max * waves,
    )


def _possible(task: JointTask, asked: IntArray, horizon: int) -> IntArray:
    """Arrival steps asked for, later where v_max does not allow them, 0 where no step does."""
    reach = np.arange(1, horizon + 1)[:, None, None] * task.dt * task.v_max
    missing = np.maximum(np.abs(task.center - task.start) - reach, 0.0)  # (N, n, 2)
    within = np.hypot(missing[..., 0], missing[..., 1]) <= task.radius - task.margin
    earliest = np.where(within.any(axis=0), within.argmax(axis=0) + 1, 0)
    return np.where(earliest > 0, np.maximum(asked, earliest), 0)


def _places(scenario: Scenario, path: FloatArray, least: float) -> FloatArray:
    """Members' places (n, 2) around a path's point.

    A triangular lattice of the spacing at which the rates add up to least where the path is most
    dangerous; of members and places those are matched that are nearest to one another.
    """
    if scenario.n == 1:
        return np.zeros((1, 2))
    lattice = _lattice(scenario.n)
    hazard = scenario.hazard
    worst = path[1 + int(hazard.single_agent_rates(path[1:]).argmax())]
    spacings = np.maximum(_SPACINGS * scenario.target.radius, 1.05 * least)
    totals = hazard.rates(worst + spacings[:, None, None] * lattice).sum(axis=1)
    places = spacings[int(totals.argmin())] * lattice
    apart = scenario.positions - scenario.positions.mean(axis=0)
    costs = ((apart[:, None] - places[None]) ** 2).sum(axis=-1)
    return np.asarray(places[linear_sum_assignment(costs)[1]])


def _lattice(n: int) -> FloatArray:
    """The n points of a triangular lattice of spacing 1 that are nearest to its centre of mass."""
    size = int(np.ceil(np.sqrt(n))) + 2
    i, j = np.meshgrid(*[np.arange(-size, size + 1)] * 2, indexing="ij")
    points = np.stack([i + 0.5 * j, np.sqrt(0.75) * j], axis=-1).reshape(-1, 2)
    around = points - (np.array([0.5, np.sqrt(0.75) / 3]) if n in (2, 3, 6) else 0.0)
    chosen = around[np.argsort(np.round((around**2).sum(axis=1), 9), kind="stable")[:n]]
    return np.asarray(chosen - chosen.mean(axis=0))
