"""Screening of initial guesses: tracked within the limits, and ranked by their exact cost."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from ..motion.kinematics import integrate, remaining_distance
from ..problems.joint_instances import JointTask
from ..typing import FloatArray, IntArray
from .plan_distribution import MAX_EXACT, prescribed_costs

if TYPE_CHECKING:
    from ..scenario import Scenario

MAX_STATES = 2e7
"""States of plans, 3^n for each step, that are evaluated for a screening."""

REPETITION = 0.5
"""Log-odds by which a guess counts as worse for every better one of its family."""


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


@dataclass(frozen=True, eq=False)
class Family:
    """Alternatives of one initial guess, of which the search takes the best.

    Parameters
    ----------
    name : str
    arrivals : (B, n) int
    goals : (N, B, n, 2)
        Points to track, one per step.
    """

    name: str
    arrivals: IntArray
    goals: FloatArray

    def last(self, k: int) -> int:
        """The last arrival step of an alternative."""
        return int(self.arrivals[k].max())


def screened(
    scenario: Scenario, task: JointTask, objective: str, families: list[Family], count: int
) -> list[InitialGuess]:
    """The `count` best guesses before they are optimised, in order.

    They are judged by the log-odds of their exact cost, plus `REPETITION` for every better guess of
    their family. Swarms that are too large for an exact cost take the first of each family.
    """
    n = scenario.n
    limit = int(MAX_STATES / (task.steps * 3.0**n)) if n <= MAX_EXACT else 0
    size = max(1, limit // len(families))
    guesses: list[InitialGuess] = []
    scores: list[float] = []
    for family in families:
        arrivals = delayed(task, family.arrivals[:size])
        velocities = track(task, family.goals[:, :size])
        costs = np.full(len(arrivals), 0.5)
        if limit:
            positions = tracked_positions(task, velocities).swapaxes(0, 1)
            costs = prescribed_costs(scenario, objective, positions, arrivals)
        with np.errstate(divide="ignore"):
            odds = np.log(costs) - np.log1p(-costs)
        scores += (odds + REPETITION * odds.argsort(kind="stable").argsort()).tolist()
        guesses += [
            InitialGuess(family.name, arrivals[k], velocities[: family.last(k), k])
            for k in range(len(costs))
        ]
    return [guesses[k] for k in np.argsort(scores, kind="stable")[:count].tolist()]


def delayed(task: JointTask, arrivals: IntArray) -> IntArray:
    """Arrival steps (B, n), delayed to the first that v_max allows; 0 if it allows none."""
    reach = np.arange(1, task.steps + 1)[:, None, None] * task.motion.dt * task.motion.v_max
    distance = remaining_distance(task.start, task.center, reach)  # (N, n)
    feasible = distance <= task.radius - task.margin
    earliest = np.where(feasible.any(axis=0), feasible.argmax(axis=0) + 1, 0)
    return np.where(earliest > 0, np.maximum(arrivals, earliest), 0)


def track(task: JointTask, goals: FloatArray) -> FloatArray:
    """Velocities (T, ..., n, 2) that track goals of that shape, within v_max and a_max."""
    motion = task.motion
    shape = goals.shape[1:]
    positions = np.broadcast_to(task.start, shape)
    previous_velocities = np.broadcast_to(task.initial_velocities, shape)
    velocities = np.empty_like(goals)
    for step, goal in enumerate(goals):
        velocities[step] = motion.toward(positions, previous_velocities, goal)
        positions = positions + motion.dt * velocities[step]
        previous_velocities = velocities[step]
    return velocities


def tracked_positions(task: JointTask, velocities: FloatArray) -> FloatArray:
    """Positions (N+1, B, n, 2) of velocities (N, B, n, 2)."""
    start = np.broadcast_to(task.start, velocities.shape[1:])
    return integrate(start, velocities, task.motion.dt)


def padded(path: FloatArray, steps: int) -> FloatArray:
    """A path (T+1, ..., 2) that stays at its end until a step: (steps+1, ..., 2)."""
    return path[np.minimum(np.arange(steps + 1), len(path) - 1)]


def turns(angles: FloatArray) -> FloatArray:
    """Matrices (m, 2, 2) of turns by angles (m,)."""
    rows = [[np.cos(angles), -np.sin(angles)], [np.sin(angles), np.cos(angles)]]
    return np.array(rows).transpose(2, 0, 1)
