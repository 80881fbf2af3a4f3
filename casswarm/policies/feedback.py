"""Feedback policies: formations around the best path from where the swarm is.

The paper names a policy for the guide as future work. A fixed guide is an open-loop path: a swarm
that is off it, because its leader was lost or its limits are tighter than the guide's, spends its
effort on returning. Here the next point of the guide is recomputed in every state, from the value
function.

The value function takes only v_max into account, and a swarm that relied on it alone would
repeatedly find itself with a turn to make and no time left for it. So it is evaluated only at the
end of manoeuvres that respect a_max: from the present velocity towards another one, as fast as is
allowed, for three steps more than it takes to stop, at most 24. The best of them determines the
first step, and the next step chooses again.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from ..hazard import Hazard
from ..optimization.solvers import Solver
from ..planning.bounds import ValueFunction
from ..problems.formation import FormationTask
from ..problems.step import Motion, Step
from ..typing import BoolArray, FloatArray
from .base import Policy
from .decision import SOLVER_TOL, Decision
from .formation import formation_decision

_VELOCITIES = 9  # target velocities of manoeuvres per axis, from -v_max to v_max
_EXTRA_STEPS = 3  # of a manoeuvre, beyond those that it takes to stop
_MAX_STEPS = 24  # of a manoeuvre, for any a_max
_CHUNK = 512  # states processed at once: bounds memory
_TIE = 1e-9  # relative difference of risks that counts as a tie; the lower index leads


@dataclass(frozen=True, eq=False)
class FeedbackPolicy(Policy):
    """Base of the policies that follow the feedback guide.

    Parameters
    ----------
    hazard : Hazard
    motion : Motion
    value : ValueFunction
    solver : Solver
        Solver of the formation problems.
    """

    hazard: Hazard
    motion: Motion
    value: ValueFunction
    solver: Solver
    decision_tol: ClassVar[float] = SOLVER_TOL

    def leaders(
        self, step: int, positions: FloatArray, previous_velocities: FloatArray, alive: BoolArray
    ) -> NDArray[np.integer[Any]]:
        """Index (B,) of the lead agent in every state."""
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
        rates = self.hazard.single_agent_rates(paths.reshape(-1, 2)).reshape(paths.shape[:-1])
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
    """Leader protection, led by the lead agent on its own best path."""

    name: str = "leader-feedback"

    def decide_batch(
        self, step: int, positions: FloatArray, previous_velocities: FloatArray, alive: BoolArray
    ) -> Decision:
        """Solve problem (6) around the leader's best path; see `Policy.decide_batch`."""
        leaders, goals = self.lead_agents(step, positions, previous_velocities, alive)
        data = Step(self.hazard, self.motion, positions, previous_velocities, alive, goals[None])
        return formation_decision(FormationTask(data, leaders), self.solver)


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

    def decide_batch(
        self, step: int, positions: FloatArray, previous_velocities: FloatArray, alive: BoolArray
    ) -> Decision:
        """Solve problem (7) around the lead agent's best path; see `Policy.decide_batch`."""
        lead, goals = self.lead_agents(step, positions, previous_velocities, alive)
        data = Step(self.hazard, self.motion, positions, previous_velocities, alive, goals[None])
        return formation_decision(FormationTask(data, lead, self.rho), self.solver)
