"""The paper's two formation policies: leader protection and constrained trajectory."""

from __future__ import annotations

import logging
from abc import abstractmethod
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..hazard import Hazard
from ..optimization.feasible_sets.planar import PlanarSets
from ..optimization.solution import BatchSolution
from ..optimization.solvers import Solver
from ..planning.guide import Guide
from ..problems.formation import Formation, Motion, Step, corridor_formation, leader_formation
from ..typing import BoolArray, FloatArray
from .base import Decision, Policy
from .leader_selection import LEADER_SELECTION

LOG = logging.getLogger(__name__)

HONEST = 1e-3
"""Stationarity, in `Instances.scale`, above which an answer counts as failed whatever its solver
says of it: loose, for what a solver calls solved is its own tolerance."""


@dataclass(frozen=True, eq=False)
class FormationPolicy(Policy):
    """Base of the policies that solve a formation problem at every step along a guide.

    Parameters
    ----------
    hazard : Hazard
    motion : Motion
    guide : Guide
    solver : Solver
    """

    hazard: Hazard
    motion: Motion
    guide: Guide
    solver: Solver

    def decide(
        self, step: int, positions: FloatArray, previous_velocities: FloatArray, alive: BoolArray
    ) -> Decision:
        """Solve the formation problem of every state; see `Policy.decide`."""
        goal = self.guide.reference(step + 1)
        data = Step(self.hazard, self.motion, positions, previous_velocities, alive, goal)
        formation = self._formation(data, self.guide.reference(step))
        return solved(formation, self.solver)

    @abstractmethod
    def _formation(self, data: Step, place: FloatArray) -> Formation:
        """The problems of a step; `place` (2,) is the guide's present point X*(t)."""


@dataclass(frozen=True, eq=False)
class LeaderPolicy(FormationPolicy):
    """Planned leader trajectory with protectors, the paper's section IV.B.1.

    Parameters
    ----------
    leader_selection : str
        Who leads: a rule of `LEADER_SELECTION`; by default the living member nearest to the guide.
    """

    leader_selection: str = "nearest"
    name: str = "leader"

    def leaders(
        self, step: int, positions: FloatArray, previous_velocities: FloatArray, alive: BoolArray
    ) -> NDArray[np.integer[Any]]:
        """Who leads in every state, (B,), by the rule of succession."""
        goal, place = self.guide.reference(step + 1), self.guide.reference(step)
        data = Step(self.hazard, self.motion, positions, previous_velocities, alive, goal)
        return LEADER_SELECTION[self.leader_selection](data, place)

    def _formation(self, data: Step, place: FloatArray) -> Formation:
        return leader_formation(data, LEADER_SELECTION[self.leader_selection](data, place))


@dataclass(frozen=True, eq=False)
class ConstrainedPolicy(FormationPolicy):
    """Constrained trajectory, the paper's section IV.B.2.

    Parameters
    ----------
    rho : float
        Bound on the squared distance of every member to the guide.
    """

    rho: float = 0.05
    name: str = "constrained"

    def _formation(self, data: Step, place: FloatArray) -> Formation:  # noqa: ARG002
        return corridor_formation(data, self.rho)


def solved(formation: Formation, solver: Solver) -> Decision:
    """The decision in a batch of formation problems.

    Answers are projected onto the sets, so the physical limits hold exactly. A failed solve keeps
    its answer, made feasible; where there is none (not finite, an exception, a crash) the members
    take the velocities that change least. Every failure is counted, and its reason is logged, once
    for every solver and reason.
    """
    velocities = formation.instances.lbx.reshape(*formation.free.shape, 2).copy()
    failures, fallbacks = np.zeros((2, len(velocities)), np.int64)
    open_ = np.flatnonzero(formation.free.any(axis=1))
    if open_.size:
        instances = formation.instances[open_]
        sets = instances.feasible_set
        assert isinstance(sets, PlanarSets)
        found = solver.solve_batch(formation.nlp, instances)
        usable = np.asarray(np.isfinite(found.x).all(axis=1, keepdims=True))
        points = np.where(usable, found.x, 0.0).reshape(*sets.shape, 2)
        velocities[open_] = np.where(
            usable[..., None], sets.project(points), formation.fallback[open_]
        )
        good = np.asarray(found.success & (found.stationarity <= HONEST))
        failures[open_], fallbacks[open_] = ~good, found.used_fallback
        log_failures(solver.name, formation.nlp.name, found, good)
    return Decision(velocities, formation.infeasible.sum(axis=1), failures, fallbacks)


def log_failures(solver: str, problem: str, found: BatchSolution, good: BoolArray) -> None:
    """Log why answers are not good, once for every solver, problem and reason."""
    for row in np.flatnonzero(~good):
        words = "not solved" if found.messages is None else str(found.messages[row])
        _log_once(solver, problem, words + (", but not stationary" if found.success[row] else ""))


@lru_cache(maxsize=1024)
def _log_once(solver: str, problem: str, reason: str) -> None:
    LOG.warning("%s failed on %s, which is counted: %s", solver, problem, reason)
