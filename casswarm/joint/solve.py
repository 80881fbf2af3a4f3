"""Single solve of a joint plan: an initial guess, a solver's answer, and its exact value."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from ..hazard import Hazard, KernelHazard
from ..motion.kinematics import integrate
from ..nlp.program import Nlp
from ..nlp.solution import Solution
from ..problems.joint import JointForm, JointTask, joint_instances
from ..problems.joint_hessian import MAX_MEMBERS
from ..solvers import FilterInteriorPoint, Ipopt, Solver
from ..solvers.interior_point.derivatives import NumericDerivatives
from ..typing import FloatArray, IntArray
from .initial_guesses import InitialGuess, track
from .numeric import joint_program
from .plan_distribution import MAX_EXACT, plan_law
from .swarm_plan import DISTANCE_TOL, SwarmOutcome, least_distance

if TYPE_CHECKING:
    from ..scenario import Scenario

STAGED = ("auto", "ipopt")
"""Solvers that have settings for each stage of a search."""

MAX_NEWTON = 8
"""Maximum number of members for which casswarm's own second derivatives pay off."""

_TIME_LIMIT = 3600.0  # never reached: solves end by iterations, whatever the machine's speed


def stage_solver(
    name: str, hazard: Hazard | tuple[Hazard, ...], form: JointForm, iterations: int
) -> Solver:
    """The solver of a stage of a search: near its start, and to a number of iterations.

    With exact second derivatives of small swarms: for ``"auto"`` casswarm's own interior-point
    method if the rates are made of kernels, else Ipopt. Of larger ones and of the mean field, Ipopt
    with a limited-memory Hessian. Log-odds to 1e-7 are relative differences in the probability of
    failure.
    """
    near: dict[str, Any] = {"constraint_tolerance": 1e-8, "max_iter": iterations}
    exact: dict[str, Any] = {"tolerance": 1e-7, "bound_push": 1e-4, "mu_init": 1e-3}
    hazards = hazard if isinstance(hazard, tuple) else (hazard,)
    kernels = all(isinstance(each.after(0), KernelHazard) for each in hazards)
    if form.exact and name == "auto" and kernels:
        if form.n <= MAX_NEWTON:
            return FilterInteriorPoint(
                constr_mult_init_max=0.0, restoration=False, scaling=False, **near, **exact
            )
    elif form.exact and form.n <= MAX_MEMBERS:
        return Ipopt(time_limit=_TIME_LIMIT, **near, **exact)
    return Ipopt(
        tolerance=1e-5,
        hessian="limited-memory",
        memory=20,
        mu_strategy="adaptive",
        time_limit=_TIME_LIMIT,
        **near,
    )


