"""Replanning for the survivors: a tree of joint plans that grows as members are lost.

In a situation (P, t, d), exactly the members d are left at step t on the trajectories of a plan P
for more members. Each that is probable enough is solved once, from the rest of P's trajectories,
and the new plan for d is adopted if its exact value is higher. ``docs/joint.md`` says why the plan
cannot become worse, nor depend on the order of runs. If the hazard is not known, its cases have the
weights of the posterior, given that this situation has occurred.

**News that is late.** At step t it is known that exactly d lived at step t - delay. Since then they
have followed P, so what has happened to them has a known law: a plan's distribution, and its value,
begin at that step, with the known steps of P in front, which the program keeps fixed.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, TypeAlias

import numpy as np

from .._util.text import shown
from ..errors import PolicyError
from ..problems.joint import JointForm, JointTask
from ..solvers import Solver
from ..typing import FloatArray
from .initial_guesses import InitialGuess
from .plan_distribution import MAX_EXACT, CasesDistribution, PlanDistribution, plan_law
from .solve import JointProblem, first_arrivals, stage_solver
from .swarm_plan import SwarmPlan

if TYPE_CHECKING:
    from ..scenario import Scenario

MIN_PROBABILITY = 1e-3
"""Default probability of a situation from which it is planned for."""

ITERATIONS = 60
"""Of a plan for survivors, whose initial guess is good."""

_POSSIBLE = 1e-300  # weight of a case that keeps it
_HORIZONS = 4  # program horizons are multiples of a quarter of the steps: few programs are built

Members: TypeAlias = tuple[int, ...]
"""Indices of the living members, ascending."""

Path: TypeAlias = tuple[tuple[int, Members], ...]
"""Steps and survivors of the successive situations that lead to a plan."""


@dataclass(frozen=True, eq=False)
class Branch:
    """A plan of the tree."""

    path: Path  # the situations that led here; empty for the root
    step: int  # from which on its trajectories are known: when exactly its members were alive
    members: Members
    positions: FloatArray  # (T+1, m, 2), of its members, from `step` on
    velocities: FloatArray  # (T, m, 2)
    initial_velocities: FloatArray  # (m, 2), before `step`
    probability: float  # of the situation that it was made for, by the previous distributions
    law: PlanDistribution | CasesDistribution

    def state(self, step: int, members: Members) -> tuple[FloatArray, FloatArray]:
        """X(step), V(step-1) of some of its members, (m, 2) each."""
        rows, at = self._rows(members), step - self.step
        previous_velocities = self.velocities[at - 1] if at else self.initial_velocities
        return self.positions[at][rows], previous_velocities[rows]

    def remaining(self, step: int, members: Members) -> FloatArray:
        """Velocities (T', m, 2) of some of its members from a step on; none after its end."""
        return self.velocities[step - self.step :][:, self._rows(members)]

    def entering(self, step: int, members: Members) -> FloatArray:
        """Probability that all its members are alive before a step and exactly these after it.

        (K,), of this and each of the K cases of the hazard.
        """
        at, survives = step - self.step - 1, np.isin(self.members, members)
        if isinstance(self.law, CasesDistribution):
            cases, prior = self.law.cases, self.law.prior
        else:
            cases, prior = (self.law,), np.ones(1)
        if not 0 <= at < len(cases[0].lost):
            return np.zeros(len(cases))
        lost = np.array([case.lost[at, -1] for case in cases])
        outcome = np.where(survives, 1 - lost, lost).prod(axis=1)
        masses = np.array([case.masses[at, -1] for case in cases])
        return np.asarray(self.probability * prior * masses * outcome)

    def _rows(self, members: Members) -> list[int]:
        return [self.members.index(member) for member in members]


class PlanTree:
    """A tree of plans, which is extended as new situations occur.

    Parameters
    ----------
    scenario : Scenario
    plan : SwarmPlan
        The root, whose objective and minimum distance hold for all plans.
    solver : Solver, optional
    min_probability : float
        Of a situation that is planned for.

    Attributes
    ----------
    branches : dict
        The plan to follow in every situation planned for so far: the previous one if that is at
        least as good.

    Raises
    ------
    PolicyError
        A swarm too large for an exact distribution, or a probability out of range.
    """

    def __init__(
        self,
        scenario: Scenario,
        plan: SwarmPlan,
        solver: Solver | None = None,
        min_probability: float = MIN_PROBABILITY,
    ) -> None:
        if plan.distribution is None:
            raise PolicyError(
                f"replanning needs the plan's exact distribution, which is available for at most "
                f"{MAX_EXACT} members; this swarm has {plan.n}: use the policy joint",
                policy="joint-replanning",
                members=plan.n,
            )
        if not 0 <= min_probability <= 1:
            raise PolicyError(
                f"min_probability = {shown(min_probability)}; allowed: from 0 to 1",
                policy="joint-replanning",
            )
        self.scenario, self.objective = scenario, plan.objective
        self.min_distance = plan.min_distance or 0.0
        self.solver = solver
        self.min_probability = min_probability
        self.delay = scenario.delay or 0  # no situation occurs if news never come
        self.branches: dict[Path, Branch] = {}
        self._failed: set[Path] = set()
        self._by_position: dict[tuple[int, int, bytes], list[Branch]] = {}
        members, paths = tuple(range(plan.n)), (plan.positions, plan.velocities)
        self._add(Branch((), 0, members, *paths, plan.initial_velocities, 1.0, plan.distribution))

    @property
    def solves(self) -> int:
        """Number of situations planned for so far."""
        return len(self.branches)

    @property
    def failures(self) -> int:
        """Number of situations whose solve failed."""
        return len(self._failed)

    def follow(
        self, step: int, members: Members, positions: FloatArray, previous_velocities: FloatArray
    ) -> tuple[FloatArray, bool, bool] | None:
        """Velocities (m, 2) at a step of those not known to be lost; None off all plans.

        `positions` and `previous_velocities` (m, 2) are their X(step), V(step-1). With the
        velocities comes whether a plan was made for this situation, and whether the solve for it
        failed, so that the survivors continue as before.
        """
        branch = self._find(step, members, positions, previous_velocities)
        if branch is None:
            return None
        planned = failed = False
        fewer = len(members) < len(branch.members)
        if fewer and branch.entering(step - self.delay, members).sum() >= self.min_probability:
            path = (*branch.path, (step, members))
            if path not in self.branches:
                self.branches[path] = self._plan(branch, path)
            branch, planned, failed = self.branches[path], True, path in self._failed
        velocities = branch.remaining(step, members)
        first = velocities[0] if len(velocities) else np.zeros((len(members), 2))
        return first, planned, failed

    def _find(
        self, step: int, members: Members, positions: FloatArray, previous_velocities: FloatArray
    ) -> Branch | None:
        """The plan whose trajectories lead through this state."""
        state = (positions, previous_velocities)
        for branch in self._by_position.get((step, members[0], positions[0].tobytes()), []):
            if set(members) <= set(branch.members) and all(
                map(np.array_equal, branch.state(step, members), state)
            ):
                return branch
        return None

    def _add(self, branch: Branch) -> None:
        """Register a plan under its positions, except those up to where it was made.

        There its members are still on the previous plan. Plans that share positions are ordered by
        path, whichever was made first.
        """
        for at in range(self.delay + 1 if branch.path else 0, len(branch.positions)):
            for member, position in zip(branch.members, branch.positions[at], strict=True):
                key = (branch.step + at, member, position.tobytes())
                branches = self._by_position.setdefault(key, [])
                branches.append(branch)
                branches.sort(key=lambda b: b.path)

    def _plan(self, branch: Branch, path: Path) -> Branch:
        """A plan for the survivors; the rest of the previous one if that is at least as good."""
        step, members = path[-1][0] - self.delay, path[-1][1]
        remaining = branch.remaining(step, members)
        counting = int(self.scenario.swarm.counting[list(members)].sum())
        if len(remaining) <= self.delay or counting < self.scenario.success.arrivals:
            return branch
        probabilities = branch.entering(step, members)
        scenario = self.scenario.with_prior(np.maximum(probabilities, _POSSIBLE))
        if scenario.swarm.kind is not None:
            scenario = scenario.of_members(members)
        start, initial_velocities = branch.state(step, members)
        steps = self.scenario.n_steps
        quarter = -(-steps // _HORIZONS)
        horizon = min(steps, quarter * -(-(steps - step) // quarter))
        task = JointTask.from_scenario(scenario, initial_velocities, self.min_distance)
        task = replace(task, start=start, steps=steps - step, known=self.delay)
        form = JointForm(len(members), horizon, True, self.objective, self.min_distance > 0)
        if any(case.scenario.hazard.changes for case in scenario.cases):
            form = replace(form, first=step)
        problem = JointProblem(scenario, task, form)
        arrivals = first_arrivals(scenario, problem.positions(remaining))
        solver = self.solver or stage_solver("auto", problem.hazards, form, ITERATIONS)
        (outcome,) = problem.solve([InitialGuess("survivors", arrivals, remaining)], solver)
        if not outcome.solution.status.success:
            self._failed.add(path)
        if not outcome.separated or outcome.value <= problem.value(remaining, arrivals):
            return branch
        positions = problem.positions(outcome.velocities)
        replanned = Branch(
            path,
            step,
            members,
            positions,
            outcome.velocities,
            initial_velocities,
            float(probabilities.sum()),
            plan_law(scenario, positions, step),
        )
        self._add(replanned)
        return replanned
