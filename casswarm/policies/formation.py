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
from ..optimization.solution import BatchSolution
from ..optimization.solvers import Solver
from ..planning.guide import Guide
from ..problems.formation import Formation, Motion, Step, corridor_formation, leader_formation
from ..typing import Booleans, Floats
from .base import Decision, Policy
from .leader_selection import SUCCESSIONS

LOG = logging.getLogger(__name__)

HONEST = 1e-3
"""Stationarity, in `Instances.units`, above which an answer counts as failed whatever its solver
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

    def decide(self, step: int, positions: Floats, previous: Floats, alive: Booleans) -> Decision:
        """Solve the formation problem of every state; see `Policy.decide`."""
        goal = self.guide.reference(step + 1)
        data = Step(self.hazard, self.motion, positions, previous, alive, goal)
        formation = self._formation(data, self.guide.reference(step))
        return solved(formation, self.solver)

    @abstractmethod
    def _formation(self, data: Step, place: Floats) -> Formation:
        """The problems of a step; `place` (2,) is the guide's present point X*(t)."""


@dataclass(frozen=True, eq=False)
class LeaderPolicy(FormationPolicy):
    """Planned leader trajectory with protectors, the paper's section IV.B.1.

    Parameters
    ----------
    succession : str
        Who leads: a rule of `SUCCESSIONS`; by default the living member nearest to the guide.
    """

    succession: str = "nearest"
    name: str = "leader"

    def leaders(
        self, step: int, positions: Floats, previous: Floats, alive: Booleans
    ) -> NDArray[np.integer[Any]]:
        """Who leads in every state, (B,), by the rule of succession."""
        goal, place = self.guide.reference(step + 1), self.guide.reference(step)
        data = Step(self.hazard, self.motion, positions, previous, alive, goal)
        return SUCCESSIONS[self.succession](data, place)

    def _formation(self, data: Step, place: Floats) -> Formation:
        return leader_formation(data, SUCCESSIONS[self.succession](data, place))


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

    def _formation(self, data: Step, place: Floats) -> Formation:  # noqa: ARG002
        return corridor_formation(data, self.rho)


def solved(formation: Formation, solver: Solver) -> Decision:
    """The decision in a batch of formation problems.

    Answers are projected onto the sets, so the physical limits hold exactly. A failed solve keeps
    its answer, made feasible; where there is none (not finite, an exception, a crash) the members
    take the velocities that change least. Every failure is counted, and its reason is logged, once
    for every solver and reason.
    """
    velocities = formation.instances.lower.reshape(*formation.free.shape, 2).copy()
    failures, resolved = np.zeros((2, len(velocities)), np.int64)
    open_ = np.flatnonzero(formation.free.any(axis=1))
    if open_.size:
        instances = formation.instances[open_]
        assert instances.sets is not None
        found = solver.solve_batch(formation.nlp, instances)
        usable = np.asarray(np.isfinite(found.x).all(axis=1, keepdims=True))
        points = np.where(usable, found.x, 0.0).reshape(*instances.sets.shape, 2)
        velocities[open_] = np.where(
            usable[..., None], instances.sets.project(points), formation.fallback[open_]
        )
        good = np.asarray(found.success & (found.stationarity <= HONEST))
        failures[open_], resolved[open_] = ~good, found.resolved
        tell_failures(solver.name, formation.nlp.name, found, good)
    return Decision(velocities, formation.shortfalls.sum(axis=1), failures, resolved)


def tell_failures(solver: str, problem: str, found: BatchSolution, good: Booleans) -> None:
    """Log why answers are not good, once for every solver, problem and reason."""
    for row in np.flatnonzero(~good):
        words = "not solved" if found.words is None else str(found.words[row])
        _tell_once(solver, problem, words + (", but not stationary" if found.success[row] else ""))


@lru_cache(maxsize=1024)
def _tell_once(solver: str, problem: str, reason: str) -> None:
    LOG.warning("%s failed on %s, which is counted: %s", solver, problem, reason)
