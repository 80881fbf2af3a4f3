"""The paper's formation policies, leader protection and constrained trajectory, one or H steps."""

from __future__ import annotations

import logging
from abc import abstractmethod
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, ClassVar, TypeGuard

import numpy as np
from numpy.typing import NDArray

from .._util.kernel_threads import execute
from ..hazard import Hazard
from ..optimization.problem import Instances, Nlp
from ..optimization.solution import BatchSolution
from ..optimization.solvers import Solver
from ..optimization.solvers.auto import Auto
from ..optimization.solvers.base import VIOLATION
from ..optimization.solvers.batch.spg import SpectralProjectedGradient
from ..planning.guide import Guide
from ..problems.formation import Formation, FormationTask, or_none
from ..problems.step import Motion, Step
from ..typing import BoolArray, FloatArray
from .base import Policy
from .decision import SOLVER_TOL, Decision
from .leader_selection import LEADER_SELECTION
from .mpc_instances import corridor_mpc_formation, leader_mpc_formation

LOG = logging.getLogger(__name__)

MAX_STATIONARITY = 1e-3
"""Stationarity, in `Instances.scale`, above which a solution counts as failed, whatever status its
solver reports: loose, because solvers report success by tolerances of their own."""


_PER_THREAD = 1024  # states with a single start that are worth a thread


@dataclass(frozen=True, eq=False)
class FormationPolicy(Policy):
    """Base of the policies that solve a formation problem at every step along a guide.

    With a horizon H > 1 they are receding-horizon (MPC) policies: they solve the problem of the
    next H steps and apply the first. The horizon ends with the guide, so it shrinks towards the
    guide's arrival.

    Parameters
    ----------
    hazard : Hazard
    motion : Motion
    guide : Guide
    solver : Solver
    horizon : int
        Number of steps H, from 1.
    """

    hazard: Hazard
    motion: Motion
    guide: Guide
    solver: Solver
    horizon: int = 1
    decision_tol: ClassVar[float] = SOLVER_TOL

    def decide_batch(
        self, step: int, positions: FloatArray, previous_velocities: FloatArray, alive: BoolArray
    ) -> Decision:
        """Solve the formation problem of every state; see `Policy.decide_batch`."""
        data = self._data(step, positions, previous_velocities, alive)
        if data.horizon > 1:
            formation = self._mpc_formation(data, self.guide.reference(step))
            return applied_decision(data, formation, self.solver)
        return formation_decision(self._task(data, self.guide.reference(step)), self.solver)

    def _data(
        self, step: int, positions: FloatArray, previous_velocities: FloatArray, alive: BoolArray
    ) -> Step:
        horizon = max(1, min(self.horizon, self.guide.arrival - step))
        goals = np.array([self.guide.reference(step + s) for s in range(1, horizon + 1)])
        return Step(self.hazard, self.motion, positions, previous_velocities, alive, goals)

    @abstractmethod
    def _task(self, data: Step, reference: FloatArray) -> FormationTask:
        """Problems of a single step; `reference` (2,) is the guide's present point X*(t)."""

    @abstractmethod
    def _mpc_formation(self, data: Step, reference: FloatArray) -> Formation:
        """Problems of several steps."""


@dataclass(frozen=True, eq=False)
class LeaderPolicy(FormationPolicy):
    """Planned leader trajectory with protectors, the paper's section IV.B.1.

    Over a horizon, the leader's path is planned first, and the others' around it.

    Parameters
    ----------
    leader_selection : str
        Rule of `LEADER_SELECTION`; by default the living member nearest to the guide leads.
    """

    leader_selection: str = "nearest"
    name: str = "leader"

    def leaders(
        self, step: int, positions: FloatArray, previous_velocities: FloatArray, alive: BoolArray
    ) -> NDArray[np.integer[Any]]:
        """Index (B,) of the leader in every state."""
        data = self._data(step, positions, previous_velocities, alive)
        return LEADER_SELECTION[self.leader_selection](data, self.guide.reference(step))

    def _task(self, data: Step, reference: FloatArray) -> FormationTask:
        return FormationTask(data, LEADER_SELECTION[self.leader_selection](data, reference))

    def _mpc_formation(self, data: Step, reference: FloatArray) -> Formation:
        leaders = LEADER_SELECTION[self.leader_selection](data, reference)
        return leader_mpc_formation(data, leaders)


@dataclass(frozen=True, eq=False)
class ConstrainedPolicy(FormationPolicy):
    """Constrained trajectory, the paper's section IV.B.2.

    Over a horizon, the corridors of all steps hold as far as they can be met.

    Parameters
    ----------
    rho : float
        Bound on the squared distance of every member to the guide.
    """

    rho: float = 0.05
    name: str = "constrained"

    def _task(self, data: Step, reference: FloatArray) -> FormationTask:  # noqa: ARG002
        return FormationTask(data, or_none(None, len(data.alive)), self.rho)

    def _mpc_formation(self, data: Step, reference: FloatArray) -> Formation:  # noqa: ARG002
        return corridor_mpc_formation(data, self.rho)


