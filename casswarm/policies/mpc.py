"""Formations with look-ahead: the problem of the next H steps, of which the first is flown."""

from __future__ import annotations

from abc import abstractmethod
from dataclasses import dataclass

import numpy as np

from ..optimization.solvers import Solver
from ..problems.formation import Step
from ..problems.mpc_formation import MpcFormation, Window
from ..typing import BoolArray, FloatArray
from .base import Decision
from .formation import HONEST, ConstrainedPolicy, FormationPolicy, LeaderPolicy, log_failures
from .leader_selection import LEADER_SELECTION
from .mpc_instances import constrained_mpc, leader_mpc


@dataclass(frozen=True, eq=False)
class MpcPolicy(FormationPolicy):
    """Base of the policies that look ahead.

    Parameters
    ----------
    horizon : int
        Steps H of the window, from 1; with 1, the policy is the one-step policy. The window ends
        with the guide, so towards its end policies look less far ahead.
    """

    horizon: int = 1

    def decide(
        self, step: int, positions: FloatArray, previous_velocities: FloatArray, alive: BoolArray
    ) -> Decision:
        """Solve the look-ahead problem of every state; see `Policy.decide`."""
        steps = min(self.horizon, self.guide.arrival - step)
        if steps <= 1:
            return super().decide(step, positions, previous_velocities, alive)
        goals = np.stack([self.guide.reference(step + s) for s in range(1, steps + 1)])
        window = Window(self.hazard, self.motion, positions, previous_velocities, alive, goals)
        problem = self._problem(window, self.guide.reference(step))
        return flown(window, problem, self.solver)

    @abstractmethod
    def _problem(self, window: Window, place: FloatArray) -> MpcFormation:
        """The problems of a window; `place` (2,) is the guide's present point X*(t)."""


@dataclass(frozen=True, eq=False)
class LeaderMpcPolicy(MpcPolicy, LeaderPolicy):
    """Leader protection with look-ahead: the leader's path first, then the others' around it."""

    def _problem(self, window: Window, place: FloatArray) -> MpcFormation:
        now = Step(
            window.hazard,
            window.motion,
            window.positions,
            window.previous_velocities,
            window.alive,
            window.goals[0],
        )
        return leader_mpc(window, LEADER_SELECTION[self.leader_selection](now, place))


@dataclass(frozen=True, eq=False)
class ConstrainedMpcPolicy(MpcPolicy, ConstrainedPolicy):
    """Constrained trajectory with look-ahead: corridors of all steps, as far as they can be met."""

    def _problem(self, window: Window, place: FloatArray) -> MpcFormation:  # noqa: ARG002
        return constrained_mpc(window, self.rho)


def flown(window: Window, problem: MpcFormation, solver: Solver) -> Decision:
    """The decision in a batch of look-ahead problems: the first velocities of their paths.

    These are projected onto what the next step allows, so that the physical limits hold exactly. A
    failed solve keeps its answer, made feasible; where there is none the members slow down, which
    is always allowed. Every failure is counted, and its reason is logged once.
    """
    shape = problem.free.shape
    steps, members = window.steps, shape[1]
    velocities = problem.fallback.copy()
    failures, fallbacks = problem.failures.copy(), np.zeros(shape[0], np.int64)
    open_ = np.flatnonzero(problem.free.any(axis=1))
    if open_.size:
        found = solver.solve_batch(problem.nlp, problem.instances[open_])
        usable = np.asarray(np.isfinite(found.x).all(axis=1))[:, None, None]
        advances = found.x.reshape(open_.size, steps, members, 2)[:, 0]
        velocities[open_] = np.where(usable, advances, velocities[open_])
        good = np.asarray(found.success & (found.stationarity <= HONEST))
        failures[open_] |= ~good
        fallbacks[open_] = found.used_fallback
        log_failures(solver.name, problem.nlp.name, found, good)
    velocities = problem.first.project(velocities)
    infeasible = problem.infeasible(window, velocities)
    return Decision(velocities, infeasible.sum(axis=1), failures, fallbacks)
