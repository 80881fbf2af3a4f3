"""One solve of a joint plan: what a solver makes of a start, flown and priced."""

from __future__ import annotations

import time
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from ...optimization.problem import Nlp
from ...optimization.solvers import Ipopt, Solver
from ...problems.formation import Motion
from ...problems.joint import JointForm, joint_nlp
from ...problems.joint_instances import JointTask, joint_instance
from ...typing import FloatArray, IntArray
from .distribution import PlanDistribution
from .initial_guesses import SwarmStart, follow
from .plan import NEARLY, SwarmOutcome, least_distance

if TYPE_CHECKING:
    from ...scenario import Scenario

_SECONDS = 3600.0  # of one solve: iterations end it, so that answers do not depend on the machine

MAX_EXACT = 10
"""Members up to which plans are priced exactly."""


def newton(iterations: int) -> Ipopt:
    """Ipopt with exact second derivatives, that stays near its start: for swarms of at most `MAX_ITERATIONS`.

    Log-odds to 1e-7 are relative differences in the probability of failure.
    """
    return Ipopt(
        tolerance=1e-7,
        max_iter=iterations,
        time_limit=_SECONDS,
        constraint_tolerance=1e-8,
        bound_push=1e-4,
        mu_init=1e-3,
    )


def quasi_newton(iterations: int) -> Ipopt:
    """Ipopt with a limited-memory Hessian: for larger swarms, and the mean field."""
    return Ipopt(
        tolerance=1e-5,
        max_iter=iterations,
        time_limit=_SECONDS,
        hessian="limited-memory",
        memory=20,
        mu_strategy="adaptive",
        constraint_tolerance=1e-8,
    )


@dataclass(frozen=True, eq=False)
class JointProblem:
    """A swarm's task and the program that plans it.

    Parameters
    ----------
    scenario : Scenario
        For its hazard, target and limits; members and steps are those of the task.
    task : JointTask
    form : JointForm
        Of a horizon of at least the task's steps.
    """

    scenario: Scenario
    task: JointTask
    form: JointForm

    @property
    def nlp(self) -> Nlp:
        """The program; built once for all problems of its form."""
        return joint_nlp(self.scenario.hazard, self.form)

    def solved(self, start: SwarmStart, solver: Solver) -> SwarmOutcome:
        """What a solver makes of a start, within all limits, and what it is worth."""
        begun = time.perf_counter()
        form, arrivals = self.form, start.arrivals
        if form.outside:  # runs end at the first arrival: all at once
            arrivals = np.where(arrivals > 0, arrivals.max(), 0)
        instance = joint_instance(self.nlp, form, self.task, arrivals, start.velocities)
        solution = solver.solve(self.nlp, instance)[0]
        flat = self.nlp.variable("velocities", solution.x)
        last = int(arrivals.max()) if arrivals.all() else self.task.steps
        wanted = self.task.v_max * flat.reshape(form.horizon, form.n, 2)[:last]
        if not np.isfinite(wanted).all():
            wanted = start.velocities[:last]
        velocities = self.flown(wanted)
        value = self.value(velocities, arrivals)
        seconds = time.perf_counter() - begun
        nearest = least_distance(self.positions(velocities)[1:])
        apart = nearest >= NEARLY * self.task.distance
        return SwarmOutcome(start.origin, arrivals, velocities, value, solution, seconds, apart)

    def again(self, outcome: SwarmOutcome) -> SwarmStart:
        """A start from an outcome, at the steps at which its members really arrive."""
        real = first_steps(self.scenario, self.positions(outcome.velocities))
        arrivals = np.where((real > 0) & (outcome.arrivals > 0), real, outcome.arrivals)
        if self.form.outside:
            arrivals = outcome.arrivals
        return SwarmStart(outcome.origin, arrivals, outcome.velocities)

    def flown(self, wanted: FloatArray) -> FloatArray:
        """Velocities within the limits, on to the target's centre where a member has not arrived.

        What a solver's tolerance leaves beyond a limit is taken away as the chain would.
        """
        task, motion = self.task, Motion.from_scenario(self.scenario)
        found = np.empty_like(wanted)
        previous_velocities = task.before
        for step, velocity in enumerate(wanted):
            sets = motion.sets(previous_velocities)
            beyond = sets.violation(velocity) > 0
            found[step] = np.where(beyond[:, None], sets.project(velocity), velocity)
            previous_velocities = found[step]
        reached = first_steps(self.scenario, self.positions(found))
        if reached.all():
            return found[: int(reached.max())]
        left = task.steps - len(found)
        if left <= 0:
            return found
        here = replace(task, start=self.positions(found)[-1], before=previous_velocities)
        goals = np.broadcast_to(task.center, (left, self.form.n, 2))
        return np.concatenate([found, follow(here, np.array(goals))])

    def positions(self, velocities: FloatArray) -> FloatArray:
        """X(0..T), (T+1, n, 2), as the chain computes them."""
        found = np.empty((len(velocities) + 1, *self.task.start.shape))
        found[0] = self.task.start
        for step, velocity in enumerate(velocities):
            found[step + 1] = found[step] + self.task.dt * velocity
        return found

    def value(self, velocities: FloatArray, arrivals: IntArray) -> float:
        """What is maximised, of velocities (T, n, 2): exactly where that can be."""
        share = 1.0 if self.form.objective == "success" else self.form.n
        if self.form.n <= MAX_EXACT:
            law = PlanDistribution.of(self.scenario, self.positions(velocities))
            return share * (1.0 - law.cost(self.form.objective))
        instance = joint_instance(self.nlp, self.form, self.task, arrivals, velocities)
        odds = float(self.nlp.evaluate(instance.x0[0], instance.p[0])[0])
        return share * float(1.0 / (1.0 + np.exp(odds)))


def first_steps(scenario: Scenario, positions: FloatArray) -> IntArray:
    """First step at which each member (n,) of ways (T+1, n, 2) is in the target, 0 for never."""
    inside = scenario.target.contains(positions[1:])
    return np.where(inside.any(axis=0), inside.argmax(axis=0) + 1, 0)