def formation_decision(task: FormationTask, solver: Solver) -> Decision:
    """Decide by the formation problems of one step.

    The default solver's batch method does so in one pass over the states. Those that it does not
    solve to tolerance, and all states for other solvers, are solved as `applied_decision` does.
    """
    nlp = task.nlp
    compiled = nlp.compiled
    if compiled is None or not _is_default(solver):
        return applied_decision(task.step, task.formation(), solver)
    from .formation_step_kernels import Limits, StepResults, decide_states

    batch, n = task.step.alive.shape
    results = StepResults(
        np.empty((batch, n, 2)),
        np.empty((batch, 3)),
        np.empty(batch, np.int64),
        np.empty(batch, bool),
    )
    limits = Limits(VIOLATION, min(solver.stationarity, MAX_STATIONARITY))
    method = solver.batch.method(nlp.n_starts, n)
    problems = compiled.evaluate, compiled.constants, task.states, task.terms
    arguments = *problems, method, limits, results
    execute(decide_states, batch, arguments, _PER_THREAD // nlp.n_starts)
    failures, fallbacks = np.zeros((2, batch), np.int64)
    if not results.accepted.all():
        left = np.flatnonzero(~results.accepted)
        rest = task[left]
        decision = applied_decision(rest.step, rest.formation(), solver)
        results.velocities[left] = decision.velocities
        results.infeasible[left] = decision.infeasible
        failures[left], fallbacks[left] = decision.failures, decision.fallbacks
    return Decision(results.velocities, results.infeasible, failures, fallbacks)


def _is_default(solver: Solver) -> TypeGuard[Auto]:
    """Whether the solver's methods are those of the pass, not of a subclass."""
    return type(solver) is Auto and type(solver.batch) is SpectralProjectedGradient


def applied_decision(step: Step, formation: Formation, solver: Solver) -> Decision:
    """Solve a batch of formation problems, and decide to apply the velocities of their first step.

    Velocities are projected onto their sets, so the hard constraints hold exactly. The result of a
    failed solve is applied too, once projected; without any (not finite, an exception, a crash) the
    formation's fallback is applied. Every failure is counted, and its reason is logged, once for
    every solver and reason.
    """
    velocities = formation.fallback.copy()
    batch, members = formation.free.shape
    failures, fallbacks = np.zeros((2, batch), np.int64)
    if formation.failures is not None:
        failures |= formation.failures
    rows = np.flatnonzero(formation.free.any(axis=1))
    if rows.size:
        solution = _solutions(formation.nlp, formation.instances[rows], solver)
        finite = np.asarray(np.isfinite(solution.x).all(axis=1))[:, None, None]
        first = solution.x.reshape(rows.size, -1, members, 2)[:, 0]
        velocities[rows] = np.where(finite, first, velocities[rows])
        solved = _solved(solution, solver)
        failures[rows] |= ~solved
        fallbacks[rows] = solution.used_fallback
        for row in np.flatnonzero(~solved):
            reason = str(solution.messages[row]) or "not solved"
            reason += ", but not stationary" if solution.success[row] else ""
            _log_once(solver.name, formation.nlp.name, reason)
    velocities = formation.sets.project(velocities)
    infeasible = formation.infeasible
    if formation.tracked is not None:
        missed = step.motion.misses(step.positions, velocities, step.goal, formation.radius)
        infeasible = infeasible | (formation.tracked & missed)
    return Decision(velocities, infeasible.sum(axis=1), failures, fallbacks)


def _solutions(nlp: Nlp, instances: Instances, solver: Solver) -> BatchSolution:
    """Answers of the solver, which begins at the best minimum that the batch solver finds.

    So all solvers decide alike where there are several local minima. `Auto` itself searches, and a
    method of fixed iterations has a start of its own.
    """
    if nlp.n_starts == 1 or isinstance(solver, Auto) or solver.capabilities.fixed_iterations:
        return solver.solve_batch(nlp, instances)
    located = instances.with_x0(Auto().located(nlp, instances))
    return solver.warm().solve_batch(nlp, located)


def _solved(solution: BatchSolution, solver: Solver) -> BoolArray:
    """Which answers count as solved; of a method with fixed iterations, all feasible iterates."""
    if solver.capabilities.fixed_iterations:
        return np.asarray(solution.violation <= VIOLATION)  # False for NaN
    return np.asarray(solution.success & (solution.stationarity <= MAX_STATIONARITY))


@lru_cache(maxsize=1024)
def _log_once(solver: str, problem: str, reason: str) -> None:
    LOG.warning("%s failed on %s, which is counted: %s", solver, problem, reason)
