"""Planning again for the survivors: a tree of joint plans, grown as losses happen.

A run follows the root, the joint plan of everybody, until members are lost. Let exactly the members
d be left at step t on the ways of a plan P that was made for more. In this situation, (P, t, d), a
new plan for d alone is solved from there, started from what is left of P's ways, and taken where it
is worth more, by its exact law. Whatever happens later, the survivors can still follow their plan
to its end: by induction over the tree, to follow it with feedback succeeds at least as often as to
follow the root blindly.

Each situation is solved once. What may be solved is decided by the situation alone, so that the
answer does not depend on which runs come first: the probability, along the plans that led there,
that a run enters it straight from P's members all being alive must be at least `least_mass`. These
events exclude each other, so in each generation at most 1 / least_mass plans are made.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, TypeAlias

import numpy as np

from ...errors import PolicyError
from ...optimization.solvers import Solver
from ...problems.joint import JointForm
from ...problems.joint_hessian import MAX_ITERATIONS
from ...problems.joint_instances import JointTask
from ...typing import FloatArray
from .distribution import PlanDistribution
from .initial_guesses import SwarmStart
from .optimize import joint_task
from .plan import SwarmPlan
from .solve import MAX_EXACT, JointProblem, first_steps, newton, quasi_newton

if TYPE_CHECKING:
    from ...scenario import Scenario

LEAST_MASS = 1e-3
"""Probability of a situation from which on it is planned for."""

ITERATIONS = 60
"""Of a plan for survivors, which starts near its end."""

_PARTS = 4  # horizons of programs: quarters of the steps, so that few programs are built

Members: TypeAlias = tuple[int, ...]
"""Indices of the living, ascending."""


@dataclass(frozen=True, eq=False)
class Branch:
    """A plan of the tree.

    Parameters
    ----------
    path : tuple of (step, members)
        Of the situations that led here; empty for the root.
    step : int
        At which it begins.
    members : tuple of int
        For whom it is.
    positions, velocities : (T+1, m, 2), (T, m, 2)
        Of its members, from `step` on.
    before : (m, 2)
        Their velocities before it.
    mass : float
        Probability of the situation in which it was made, by the laws of the plans before.
    law : PlanDistribution
    """

    path: tuple[tuple[int, Members], ...]
    step: int
    members: Members
    positions: FloatArray
    velocities: FloatArray
    before: FloatArray
    mass: float
    law: PlanDistribution

    def places(self, step: int, members: Members) -> tuple[FloatArray, FloatArray]:
        """X(step), V(step-1) of some of its members, (m, 2) each."""
        rows, at = self._rows(members), step - self.step
        previous_velocities = self.velocities[at - 1] if at else self.before
        return self.positions[at][rows], previous_velocities[rows]

    def way(self, step: int, members: Members) -> FloatArray:
        """Velocities (T', m, 2) of some of its members from a step on."""
        return self.velocities[step - self.step :][:, self._rows(members)]

    def entering(self, step: int, members: Members) -> float:
        """Probability that a run is with all its members before a step and with these after it."""
        at = step - self.step - 1
        if not 0 <= at < len(self.law.lost):
            return 0.0
        lost = self.law.lost[at][-1]
        stays = np.isin(self.members, members)
        return float(self.mass * self.law.masses[at, -1] * np.where(stays, 1 - lost, lost).prod())

    def _rows(self, members: Members) -> list[int]:
        return [self.members.index(member) for member in members]


@dataclass
class PlanTree:
    """The plans made so far; grows as it is asked.

    Parameters
    ----------
    scenario : Scenario
    solver : Solver
    least_mass : float
    root : Branch
    objective : str
        Of the joint plan, and so of those for survivors.
    distance : float
        That members keep; 0 where none was asked for.
    solves, failures : int
        Situations that were planned for so far, and those whose solve failed.
    """

    scenario: Scenario
    solver: Solver
    least_mass: float
    root: Branch
    objective: str = "success"
    distance: float = 0.0
    branches: dict[tuple[tuple[int, Members], ...], Branch] = field(default_factory=dict)
    solves: int = 0
    failures: int = 0
    _places: dict[tuple[int, int, bytes], list[Branch]] = field(default_factory=dict)
    _failed: set[tuple[tuple[int, Members], ...]] = field(default_factory=set)

    @classmethod
    def of(
        cls,
        scenario: Scenario,
        plan: SwarmPlan,
        solver: Solver | None = None,
        least_mass: float = LEAST_MASS,
    ) -> PlanTree:
        """A tree with a joint plan for its root.

        Raises
        ------
        PolicyError
            A swarm too large for an exact law, or a mass out of range.
        """
        law, everybody = plan.law, tuple(range(plan.n))
        if law is None:
            raise PolicyError(
                f"planning again needs the plan's exact law, which is known for at most "
                f"{MAX_EXACT} members; this swarm has {plan.n}: use the policy joint"
            )
        if not 0 <= least_mass <= 1:
            raise PolicyError(f"least_mass = {least_mass!r}; allowed: from 0 to 1")
        root = Branch((), 0, everybody, plan.positions, plan.velocities, plan.before, 1.0, law)
        tree = cls(
            scenario,
            solver or (newton if plan.n <= MAX_ITERATIONS else quasi_newton)(ITERATIONS),
            least_mass,
            root,
            plan.objective,
            plan.min_distance or 0.0,
        )
        tree._add(root)
        return tree

    def follow(
        self, step: int, members: Members, positions: FloatArray, previous_velocities: FloatArray
    ) -> tuple[FloatArray, bool, bool] | None:
        """What the living do at a step.

        Parameters
        ----------
        step : int
        members : tuple of int
            The living.
        positions, previous_velocities : (m, 2)
            Their X(step), V(step-1).

        Returns
        -------
        velocities : (m, 2)
        planned : bool
            Whether this situation was planned for anew.
        failed : bool
            Whether the solve for it failed, so that the survivors go on as before.

        None where no plan has the members at these places.
        """
        branch = self._found(step, members, positions, previous_velocities)
        if branch is None:
            return None
        planned = failed = False
        fewer = len(members) < len(branch.members)
        if fewer and branch.entering(step, members) >= self.least_mass:
            key = (*branch.path, (step, members))
            if key not in self.branches:
                self.branches[key] = self._planned(branch, step, members, key)
            branch, planned, failed = self.branches[key], True, key in self._failed
        way = branch.way(step, members)
        return (way[0] if len(way) else np.zeros((len(members), 2))), planned, failed

    def _found(
        self, step: int, members: Members, positions: FloatArray, previous_velocities: FloatArray
    ) -> Branch | None:
        """The plan whose way leads through these places."""
        first = self._places.get((step, members[0], positions[0].tobytes()), [])
        for branch in first:
            if not set(members) <= set(branch.members):
                continue
            places, velocities = branch.places(step, members)
            if np.array_equal(places, positions) and np.array_equal(
                velocities, previous_velocities
            ):
                return branch
        return None

    def _add(self, branch: Branch) -> None:
        """Make a plan known by the places that it leads through, those where it begins left out.

        There its members are still on the plan before. Of plans that share a way the first by
        path comes first, whichever was made first.
        """
        for at in range(1 if branch.path else 0, len(branch.positions)):
            for member, place in zip(branch.members, branch.positions[at], strict=True):
                known = self._places.setdefault((branch.step + at, member, place.tobytes()), [])
                known.append(branch)
                known.sort(key=lambda b: b.path)

    def _planned(
        self, branch: Branch, step: int, members: Members, key: tuple[tuple[int, Members], ...]
    ) -> Branch:
        """A plan for the survivors; what is left of the one before where none is better."""
        mass = branch.entering(step, members)
        start, before = branch.places(step, members)
        problem = JointProblem(self.scenario, *self._task(step, start, before))
        rest = branch.way(step, members)
        real = first_steps(self.scenario, problem.positions(rest))
        found = problem.solved(SwarmStart("survivors", real, rest), self.solver)
        self.solves += 1
        if not found.solution.status.success:
            self.failures += 1
            self._failed.add(key)
        if not found.apart or found.value <= problem.value(rest, real):
            return branch
        positions = problem.positions(found.velocities)
        law = PlanDistribution.of(self.scenario, positions)
        made = Branch(key, step, members, positions, found.velocities, before, mass, law)
        self._add(made)
        return made

    def _task(
        self, step: int, start: FloatArray, before: FloatArray
    ) -> tuple[JointTask, JointForm]:
        steps = self.scenario.n_steps
        quarter = -(-steps // _PARTS)
        horizon = min(steps, quarter * -(-(steps - step) // quarter))
        task = replace(
            joint_task(self.scenario, before, self.distance), start=start, steps=steps - step
        )
        return task, JointForm(len(start), horizon, True, self.objective, self.distance > 0)
