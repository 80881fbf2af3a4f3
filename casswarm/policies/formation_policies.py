"""Formation policies: leader protection and constrained trajectory, along a guide or by feedback.

**Feedback.** The paper names a policy for the guide as future work. A fixed guide is an open-loop
path: a swarm that is off it, because its leader was lost or its limits are tighter than the
guide's, spends its effort on returning. Here the next point of the guide is recomputed in every
state, from the value function.

The value function takes only v_max into account, and a swarm that relied on it alone would
repeatedly find itself with a turn to make and no time left for it. So it is evaluated only at the
end of manoeuvres that respect a_max: from the present velocity towards another one, as fast as is
allowed, for three steps more than it takes to stop, at most 24. The best of them determines the
first step, and the next step chooses again.
"""

from __future__ import annotations

import logging
import math
from abc import abstractmethod
from dataclasses import dataclass, field, replace
from functools import lru_cache
from typing import Any, ClassVar, TypeGuard

import numpy as np
from numpy.typing import NDArray
from typing_extensions import override

from ..compiled.parallel import execute
from ..formation.auto import Auto
from ..formation.horizon import corridor_mpc_formation, leader_mpc_formation
from ..formation.objective import formation_objective, start_count
from ..formation.projected_gradient import SpectralProjectedGradient
from ..formation.state_kernels import Limits, StepInputs, StepResults, decide_states
from ..formation.task import FOLLOWER_WEIGHT, LEADER_SELECTION, Formation, FormationTask, or_none
from ..grid import ValueFunction
from ..guide.guide import Guide
from ..hazard import Hazard
from ..motion.step import Motion, Step
from ..nlp.program import Instances, Nlp
from ..nlp.solution import BatchSolution
from ..solvers import Solver
from ..solvers.base import VIOLATION
from ..typing import BoolArray, FloatArray
from .base import SOLVER_TOL, Decision, Policy
from .waiting import waiting_goals

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
        Of the formation problems.
    horizon : int
        Number of steps H, from 1.
    max_wait : int
        Number of steps by which the guide waits at most for the member that it leads; see
        `casswarm.policies.waiting`.
    counts : (n,) bool, optional
        Members that may lead; all by default.
    """

    hazard: Hazard
    motion: Motion
    guide: Guide
    solver: Solver
    horizon: int = 1
    max_wait: int = field(default=0, kw_only=True)
    counts: BoolArray | None = field(default=None, kw_only=True)
    decision_tol: ClassVar[float] = SOLVER_TOL

    @override
    def decide_batch(
        self, step: int, positions: FloatArray, previous_velocities: FloatArray, alive: BoolArray
    ) -> Decision:
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
        hazard, *later = (self.hazard.after(step + s) for s in range(1, horizon + 1))
        after = tuple(later) if self.hazard.changes else ()
        state = positions, previous_velocities, alive
        data = Step(hazard, self.motion, *state, goals, after, self.counts)
        if self.max_wait == 0:
            return data
        members, bounds = self._led(data, self.guide.reference(step)), self.motion.bounds
        led, speeds = positions[np.arange(len(alive)), members], bounds[members % len(bounds), 0]
        goals = waiting_goals(self.guide, speeds, step, led, self.max_wait, horizon)
        return replace(data, goals=goals)

    def _led(self, data: Step, reference: FloatArray) -> NDArray[np.intp]:
        """Indices (B,) of the members for which the guide waits."""
        return LEADER_SELECTION["nearest"](data, reference)

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
    follower_weight : float
        Weight of the followers' rates, where distances alone do not determine the formation.
    """

    leader_selection: str = "nearest"
    name: str = "leader"
    follower_weight: float = FOLLOWER_WEIGHT

    @override
    def leaders(
        self, step: int, positions: FloatArray, previous_velocities: FloatArray, alive: BoolArray
    ) -> NDArray[np.integer[Any]]:
        data = self._data(step, positions, previous_velocities, alive)
        return self._led(data, self.guide.reference(step))

    @override
    def _led(self, data: Step, reference: FloatArray) -> NDArray[np.intp]:
        return LEADER_SELECTION[self.leader_selection](data, reference)

    def _task(self, data: Step, reference: FloatArray) -> FormationTask:
        leaders = self._led(data, reference)
        return FormationTask(data, leaders, follower_weight=self.follower_weight)

    def _mpc_formation(self, data: Step, reference: FloatArray) -> Formation:
        leaders = self._led(data, reference)
        return leader_mpc_formation(data, leaders, self.follower_weight)


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
    batch, n = task.step.alive.shape
    compiled = formation_objective(task.step.hazard, n, task.rho is not None)
    if compiled is None or not _is_default(solver):
        return applied_decision(task.step, task.formation(), solver)
    results = StepResults(
        np.empty((batch, n, 2)),
        np.empty((batch, 3)),
        np.empty(batch, np.int64),
        np.empty(batch, bool),
    )
    limits = Limits(VIOLATION, min(solver.stationarity, MAX_STATIONARITY))
    starts = compiled.starts
    method = solver.batch.method(starts, n)
    inputs = StepInputs(task.states, task.terms, limits)
    arguments = *compiled.kernels, inputs, method, results
    execute(decide_states, batch, arguments, _PER_THREAD // starts)
    failures, fallbacks = np.zeros(batch, np.int64), np.zeros(batch, np.int64)
    if np.count_nonzero(results.accepted) < batch:
        left = np.flatnonzero(~results.accepted)
        rest = task[left]
        decision = applied_decision(rest.step, rest.formation(), solver)
        results.velocities[left] = decision.velocities
        results.infeasible[left] = decision.infeasible
        failures[left], fallbacks[left] = decision.failures, decision.fallbacks
    return Decision(results.velocities, results.infeasible, failures, fallbacks)


def _is_default(solver: Solver) -> TypeGuard[Auto]:
    """Return True if the solver's methods are those of the pass, not of a subclass."""
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
    if start_count(nlp) == 1 or isinstance(solver, Auto) or solver.capabilities.fixed_iterations:
        return solver.solve_batch(nlp, instances)
    located = instances.with_x0(Auto().located(nlp, instances))
    return solver.warm().solve_batch(nlp, located)


def _solved(solution: BatchSolution, solver: Solver) -> BoolArray:
    """Mask of solved answers; of a method with fixed iterations, all feasible iterates."""
    if solver.capabilities.fixed_iterations:
        return np.asarray(solution.violation <= VIOLATION)  # False for NaN
    return np.asarray(solution.success & (solution.stationarity <= MAX_STATIONARITY))


@lru_cache(maxsize=1024)
def _log_once(solver: str, problem: str, reason: str) -> None:
    LOG.warning("%s failed on %s, which is counted: %s", solver, problem, reason)


_VELOCITIES = 9  # target velocities of manoeuvres per axis, from -v_max to v_max
_EXTRA_STEPS = 3  # of a manoeuvre, beyond those that it takes to stop
_MAX_STEPS = 24  # of a manoeuvre, for any a_max
_CHUNK = 512  # states processed at once: bounds memory
_TIE = 1e-9  # relative difference of risks that counts as a tie; the lower index leads


@dataclass(frozen=True, eq=False)
class FeedbackPolicy(Policy):
    """Base of the policies that solve formation problems around the feedback guide.

    Parameters
    ----------
    hazard : Hazard
    motion : Motion
    value : ValueFunction
        Of the feedback guide.
    solver : Solver
        Of the formation problems.
    """

    hazard: Hazard
    motion: Motion
    value: ValueFunction
    solver: Solver
    decision_tol: ClassVar[float] = SOLVER_TOL

    @override
    def decide_batch(
        self, step: int, positions: FloatArray, previous_velocities: FloatArray, alive: BoolArray
    ) -> Decision:
        lead, goals = self.lead_agents(step, positions, previous_velocities, alive)
        hazard = self.hazard.after(step + 1)
        data = Step(hazard, self.motion, positions, previous_velocities, alive, goals[None])
        return formation_decision(self._task(data, lead), self.solver)

    def _task(self, data: Step, lead: NDArray[np.intp]) -> FormationTask:
        """Problems of a step: (6), led by the lead agents, or (7), with them at the centre."""
        return FormationTask(data, lead)

    @override
    def leaders(
        self, step: int, positions: FloatArray, previous_velocities: FloatArray, alive: BoolArray
    ) -> NDArray[np.integer[Any]]:
        return self.lead_agents(step, positions, previous_velocities, alive)[0]

    def lead_agents(
        self, step: int, positions: FloatArray, previous_velocities: FloatArray, alive: BoolArray
    ) -> tuple[NDArray[np.intp], FloatArray]:
        """Indices (B,) of the lead agents, and their next positions at t + 1, (B, 2).

        The lead agent is the living member whose best path has the least risk, ties by index; where
        no member is known to arrive in time, the one nearest to the target, moving straight to it.
        """
        points = np.zeros_like(positions)
        risks = np.full(alive.shape, np.inf)
        points[alive], risks[alive] = self.best_steps(
            step, positions[alive], previous_velocities[alive]
        )
        offsets = positions - self.value.grid.task.center
        distances = np.where(alive, np.hypot(offsets[..., 0], offsets[..., 1]), np.inf)
        known = np.isfinite(risks).any(axis=1, keepdims=True)
        measure = np.where(known, risks, distances)
        least = measure.min(axis=1, keepdims=True)
        lead = np.argmax(measure <= least * (1 + _TIE), axis=1)
        return lead, points[np.arange(len(lead)), lead]

    def best_steps(
        self, step: int, positions: FloatArray, previous_velocities: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Next points (B, 2) of isolated agents on their best paths, and the risks (B,) of these.

        The agents are at `positions` (B, 2) and had velocities `previous_velocities` (B, 2), from
        which a_max bounds the change. Where no manoeuvre arrives in time the risk is infinite, and
        the path leads straight to the target.
        """
        # members of a batch share states: only distinct ones are processed
        states, inverse = np.unique(
            np.hstack([positions, previous_velocities]), axis=0, return_inverse=True
        )
        positions, previous_velocities = states[:, :2], states[:, 2:]
        straight = self.motion.toward(positions, previous_velocities, self.value.grid.task.center)
        points, least = positions + self.motion.dt * straight, np.empty(len(states))
        for begin in range(0, len(states), _CHUNK):
            chunk = slice(begin, begin + _CHUNK)
            paths = self._manoeuvres(step, positions[chunk], previous_velocities[chunk])
            risks = self._risks(step, paths)
            best, rows = risks.argmin(axis=1), np.arange(len(risks))
            least[chunk] = risks[rows, best]
            known = np.isfinite(least[chunk])[:, None]
            points[chunk] = np.where(known, paths[0, rows, best], points[chunk])
        inverse = inverse.reshape(-1)
        return points[inverse], least[inverse]

    def _manoeuvres(
        self, step: int, positions: FloatArray, previous_velocities: FloatArray
    ) -> FloatArray:
        """Positions (K, B, m, 2) at steps t+1..t+K of the m manoeuvres of every agent."""
        motion = self.motion
        change = math.sqrt(motion.a_max)
        length = math.ceil(motion.v_max / change) + _EXTRA_STEPS
        remaining = max(1, self.value.grid.task.steps - step)
        axis = np.linspace(-motion.v_max, motion.v_max, _VELOCITIES)
        targets = np.stack(np.meshgrid(axis, axis), axis=-1).reshape(-1, 2)
        velocity = np.clip(previous_velocities, -motion.v_max, motion.v_max)[:, None]
        position, path = positions[:, None], []
        for _ in range(min(length, remaining, _MAX_STEPS)):
            difference = targets - velocity
            distance = np.hypot(difference[..., 0], difference[..., 1])[..., None]
            velocity = velocity + difference * np.minimum(
                1.0, change / np.maximum(distance, 1e-300)
            )
            position = position + motion.dt * velocity
            path.append(position)
        return np.stack(path)

    def _risks(self, step: int, paths: FloatArray) -> FloatArray:
        """Risks (B, m) of manoeuvres (K, B, m, 2) and of what follows; infinite without arrival."""
        task, last = self.value.grid.task, len(paths) - 1
        rates = self.hazard.rates_along(paths, step)
        accumulated = task.dt * np.cumsum(rates, axis=0)
        inside = ((paths - task.center) ** 2).sum(axis=-1) <= task.radius**2
        arrival = inside.argmax(axis=0)
        to_go = self.value.after(step + 1 + last, paths[last])
        if last:
            to_go = to_go + accumulated[last - 1]
        arrived = np.take_along_axis(accumulated, arrival[None], axis=0)[0]
        return np.where(inside.any(axis=0), arrived, to_go)


@dataclass(frozen=True, eq=False)
class LeaderFeedbackPolicy(FeedbackPolicy):
    """Leader protection, led by the lead agent on its own best path.

    Parameters
    ----------
    follower_weight : float
        As of `LeaderPolicy`.
    """

    name: str = "leader-feedback"
    follower_weight: float = FOLLOWER_WEIGHT

    @override
    def _task(self, data: Step, lead: NDArray[np.intp]) -> FormationTask:
        return FormationTask(data, lead, follower_weight=self.follower_weight)


@dataclass(frozen=True, eq=False)
class ConstrainedFeedbackPolicy(FeedbackPolicy):
    """Constrained trajectory, with the corridor centred at the lead agent.

    A corridor around a fixed guide moves independently of the members. One that is recomputed from
    the members' positions would fall behind with them, because within the corridor they keep away
    from the radars ahead. So the lead agent moves to the corridor's centre itself, which keeps the
    corridor on time.

    Parameters
    ----------
    rho : float
        Bound on the squared distance of every member to the corridor's centre.
    """

    rho: float = 0.05
    name: str = "constrained-feedback"

    @override
    def _task(self, data: Step, lead: NDArray[np.intp]) -> FormationTask:
        return FormationTask(data, lead, self.rho)
