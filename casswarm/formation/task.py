"""The formation problems of one step as arrays: what a batch of states asks of a solver.

The program is that of `casswarm.problems.formation`. Rules select the leader: the paper says only
that another one can be chosen when the leader is destroyed. A rule depends on the state, not on its
history: a leader on the guide remains the nearest to it while it is alive.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ..compiled.kernels import contiguous
from ..hazard import Hazard, KernelHazard
from ..motion.planar import PlanarSets
from ..motion.planar_kernels import WIDTH
from ..motion.step import Step
from ..nlp.program import Instances, Nlp
from ..typing import BoolArray, FloatArray, IntArray
from .objective import CompiledObjective, formation_program
from .state_kernels import (
    StateProblem,
    States,
    Terms,
    isolated_rates,
    nearest_living,
    write_problems,
)

FOLLOWER_WEIGHT = 0.01
"""Default weight of the other members' rates in leader protection, where members collide.

The leader's rate depends on distances to the leader alone. Without collisions it increases with
each, and determines the formation. With collisions it is least at some distance, in any direction:
among the minimisers, the one of least total rate is wanted. This weight selects it."""


@dataclass(frozen=True, eq=False)
class Formation:
    """A batch of B formation problems, ready to be solved.

    Parameters
    ----------
    nlp : Nlp
    instances : Instances
        B instances; members whose velocity is prescribed have a box of zero width.
    free : (B, n) bool
        Members whose velocity is optimised.
    sets : PlanarSets, shape (B, n)
        Sets of the velocities of the first step.
    fallback : (B, n, 2)
        Allowed velocities to apply if a solver fails.
    infeasible : (B, n) bool
        Members that cannot meet their soft constraint within the hard constraints.
    tracked : (B, n) bool, optional
        Members of whom the applied velocity shows whether they meet it.
    radius : float
        Distance from the goal within which tracked members meet it.
    failures : (B,) int, optional
        1 where building the problem failed and an approximation is used.
    """

    nlp: Nlp
    instances: Instances
    free: BoolArray
    sets: PlanarSets
    fallback: FloatArray
    infeasible: BoolArray
    tracked: BoolArray | None = None
    radius: float = 0.0
    failures: IntArray | None = None


@dataclass(frozen=True, eq=False)
class FormationTask:
    """The formation problems of one step in B states: leader protection, or a corridor.

    Parameters
    ----------
    step : Step
        Of a single step, H = 1.
    leaders : (B,) int
        Members that move to the goal, living ones; -1 for none, which only a corridor allows.
    rho : float, optional
        Bound on the squared distance to the goal, with a corridor.
    follower_weight : float
        Weight of the followers' rates in leader protection; not used, and 0, where the leader's
        rate alone determines the formation.
    """

    step: Step
    leaders: IntArray
    rho: float | None = None
    follower_weight: float = FOLLOWER_WEIGHT

    @property
    def nlp(self) -> Nlp:
        """The program of all states."""
        n, disc = self.step.alive.shape[1], self.step.motion.disc
        return formation_program(self.step.hazard, n, self.rho is not None, disc=disc)

    @property
    def states(self) -> States:
        """The states as kernels take them."""
        step, goals = self.step, np.empty((len(self.leaders), 2))
        goals[:] = step.goals[0].reshape(-1, 2)
        return States(
            contiguous(np.asarray(step.positions, float)),
            contiguous(np.asarray(step.previous_velocities, float)),
            contiguous(step.alive),
            goals,
            contiguous(np.asarray(self.leaders, np.int64)),
        )

    @property
    def terms(self) -> Terms:
        """Common terms of the problems."""
        motion, hazard = self.step.motion, self.step.hazard
        return Terms(
            dt=float(motion.dt),
            v_max=float(motion.v_max),
            motion=motion.limits,
            at_goal=motion.position_tol,
            corridor=-1.0 if self.rho is None else math.sqrt(self.rho) / motion.dt,
            gathers=_gathers(hazard),
            follower_weight=_follower_weight(hazard, self.follower_weight),
        )

    def __getitem__(self, rows: IntArray) -> FormationTask:
        return replace(self, step=self.step[rows], leaders=self.leaders[rows])

    def formation(self) -> Formation:
        """The problems as arrays, for any solver.

        Raises
        ------
        ValueError
            A number is not finite, or a member's limits of motion allow no velocity.
        """
        batch, n = self.step.alive.shape
        problems = StateProblem(
            np.empty((batch, 6 * n + 4)),
            np.empty((batch, 2 * n)),
            np.empty((batch, n, WIDTH)),
            *np.empty((2, batch, n), bool),
        )
        solvable = np.empty(batch, bool)
        write_problems(self.states, self.terms, problems, solvable)
        if not solvable.all():
            raise ValueError(
                f"{np.count_nonzero(~solvable)} of {batch} states have no formation problem: "
                "positions, velocities and goals must be finite, and previous velocities within "
                "v_max, or so close to it that a_max allows to return"
            )
        return _formation(self, problems)


def leader_formation(step: Step, leaders: IntArray) -> Formation:
    """Leader protection, problem (6); `leaders` (B,) are the indices of living members."""
    return FormationTask(step, leaders).formation()


def corridor_formation(step: Step, rho: float, lead_agents: IntArray | None = None) -> Formation:
    """Constrained trajectory, problem (7); `rho` bounds the squared distance to the goal.

    `lead_agents` (B,), if given, are the indices of members that move to the goal itself.
    """
    return FormationTask(step, or_none(lead_agents, len(step.alive)), rho).formation()


def or_none(leaders: IntArray | None, batch: int) -> IntArray:
    """The leaders (B,), or -1 for all states where there are none."""
    return np.full(batch, -1) if leaders is None else leaders


def leader_weights(
    step: Step, leads: BoolArray, follower_weight: float = FOLLOWER_WEIGHT
) -> FloatArray:
    """Weights (B, n) of the members' rates in leader protection, for leaders (B, n)."""
    return np.where(leads, 1.0, _follower_weight(step.hazard, follower_weight)) * step.alive


