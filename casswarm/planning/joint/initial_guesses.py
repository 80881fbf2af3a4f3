"""Initial guesses of joint plans: formations along a single agent's paths, and members' guides."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
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
from .distribution import MAX_EXACT

if TYPE_CHECKING:
    from ...scenario import Scenario

INITIAL_GUESSES = ("formations", "own", "perturbed")
"""Kinds of initial guesses: formations, members' own guides, perturbations of the best plan."""

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


def initial_guesses(
    scenario: Scenario, task: JointTask, kinds: Sequence[str]
) -> Iterator[InitialGuess]:
    """Guesses of some of `INITIAL_GUESSES`; formations where members' own guides do not apply.

    Formations follow each homotopy class, and one is divided between two.
    """
    values = {
        "guide.arrival": "any",
        "guide.acceleration_limited": True,
        "guide.margin": 1e-3 * scenario.target.radius,  # the joint plan decides on the offsets
    }
    guide = plan_from(
        scenario.with_values(values),
        scenario.guide_start,
        search="global",
        initial_velocity=task.initial_velocities[0],
    )
    classes = guide.best_per_homotopy_class()[:MAX_CLASSES]
    paths = {candidate.homotopy or GRID_PATH: candidate.velocities for candidate in classes}
    if not paths:  # no single agent arrives: straight to the target in all the time available
        line = np.stack([guide.positions[0], task.center])
        velocities = resample(line, scenario.n_steps, task.motion.dt)
        yield _formation(scenario, task, STRAIGHT, [velocities])
        return
    own = "own" in kinds and 1 < scenario.n <= MAX_EXACT
    if "formations" in kinds or not own:
        for name, path in paths.items():
            yield _formation(scenario, task, f"formation {name}", [path])
        if scenario.n > 1 and len(paths) > 1:
            names, divided = list(paths)[:2], list(paths.values())[:2]
            yield _formation(scenario, task, f"divided {', '.join(names)}", divided)
    if own:
        yield _own_guides(scenario, task, guide)


def _formation(
    scenario: Scenario, task: JointTask, name: str, paths: list[FloatArray]
) -> InitialGuess:
    """Members around paths of velocities (T, 2), as close to their offsets as the limits allow.

    With two paths, members are assigned to them alternately.
    """
    steps, dt = max(map(len, paths)), task.motion.dt
    padded = [
        np.pad(integrate(scenario.guide_start, path, dt), [(0, steps - len(path)), (0, 0)], "edge")
        for path in paths
    ]
    assigned = np.arange(scenario.n) % len(paths)
    goals = np.stack(padded, axis=1)[:, assigned]
    goals = goals + _offsets(scenario, padded[0], task.min_distance)
    arrivals = np.array([len(path) for path in paths])[assigned]
    return _tracking(name, task, arrivals, goals[1:])


def _own_guides(scenario: Scenario, task: JointTask, guide: Guide) -> InitialGuess:
    """Every member along a guide of its own."""
    guides = [
        plan_from(scenario, start, search="global", initial_velocity=velocity, near=guide)
        for start, velocity in zip(task.start, task.initial_velocities, strict=True)
    ]
    arrivals = np.array([g.arrival for g in guides])
    goals = np.stack([[g.reference(t + 1) for g in guides] for t in range(arrivals.max())])
    return _tracking("own guides", task, arrivals, goals)


def _tracking(name: str, task: JointTask, arrivals: IntArray, goals: FloatArray) -> InitialGuess:
    """Members that track goals (T, n, 2); arrivals are delayed to the first that v_max allows."""
    reach = np.arange(1, task.steps + 1)[:, None, None] * task.motion.dt * task.motion.v_max
    distance = remaining_distance(task.start, task.center, reach)  # (N, n)
    feasible = distance <= task.radius - task.margin
    earliest = np.where(feasible.any(axis=0), feasible.argmax(axis=0) + 1, 0)
    delayed = np.where(earliest > 0, np.maximum(arrivals, earliest), 0)
    return InitialGuess(name, delayed, track(task, goals))


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
