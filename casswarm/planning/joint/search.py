"""Multistart search for a joint plan: solves from several initial guesses, the best continued."""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from ...optimization.solvers import Solver
from ...problems.joint import JointForm
from ...problems.joint_instances import JointTask
from ...typing import Progress
from .initial_guesses import (
    OWN_GUIDES,
    InitialGuess,
    initial_guesses,
    perturbed,
    single_agent_guide,
)
from .plan import SwarmOutcome
from .solve import MAX_EXACT, JointProblem

if TYPE_CHECKING:
    from ...scenario import Scenario

MAX_EXACT_FIRST = 7
"""Maximum number of members of swarms whose first solves maximise the exact probability; those of
larger ones maximise the mean field's."""

N_PERTURBED = 2
"""Number of seeded perturbations of the best plan."""

MAX_CONTINUED = 2
"""Outcomes that are continued; only one if the first solves are of another program."""


@dataclass
class JointSearch:
    """The solves of one joint plan.

    Parameters
    ----------
    problem, first_problem : JointProblem
        The problem, and that of the first solves: the mean field's for larger swarms.
    solvers : pair of Solver
        Of the first solves, and of those that continue the best of them.
    progress : Progress, optional
    """

    problem: JointProblem
    first_problem: JointProblem
    solvers: tuple[Solver, Solver]
    progress: Progress | None
    outcomes: list[SwarmOutcome] = field(default_factory=list)

    @classmethod
    def from_scenario(
        cls,
        scenario: Scenario,
        task: JointTask,
        objective: str,
        solvers: tuple[Solver, Solver],
        progress: Progress | None,
    ) -> JointSearch:
        """Search for the plan of a task that is optimal for `objective`."""
        n, steps = scenario.n, scenario.n_steps
        problem, first_problem = (
            JointProblem(
                scenario,
                task,
                JointForm(n, steps, n <= max_exact, objective, task.min_distance > 0),
            )
            for max_exact in (MAX_EXACT, MAX_EXACT_FIRST)
        )
        return cls(problem, first_problem, solvers, progress)

    def run(self, kinds: Sequence[str], seed: int, deadline: float) -> SwarmOutcome:
        """The best outcome of all starts, of which there is at least one."""
        for guess in self._initial_guesses(kinds):
            self._solve(guess)
            if time.perf_counter() > deadline:
                return self.best
        for outcome in self._promising():
            self._continue(outcome, deadline)
        if "perturbed" in kinds:
            self._perturb(seed, deadline)
        return self.best

    @property
    def best(self) -> SwarmOutcome:
        """The best by value among those that keep their distance; ties go to a solved one."""
        return max(self.outcomes, key=lambda o: (o.separated, o.value, o.solution.status.success))

    def _promising(self) -> list[SwarmOutcome]:
        """The outcomes of best value, and the one of best objective if it is another.

        An unfinished solve that does not yet reach the target in time has a low value, however
        good its objective.
        """
        order = sorted(self.outcomes, key=lambda o: (not o.separated, -o.value))
        chosen = order[: MAX_CONTINUED if self._same_program else 1]
        by_objective = min(
            self.outcomes, key=lambda o: np.nan_to_num(o.solution.objective, nan=np.inf)
        )
        return chosen if by_objective in chosen else [*chosen, by_objective]

    @property
    def _same_program(self) -> bool:
        """Whether the first solves are of the problem itself."""
        return self.problem.form == self.first_problem.form

    def _initial_guesses(self, kinds: Sequence[str]) -> Iterator[InitialGuess]:
        scenario, task = self.problem.scenario, self.problem.task
        guide = single_agent_guide(scenario, task.initial_velocities[0])
        own = "own" in kinds and scenario.n <= MAX_EXACT
        for guess in initial_guesses(scenario, task, guide, own):
            if guess.name == OWN_GUIDES or "formations" in kinds or not own:
                yield guess

    def _perturb(self, seed: int, deadline: float) -> None:
        """Solve from seeded perturbations of the best outcome, and continue improvements."""
        rng = np.random.default_rng(seed)
        for _ in range(N_PERTURBED):
            if time.perf_counter() > deadline:
                return
            best = self.best
            outcome = self._solve(perturbed(self.problem.restart(best), self.problem.task, rng))
            if outcome.value > best.value:
                self._continue(outcome, deadline)

    def _solve(self, guess: InitialGuess, final: bool = False) -> SwarmOutcome:
        if self.progress is not None:
            self.progress(f"optimizing {guess.name}", 0, None)
        problem = self.problem if final else self.first_problem
        self.outcomes.append(problem.solve(guess, self.solvers[final]))
        return self.outcomes[-1]

    def _continue(self, outcome: SwarmOutcome, deadline: float) -> None:
        """Solve from an outcome, with the arrival steps that it reaches, until both agree."""
        same_program = self._same_program
        for _ in range(3):
            guess = self.problem.restart(outcome)
            settled = same_program and np.array_equal(guess.arrivals, outcome.arrivals)
            if (settled and outcome.solution.status.success) or time.perf_counter() > deadline:
                return
            improved = self._solve(guess, final=True)
            if settled and improved.value <= outcome.value:
                return
            outcome, same_program = improved, True
