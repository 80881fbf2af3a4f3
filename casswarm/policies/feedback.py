"""Formations around the feedback guide: the best way on from where the swarm really is.

The paper names a policy for the guide as future work. A fixed guide is an open-loop path: a swarm
that is off it, because its leader was lost or its limits are tighter than the guide's, spends its
strength on coming back. Here the next point of the guide is found anew in every state, from the
value function.

The value function knows v_max alone, and a swarm that relied on it would find itself, time and
again, with a turn to make and no time left for it. So it is asked only about the end of manoeuvres
that respect a_max: from the present velocity towards another one, as fast as is allowed, for
three steps more than it takes to stop, 24 at the most. The best of them shows the first step, and
the next step chooses again.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..hazard import Hazard
from ..optimization.solvers import Solver
from ..planning.bounds.value_function import ValueFunction
from ..problems.formation import Motion, Step, corridor_formation, leader_formation
from ..typing import BoolArray, FloatArray
from .base import Decision, Policy
from .formation import solved

_VELOCITIES = 9  # an axis, from -v_max to v_max, at which manoeuvres aim
_RESERVE = 3  # steps of a manoeuvre beyond those that it takes to stop
_LONGEST = 24  # steps of a manoeuvre, however small a_max
_CHUNK = 512  # states at once: bounds memory
_TIE = 1e-9  # risks closer than this are equal; the lower index leads


@dataclass(frozen=True, eq=False)
class FeedbackPolicy(Policy):
    """Base of the policies that follow the feedback guide.

    Parameters
    ----------
    hazard : Hazard
    motion : Motion
    value : ValueFunction
    solver : Solver
        Of the formation problems.
    """

    hazard: Hazard
    motion: Motion
    value: ValueFunction
    solver: Solver

    def leaders(
        self, step: int, positions: FloatArray, previous_velocities: FloatArray, alive: BoolArray
    ) -> NDArray[np.integer[Any]]:
        """Who shows the way in every state, (B,)."""
        return self.pathfinders(step, positions, previous_velocities, alive)[0]

    def pathfinders(
        self, step: int, positions: FloatArray, previous_velocities: FloatArray, alive: BoolArray
    ) -> tuple[NDArray[np.intp], FloatArray]:
        """Who shows the way, (B,), and where to be at t + 1, (B, 2): `decide`'s states.

        The living member whose best way on has the least risk, ties by index; where nobody is known
        to arrive in time, the one nearest to the target, straight on.
        """
        points = np.zeros_like(positions)
        risks = np.full(alive.shape, np.inf)
        points[alive], risks[alive] = self.ways_on(
            step, positions[alive], previous_velocities[alive]
        )
        away = positions - self.value.grid.task.center
        distances = np.where(alive, np.hypot(away[..., 0], away[..., 1]), np.inf)
        known = np.isfinite(risks).any(axis=1, keepdims=True)
        measure = np.where(known, risks, distances)
        least = measure.min(axis=1, keepdims=True)
        first = np.argmax(measure <= least * (1 + _TIE), axis=1)
        return first, points[np.arange(len(first)), first]

    def ways_on(
        self, step: int, places: FloatArray, previous_velocities: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Next points (B, 2) of agents at places (B, 2), and the risks (B,) of the ways there.

        `previous_velocities` (B, 2) are their velocities V(t-1), from which a_max bounds the change. A risk is
        infinite, and the way straight to the target, where no manoeuvre arrives in time.
        """
        # members of a batch share places: only distinct ones are worked on
        states, inverse = np.unique(
            np.hstack([places, previous_velocities]), axis=0, return_inverse=True
        )
        points, risks = np.empty((len(states), 2)), np.empty(len(states))
        for begin in range(0, len(states), _CHUNK):
            part = slice(begin, begin + _CHUNK)
            points[part], risks[part] = self._best(step, states[part, :2], states[part, 2:])
        inverse = inverse.reshape(-1)
        return points[inverse], risks[inverse]

    def _best(
        self, step: int, places: FloatArray, previous_velocities: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        paths = self._manoeuvres(step, places, previous_velocities)
        risks = self._risks(step, paths)
        best, rows = risks.argmin(axis=1), np.arange(len(places))
        least = risks[rows, best]
        straight = self.motion.toward(places, previous_velocities, self.value.grid.task.center)
        onwards = places + self.motion.dt * straight
        return np.where(np.isfinite(least)[:, None], paths[0, rows, best], onwards), least

    def _manoeuvres(
        self, step: int, places: FloatArray, previous_velocities: FloatArray
    ) -> FloatArray:
        """Positions (K, B, m, 2) at steps t+1..t+K of the m manoeuvres of every agent."""
        motion = self.motion
        change = math.sqrt(motion.a_max)
        length = math.ceil(motion.v_max / change) + _RESERVE
        left = max(1, self.value.grid.task.steps - step)
        axis = np.linspace(-motion.v_max, motion.v_max, _VELOCITIES)
        aims = np.stack(np.meshgrid(axis, axis), axis=-1).reshape(-1, 2)
        velocity = np.clip(previous_velocities, -motion.v_max, motion.v_max)[:, None]
        position, path = places[:, None], []
        for _ in range(min(length, left, _LONGEST)):
            missing = aims - velocity
            distance = np.hypot(missing[..., 0], missing[..., 1])[..., None]
            velocity = velocity + missing * np.minimum(1.0, change / np.maximum(distance, 1e-300))
            position = position + motion.dt * velocity
            path.append(position)
        return np.stack(path)

    def _risks(self, step: int, paths: FloatArray) -> FloatArray:
        """Risks (B, m) of manoeuvres (K, B, m, 2) and of what follows; infinite without arrival."""
        task, last = self.value.grid.task, len(paths) - 1
        rates = self.hazard.single_agent_rates(paths.reshape(-1, 2)).reshape(paths.shape[:-1])
        until = task.dt * np.cumsum(rates, axis=0)
        inside = ((paths - task.center) ** 2).sum(axis=-1) <= task.radius**2
        arrival = inside.argmax(axis=0)
        going_on = self.value.after(step + 1 + last, paths[last])
        if last:
            going_on = going_on + until[last - 1]
        arrived = np.take_along_axis(until, arrival[None], axis=0)[0]
        return np.where(inside.any(axis=0), arrived, going_on)


@dataclass(frozen=True, eq=False)
class LeaderFeedbackPolicy(FeedbackPolicy):
    """Leader protection, the leader being the pathfinder on its own way on."""

    name: str = "leader-feedback"

    def decide(
        self, step: int, positions: FloatArray, previous_velocities: FloatArray, alive: BoolArray
    ) -> Decision:
        """Solve problem (6) around the leader's best way on; see `Policy.decide`."""
        leaders, goals = self.pathfinders(step, positions, previous_velocities, alive)
        data = Step(self.hazard, self.motion, positions, previous_velocities, alive, goals)
        return solved(leader_formation(data, leaders), self.solver)


@dataclass(frozen=True, eq=False)
class ConstrainedFeedbackPolicy(FeedbackPolicy):
    """Constrained trajectory, the corridor's centre being the pathfinder.

    A corridor around a fixed guide is where it is whatever the members do. One that starts anew
    from where they are would fall behind with them, for within the corridor they keep away from the
    radars ahead. So the pathfinder flies to the corridor's centre itself, which thus keeps time.

    Parameters
    ----------
    rho : float
        Bound on the squared distance of every member to the corridor's centre.
    """

    rho: float = 0.05
    name: str = "constrained-feedback"

    def decide(
        self, step: int, positions: FloatArray, previous_velocities: FloatArray, alive: BoolArray
    ) -> Decision:
        """Solve problem (7) around the pathfinder's best way on; see `Policy.decide`."""
        first, goals = self.pathfinders(step, positions, previous_velocities, alive)
        data = Step(self.hazard, self.motion, positions, previous_velocities, alive, goals)
        return solved(corridor_formation(data, self.rho, first), self.solver)
