"""Formations with look-ahead: the problem of the next H steps, of which the first is flown."""

from __future__ import annotations

from abc import abstractmethod
from dataclasses import dataclass

import numpy as np

from ..optimization.solvers import Solver
from ..problems.formation import Step
from ..problems.mpc_formation import LookAhead, Window
from ..typing import Booleans, Floats
from .base import Decision
from .formation import HONEST, ConstrainedPolicy, FormationPolicy, LeaderPolicy, tell_failures
from .leader_selection import SUCCESSIONS
from .mpc_instances import corridor_ahead, leader_ahead


@dataclass(frozen=True, eq=False)
class LookAheadPolicy(FormationPolicy):
    """Base of the policies that look ahead.

    Parameters
    ----------
    look_ahead : int
        Steps H of the window, from 1; with 1, the policy is the one-step policy. The window ends
        with the guide, so towards its end policies look less far ahead.
    """

    look_ahead: int = 1

    def decide(self, step: int, positions: Floats, previous: Floats, alive: Booleans) -> Decision:
        """Solve the look-ahead problem of every state; see `Policy.decide`."""
        steps = min(self.look_ahead, self.guide.arrival - step)
        if steps <= 1:
            return super().decide(step, positions, previous, alive)
        goals = np.stack([self.guide.reference(step + s) for s in range(1, steps + 1)])
        window = Window(self.hazard, self.motion, positions, previous, alive, goals)
        problem = self._problem(window, self.guide.reference(step))
        return flown(window, problem, self.solver)

    @abstractmethod
    def _problem(self, window: Window, place: Floats) -> LookAhead:
        """The problems of a window; `place` (2,) is the guide's present point X*(t)."""


@dataclass(frozen=True, eq=False)
class LeaderAheadPolicy(LookAheadPolicy, LeaderPolicy):
    """Leader protection with look-ahead: the leader's path first, then the others' around it."""

    def _problem(self, window: Window, place: Floats) -> LookAhead:
        now = Step(
            window.hazard,
            window.motion,
            window.positions,
            window.previous,
            window.alive,
            window.goals[0],
        )
        return leader_ahead(window, SUCCESSIONS[self.succession](now, place))


@dataclass(frozen=True, eq=False)
class ConstrainedAheadPolicy(LookAheadPolicy, ConstrainedPolicy):
    """Constrained trajectory with look-ahead: corridors of all steps, as far as they can be met."""

    def _problem(self, window: Window, place: Floats) -> LookAhead:  # noqa: ARG002
        return corridor_ahead(window, self.rho)


def flown(window: Window, problem: LookAhead, solver: Solver) -> Decision:
    """The decision in a batch of look-ahead problems: the first velocities of their paths.

    These are projected onto what the next step allows, so that the physical limits hold exactly. A
    failed solve keeps its answer, made feasible; where there is none the members slow down, which
    is always allowed. Every failure is counted, and its reason is logged once.
    """
    shape = problem.free.shape
    steps, members = window.steps, shape[1]
    velocities = problem.fallback.copy()
    failures, resolved = problem.failures.copy(), np.zeros(shape[0], np.int64)
    open_ = np.flatnonzero(problem.free.any(axis=1))
    if open_.size:
        found = solver.solve_batch(problem.nlp, problem.instances[open_])
        usable = np.asarray(np.isfinite(found.x).all(axis=1))[:, None, None]
        advances = found.x.reshape(open_.size, steps, members, 2)[:, 0]
        velocities[open_] = np.where(usable, advances, velocities[open_])
        good = np.asarray(found.success & (found.stationarity <= HONEST))
        failures[open_] |= ~good
        resolved[open_] = found.resolved
        tell_failures(solver.name, problem.nlp.name, found, good)
    velocities = problem.first.project(velocities)
    shortfalls = problem.shortfalls(window, velocities)
    return Decision(velocities, shortfalls.sum(axis=1), failures, resolved)
