"""Initial guesses of joint plans: formations along a single agent's paths, and members' guides."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from scipy.optimize import linear_sum_assignment

from ...problems.joint_instances import JointTask
from ...typing import FloatArray, IntArray
from ..guide import Guide
from ..kinematics import integrate, remaining_distance, resample
from ..multistart import GRID_PATH, STRAIGHT
from ..plan import plan_from

if TYPE_CHECKING:
    from ...scenario import Scenario

INITIAL_GUESSES = ("formations", "own", "perturbed")
"""Kinds of initial guesses: formations, members' own guides, perturbations of the best plan."""

OWN_GUIDES = "own guides"
"""Name of the initial guess with the members' own guides."""

MAX_CLASSES = 3
"""Homotopy classes, in order of risk, along which formations start."""

_SPACINGS = np.concatenate([[0.0], np.geomspace(0.02, 2.0, 41)])
"""Candidate distances of neighbours, in units of the target's radius."""

_AMPLITUDE = 0.1  # of perturbations, in units of v_max
_WAVES = 4
_PERTURBED = ", perturbed"


@dataclass(frozen=True, eq=False)
class InitialGuess:
    """An initial plan.

    Parameters
    ----------
    name : str
    arrivals : (n,) int
        Arrival steps to prescribe, 0 for a member that cannot arrive.
    velocities : (T, n, 2)
    """

    name: str
    arrivals: IntArray
    velocities: FloatArray


def single_agent_guide(scenario: Scenario, initial_velocity: FloatArray) -> Guide:
    """The best guide in any homotopy class and at any arrival step, from V(-1) (2,).

    Its margin is nearly zero, because the joint plan decides on the members' offsets from it.
    """
    values = {
        "guide.arrival": "any",
        "guide.acceleration_limited": True,
        "guide.margin": 1e-3 * scenario.target.radius,
    }
    return plan_from(
        scenario.with_values(values),
        scenario.guide_start,
        search="global",
        initial_velocity=initial_velocity,
    )


def initial_guesses(
    scenario: Scenario, task: JointTask, guide: Guide, own: bool
) -> Iterator[InitialGuess]:
    """Formations along each homotopy class, one divided between two, and members' `own` guides."""
    classes = guide.best_per_homotopy_class()[:MAX_CLASSES]
    if not classes:  # no single agent arrives: straight to the target in all the time available
        line = np.stack([guide.positions[0], task.center])
        velocities = resample(line, scenario.n_steps, task.motion.dt)
        yield _formation(scenario, task, STRAIGHT, [velocities])
        return
    names = [candidate.homotopy or GRID_PATH for candidate in classes]
    paths = [candidate.velocities for candidate in classes]
    for name, path in zip(names, paths, strict=True):
        yield _formation(scenario, task, f"formation {name}", [path])
    if scenario.n > 1 and len(paths) > 1:
        yield _formation(scenario, task, f"divided {names[0]}, {names[1]}", paths[:2])
    if own and scenario.n > 1:
        yield _own_guides(scenario, task, guide)


def _formation(
    scenario: Scenario, task: JointTask, name: str, paths: list[FloatArray]
) -> InitialGuess:
    """Members around paths of velocities (T, 2), as close to their offsets as the limits allow.

    With two paths, members are assigned to them alternately.
    """
    positions = [integrate(scenario.guide_start, path, task.motion.dt) for path in paths]
    steps = max(map(len, paths))
    references = np.stack(
        [
            np.vstack([path, np.repeat(path[-1:], steps + 1 - len(path), axis=0)])
            for path in (positions[i % len(positions)] for i in range(scenario.n))
        ],
        axis=1,
    )
    arrivals = np.array([len(paths[i % len(paths)]) for i in range(scenario.n)])
    goals = references + _offsets(scenario, positions[0], task.min_distance)
    arrivals = _feasible_arrivals(task, arrivals, scenario.n_steps)
    return InitialGuess(name, arrivals, track(task, goals[1:]))


