"""Coarse time steps: a scenario with fewer steps, and initial guesses from its plans."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from ...problems.joint_instances import JointTask
from ...typing import FloatArray
from ..kinematics import integrate
from .plan import SwarmOutcome
from .screening import InitialGuess, padded

if TYPE_CHECKING:
    from ...scenario import Scenario

COARSEST = 15
"""Number of steps of the coarsest search."""

MAX_REFINEMENT = 4
"""Maximum ratio of the numbers of steps of a search and of the coarser one before it."""

SAME = 0.15
"""Distance, in radii of the target, up to which trajectories count as the same."""


def coarsened(scenario: Scenario) -> Scenario | None:
    """The scenario with fewer steps in the same time of flight; None if it has few.

    The change of velocity per unit of time has the same limit.
    """
    steps = max(COARSEST, -(-scenario.n_steps // MAX_REFINEMENT))
    if scenario.n_steps < 2 * steps:
        return None
    ratio = scenario.n_steps / steps
    dt = scenario.time.dt * ratio
    values: dict[str, object] = {
        "time.dt": dt,
        "time.t_f": dt * (steps + 0.5),
        "swarm.a_max": scenario.swarm.a_max * ratio**2,
        "guide.a_max": scenario.guide_a_max * ratio**2,
    }
    return scenario.with_values(values)


def refined(outcome: SwarmOutcome, task: JointTask, coarse_steps: int) -> InitialGuess:
    """A guess for a task from an outcome with fewer steps: its velocities, interpolated in time."""
    ratio = task.steps / coarse_steps
    arrivals = np.ceil(outcome.arrivals * ratio - 1e-9).astype(int)
    velocities = np.concatenate([task.initial_velocities[None], outcome.velocities])
    last = int(arrivals.max()) if arrivals.all() else task.steps
    times = np.minimum((np.arange(last) + 0.5) / ratio + 0.5, len(velocities) - 1)
    before = np.minimum(times.astype(int), len(velocities) - 2)
    share = (times - before)[:, None, None]
    between = (1.0 - share) * velocities[before] + share * velocities[before + 1]
    return InitialGuess(outcome.start, arrivals, between)


def distinct(
    task: JointTask, outcomes: Iterable[SwarmOutcome], known: Iterable[SwarmOutcome] = ()
) -> list[SwarmOutcome]:
    """The outcomes with trajectories that differ from those before them, and from known ones."""
    seen = [_whole(task, outcome.velocities) for outcome in known]
    found = []
    for outcome in outcomes:
        path = _whole(task, outcome.velocities)
        if all(abs(path - other).max() > SAME * task.radius for other in seen):
            seen.append(path)
            found.append(outcome)
    return found


def _whole(task: JointTask, velocities: FloatArray) -> FloatArray:
    """Positions (N+1, n, 2) of members that stop at the end."""
    return padded(integrate(task.start, velocities, task.motion.dt), task.steps)


def coarse_task(task: JointTask, scenario: Scenario) -> JointTask:
    """The task in a scenario with fewer steps."""
    coarse = JointTask.from_scenario(scenario, task.initial_velocities, task.min_distance)
    return replace(coarse, start=task.start)
