"""Multistart search for a joint plan: solves from several initial guesses, the best continued."""

from __future__ import annotations

import time
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from ...optimization.solvers import Solver
from ...problems.joint import JointForm
from ...problems.joint_instances import JointTask
from ...typing import Progress
from .distribution import MAX_EXACT
from .initial_guesses import InitialGuess, initial_guesses, perturbed
from .plan import SwarmOutcome
from .solve import JointProblem

if TYPE_CHECKING:
    from ...scenario import Scenario

MAX_EXACT_FIRST = 7
"""Maximum number of members of swarms whose first solves maximise the exact probability; those of
larger ones maximise the mean field's."""

N_PERTURBED = 2
"""Number of seeded perturbations of the best plan."""

MAX_CONTINUED = 2
"""Outcomes that are continued; only one if the first solves are of another program."""


class JointSearch:
    """The solves of one joint plan.

    Parameters
    ----------
    scenario : Scenario
    task : JointTask
    objective : str
    solvers : pair of Solver
        Of the first solves, and of those that continue the best of them.
    deadline : float
        Of `time.perf_counter`; no solve starts after it.
    progress : Progress, optional
    """

    def __init__(
        self,
        scenario: Scenario,
        task: JointTask,
        objective: str,
        solvers: tuple[Solver, Solver],
        deadline: float,
        progress: Progress | None,
    ) -> None:
        n, steps, separated = scenario.n, scenario.n_steps, task.min_distance > 0
        self.problem, self.first_problem = (
            JointProblem(scenario, task, JointForm(n, steps, n <= limit, objective, separated))
            for limit in (MAX_EXACT, MAX_EXACT_FIRST)
        )
        # whether the first solves are of the problem itself
        self.same_program = self.problem.form == self.first_problem.form
        self.solvers, self.deadline, self.progress = solvers, deadline, progress
        self.outcomes: list[SwarmOutcome] = []

    def run(self, kinds: Sequence[str], seed: int) -> SwarmOutcome:
        """The best outcome of all starts, of which there is at least one."""
        for guess in initial_guesses(self.problem.scenario, self.problem.task, kinds):
            self._solve(guess)
            if self._late:
                return self.best
        for outcome in self._promising():
            self._continue(outcome)
        if "perturbed" in kinds:
            self._perturb(seed)
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
        chosen = order[: MAX_CONTINUED if self.same_program else 1]
        by_objective = min(
            self.outcomes, key=lambda o: np.nan_to_num(o.solution.objective, nan=np.inf)
        )
        return chosen if by_objective in chosen else [*chosen, by_objective]

    @property
    def _late(self) -> bool:
        return time.perf_counter() > self.deadline

    def _perturb(self, seed: int) -> None:
        """Solve from seeded perturbations of the best outcome, and continue improvements."""
        rng = np.random.default_rng(seed)
        for _ in range(N_PERTURBED):
            if self._late:
                return
            best = self.best
            outcome = self._solve(perturbed(self.problem.restart(best), self.problem.task, rng))
            if outcome.value > best.value:
                self._continue(outcome)

    def _solve(self, guess: InitialGuess, final: bool = False) -> SwarmOutcome:
        if self.progress is not None:
            self.progress(f"optimizing {guess.name}", 0, None)
        problem = self.problem if final else self.first_problem
        self.outcomes.append(problem.solve(guess, self.solvers[final]))
        return self.outcomes[-1]

    def _continue(self, outcome: SwarmOutcome) -> None:
        """Solve from an outcome, with the arrival steps that it reaches, until both agree."""
        same_program = self.same_program
        for _ in range(3):
            guess = self.problem.restart(outcome)
            settled = same_program and np.array_equal(guess.arrivals, outcome.arrivals)
            if (settled and outcome.solution.status.success) or self._late:
                return
            improved = self._solve(guess, final=True)
            if settled and improved.value <= outcome.value:
                return
            outcome, same_program = improved, True