def _own_guides(scenario: Scenario, task: JointTask, guide: Guide) -> InitialGuess:
    """Every member along a guide of its own."""
    guides = [
        plan_from(scenario, start, search="global", initial_velocity=velocity, near=guide)
        for start, velocity in zip(task.start, task.initial_velocities, strict=True)
    ]
    steps = max(g.arrival for g in guides)
    goals = np.stack([[g.reference(t + 1) for g in guides] for t in range(steps)])
    arrivals = np.array([g.arrival for g in guides])
    arrivals = _feasible_arrivals(task, arrivals, scenario.n_steps)
    return InitialGuess(OWN_GUIDES, arrivals, track(task, goals))


def track(task: JointTask, goals: FloatArray) -> FloatArray:
    """Velocities (T, n, 2) that track goals (T, n, 2), one per step, within v_max and a_max."""
    motion = task.motion
    positions, previous_velocities = task.start, task.initial_velocities
    velocities = np.empty_like(goals)
    for step, goal in enumerate(goals):
        velocities[step] = motion.toward(positions, previous_velocities, goal)
        positions = positions + motion.dt * velocities[step]
        previous_velocities = velocities[step]
    return velocities


def perturbed(guess: InitialGuess, task: JointTask, rng: np.random.Generator) -> InitialGuess:
    """The plan with random low-frequency waves added to every member's velocity."""
    steps, n, _ = guess.velocities.shape
    phases = np.linspace(0.0, np.pi, steps)[:, None] * np.arange(_WAVES)
    amplitudes = rng.normal(size=(_WAVES, n, 2)) / np.sqrt(_WAVES)
    waves = np.tensordot(np.cos(phases), amplitudes, axes=1)
    return replace(
        guess,
        name=f"{guess.name.removesuffix(_PERTURBED)}{_PERTURBED}",
        velocities=guess.velocities + _AMPLITUDE * task.motion.v_max * waves,
    )


def _feasible_arrivals(task: JointTask, arrivals: IntArray, horizon: int) -> IntArray:
    """Arrival steps, delayed to the first that v_max allows; 0 if there is none."""
    reach = np.arange(1, horizon + 1)[:, None, None] * task.motion.dt * task.motion.v_max
    distance = remaining_distance(task.start, task.center, reach)  # (N, n)
    feasible = distance <= task.radius - task.margin
    earliest = np.where(feasible.any(axis=0), feasible.argmax(axis=0) + 1, 0)
    return np.where(earliest > 0, np.maximum(arrivals, earliest), 0)


def _offsets(scenario: Scenario, path: FloatArray, min_distance: float) -> FloatArray:
    """Members' offsets (n, 2) from a path's point.

    They form a triangular lattice, with the spacing of least total rate where the path is most
    dangerous. Members are assigned to lattice points by least total squared distance.
    """
    if scenario.n == 1:
        return np.zeros((1, 2))
    lattice = _lattice(scenario.n)
    hazard = scenario.hazard
    worst = path[1 + int(hazard.single_agent_rates(path[1:]).argmax())]
    spacings = np.maximum(_SPACINGS * scenario.target.radius, 1.05 * min_distance)
    totals = hazard.rates(worst + spacings[:, None, None] * lattice).sum(axis=1)
    offsets = spacings[int(totals.argmin())] * lattice
    centered = scenario.positions - scenario.positions.mean(axis=0)
    costs = ((centered[:, None] - offsets[None]) ** 2).sum(axis=-1)
    return np.asarray(offsets[linear_sum_assignment(costs)[1]])


def _lattice(n: int) -> FloatArray:
    """The n points of a triangular lattice of spacing 1 that are nearest to their centroid."""
    size = int(np.ceil(np.sqrt(n))) + 2
    i, j = np.meshgrid(*[np.arange(-size, size + 1)] * 2, indexing="ij")
    points = np.stack([i + 0.5 * j, np.sqrt(0.75) * j], axis=-1).reshape(-1, 2)
    centered = points - (np.array([0.5, np.sqrt(0.75) / 3]) if n in (2, 3, 6) else 0.0)
    chosen = centered[np.argsort(np.round((centered**2).sum(axis=1), 9), kind="stable")[:n]]
    return np.asarray(chosen - chosen.mean(axis=0))