@dataclass(frozen=True, eq=False)
class JointProblem:
    """A swarm's task and the program that plans it.

    Parameters
    ----------
    scenario : Scenario
        For its hazard and target; members, limits and steps are those of the task.
    task : JointTask
    form : JointForm
        With a horizon of at least the task's steps.
    """

    scenario: Scenario
    task: JointTask
    form: JointForm

    @property
    def nlp(self) -> Nlp:
        """The program, which is built once for all problems of its form."""
        return joint_program(self.hazards, self.form, False)

    @property
    def hazards(self) -> Hazard | tuple[Hazard, ...]:
        """The hazard, or those of all cases."""
        hazards = tuple(case.scenario.hazard for case in self.scenario.cases)
        return hazards if len(hazards) > 1 else hazards[0]

    def solve(self, guesses: Sequence[InitialGuess], solver: Solver) -> list[SwarmOutcome]:
        """The solver's answers from initial guesses, within all limits, and their values."""
        arrivals = [self._prescribed(guess.arrivals) for guess in guesses]
        instances = joint_instances(
            self.nlp, self.form, self.task, arrivals, [guess.velocities for guess in guesses]
        )
        numeric = self.nlp.attached(NumericDerivatives)
        compiled = isinstance(solver, FilterInteriorPoint) and numeric is not None
        nlp = self.nlp if compiled else joint_program(self.hazards, self.form)
        solutions = solver.solve(nlp, instances)
        return [
            self._outcome(guess, prescribed, solution)
            for guess, prescribed, solution in zip(guesses, arrivals, solutions, strict=True)
        ]

    def _prescribed(self, arrivals: IntArray) -> IntArray:
        """Arrival steps of the program: a common one if runs end with all, or need several."""
        together = self.form.outside or self.task.needed > 1
        return np.where(arrivals > 0, arrivals.max(), 0) if together else arrivals

    def _outcome(self, guess: InitialGuess, arrivals: IntArray, solution: Solution) -> SwarmOutcome:
        flat = self.nlp.variable("velocities", solution.x)
        last = int(arrivals.max()) if arrivals.all() else self.task.steps
        velocities = self.task.motion.v_max * flat.reshape(self.form.horizon, self.form.n, 2)[:last]
        if not np.isfinite(velocities).all():
            velocities = guess.velocities[:last]
        known = guess.velocities[: self.task.known]
        velocities = self.feasible(np.concatenate([known, velocities[len(known) :]]))
        value = self.value(velocities, arrivals)
        distance = least_distance(self.positions(velocities)[1:])
        separated = distance >= (1 - DISTANCE_TOL) * self.task.min_distance
        seconds = solution.build_seconds + solution.solve_seconds
        return SwarmOutcome(guess.name, arrivals, velocities, value, solution, seconds, separated)

    def restart(self, outcome: SwarmOutcome) -> InitialGuess:
        """An initial guess from an outcome, with the arrival steps that its members reach."""
        reached = first_arrivals(self.scenario, self.positions(outcome.velocities))
        arrivals = np.where((reached > 0) & (outcome.arrivals > 0), reached, outcome.arrivals)
        if self.form.outside:
            arrivals = outcome.arrivals
        return InitialGuess(outcome.start, arrivals, outcome.velocities)

    def feasible(self, velocities: FloatArray) -> FloatArray:
        """Velocities within the limits, continued to the target's centre without full arrival.

        Velocities that exceed a limit by a solver's tolerance are projected as in the chain.
        """
        task = self.task
        applied = self._applied(velocities)
        positions = self.positions(applied)
        reached = first_arrivals(self.scenario, positions)
        if reached.all():
            return applied[: int(reached.max())]
        remaining = task.steps - len(applied)
        if remaining <= 0:
            return applied
        last = applied[-1] if len(applied) else task.initial_velocities
        here = replace(task, start=positions[-1], initial_velocities=last)
        goals = np.broadcast_to(task.center, (remaining, self.form.n, 2))
        return np.concatenate([applied, track(here, np.array(goals))])

    def _applied(self, velocities: FloatArray) -> FloatArray:
        """Velocities (T, n, 2), projected where they violate a limit."""
        motion, previous_velocities = self.task.motion, self.task.initial_velocities
        before = np.concatenate([previous_velocities[None], velocities[:-1]])
        if not (motion.sets(before).violation(velocities) > 0).any():
            return velocities
        applied = np.empty_like(velocities)
        for step, velocity in enumerate(velocities):
            sets = motion.sets(previous_velocities)
            violated = sets.violation(velocity) > 0
            applied[step] = np.where(violated[:, None], sets.project(velocity), velocity)
            previous_velocities = applied[step]
        return applied

    def positions(self, velocities: FloatArray) -> FloatArray:
        """X(0..T), (T+1, n, 2), as the chain computes them."""
        return integrate(self.task.start, velocities, self.task.motion.dt)

    def value(self, velocities: FloatArray, arrivals: IntArray) -> float:
        """Value of the objective for velocities (T, n, 2), exact for small swarms."""
        scale = 1.0 if self.form.objective == "success" else self.form.n
        if self.form.n <= MAX_EXACT:
            positions = self.positions(velocities)
            law = plan_law(self.scenario, positions, self.form.first)
            return scale * (1.0 - law.cost(self.form.objective))
        instance = joint_instances(self.nlp, self.form, self.task, [arrivals], [velocities])
        odds = float(self.nlp.evaluate(instance.x0[0], instance.p[0])[0])
        return scale * float(1.0 / (1.0 + np.exp(odds)))


def first_arrivals(scenario: Scenario, positions: FloatArray) -> IntArray:
    """First step (n,) of trajectories (T+1, n, 2) in the target, 0 for members that never are."""
    inside = scenario.target.contains(positions[1:])
    return np.where(inside.any(axis=0), inside.argmax(axis=0) + 1, 0)