def _gathers(hazard: Hazard) -> bool:
    return isinstance(hazard, KernelHazard) and hazard.gathers


def _follower_weight(hazard: Hazard, weight: float) -> float:
    return 0.0 if _gathers(hazard) else weight


def _formation(task: FormationTask, problems: StateProblem) -> Formation:
    """Formation of the problems that kernels wrote."""
    batch, corridor = len(task.leaders), task.rho is not None
    disc = task.step.motion.disc
    sets = PlanarSets.from_packed(problems.sets, 3 if disc else 1 + corridor)
    stated = sets.radii if corridor or not disc else sets.radii[..., [0, 2]]
    squared = (stated / task.step.motion.v_max) ** 2  # constraints bound squared distances
    instances = Instances(
        x0=problems.guess,
        p=problems.p,
        lbx=sets.lower.reshape(batch, -1),
        ubx=sets.upper.reshape(batch, -1),
        lbg=np.full((batch, task.nlp.sizes[2]), -np.inf),
        ubg=np.moveaxis(squared, -1, 1).reshape(batch, -1),  # in the order of `constraints`
        feasible_set=sets,
        scale=_step_scale(task, problems.p),
    )
    fallback = sets.project(task.step.previous_velocities)
    return Formation(task.nlp, instances, problems.free, sets, fallback, problems.infeasible)


def formation_scale(step: Step, weights: FloatArray) -> FloatArray:
    """Scales (B, 2): v_max, and the rate of isolated members at the present positions, H steps."""
    hazards = (step.hazard, *step.later)
    isolated = sum(
        (weights * hazard.single_agent_rates(step.positions)).sum(axis=1) for hazard in hazards
    )
    return _scale(step, isolated if step.later else step.horizon * isolated)


def _scale(step: Step, rates: FloatArray) -> FloatArray:
    return np.stack([np.full(len(rates), step.motion.v_max), np.where(rates > 0, rates, 1.0)], 1)


def _step_scale(task: FormationTask, p: FloatArray) -> FloatArray:
    """`formation_scale` of one step; by the compiled objective if there is one, to the last bit."""
    (batch, n), compiled = task.step.alive.shape, task.nlp.attached(CompiledObjective)
    if compiled is not None:
        rates = np.empty(batch)
        alive = contiguous(task.step.alive)
        isolated_rates(compiled.evaluate, p, alive, compiled.constants, rates)
        if (np.isfinite(rates) & (rates >= 0)).all():
            return _scale(task.step, rates)
    return formation_scale(task.step, p[:, 5 * n : 6 * n])  # which names a rate that is no rate


Rule = Callable[[Step, FloatArray], NDArray[np.intp]]

_TIE = 1e-6  # of rates, and of distances in v_max dt: a tie, in which the lower index leads


def nearest(step: Step, reference: FloatArray) -> NDArray[np.intp]:
    """The living member nearest to the guide's present point, ties by index.

    As in the other rules, among those that may lead (`Step.candidates`). `reference` has one point,
    (2,), or one for every state, (B, 2) or (B, 1, 2).
    """
    batch, tie = len(step.alive), _TIE * step.motion.v_max * step.motion.dt
    points, leaders = np.empty((batch, 2)), np.empty(batch, np.intp)
    points[:] = reference.reshape(-1, 2)
    positions, alive = contiguous(step.positions), contiguous(step.candidates)
    nearest_living(positions, alive, points, tie, leaders)
    return leaders


def first(step: Step, reference: FloatArray) -> NDArray[np.intp]:  # noqa: ARG001
    """The living member with the lowest index."""
    return np.asarray(np.argmax(step.candidates, axis=1))


def safest(step: Step, reference: FloatArray) -> NDArray[np.intp]:  # noqa: ARG001
    """The living member with the lowest rate at its present position, ties by index."""
    rates = np.where(step.candidates, step.hazard.rates(step.positions, step.alive), np.inf)
    return np.asarray(np.argmax(rates <= rates.min(axis=1, keepdims=True) * (1 + _TIE), axis=1))


LEADER_SELECTION: dict[str, Rule] = {"nearest": nearest, "first": first, "safest": safest}
"""Rules by name, as `make_policy` takes them in `leader_selection`."""
