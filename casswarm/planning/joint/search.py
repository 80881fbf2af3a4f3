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
from .initial_guesses import Guesses
from .plan import SwarmOutcome
from .screening import InitialGuess
from .solve import JointProblem

if TYPE_CHECKING:
    from ...scenario import Scenario

MAX_EXACT_FIRST = 7
"""Maximum number of members of swarms whose first solves maximise the exact probability; those of
larger ones maximise the mean field's."""

MAX_GUESSES, MAX_GUESSES_LARGE = 9, 6
"""First solves, of swarms of at most `MAX_EXACT_FIRST` members and of larger ones."""

N_CHANGED, N_PERTURBED = 3, 1
"""Number of changes of the best plan, and of seeded perturbations."""

ROUNDS = 2
"""Rounds of changes; the second only if the first found a better plan."""

PROMISING = 0.2
"""Log-odds by which an unfinished solve may be worse than the best to be continued."""

MAX_ADVANCED, MAX_CONTINUED = 4, 2
"""Outcomes that are solved further, and that are continued to the end; only one of those if the
first solves are of another program."""


class JointSearch:
    """The solves of one joint plan.

    Parameters
    ----------
    scenario : Scenario
    task : JointTask
    objective : str
    solvers : three of Solver
        Of the first solves, of those that continue the best of them, and of those to the end.
    deadline : float
        Of `time.perf_counter`; no solve starts after it.
    progress : Progress, optional
    """

    def __init__(
        self,
        scenario: Scenario,
        task: JointTask,
        objective: str,
        solvers: tuple[Solver, Solver, Solver],
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
        self.guesses = Guesses(scenario, task, objective)
        self.outcomes: list[SwarmOutcome] = []
        self._live: list[SwarmOutcome] = []  # those that no other continues

    def run(self, kinds: Sequence[str], seed: int) -> SwarmOutcome:
        """The best outcome of all starts, of which there is at least one."""
        exact_first = self.problem.form.n <= MAX_EXACT_FIRST
        for guess in self.guesses.first(kinds, MAX_GUESSES if exact_first else MAX_GUESSES_LARGE):
            self._solve(guess)
            if self._late:
                return self.best
        if self.same_program:
            self._advance()
        for outcome in self._promising(MAX_CONTINUED if self.same_program else 1):
            self._continue(outcome)
        if "perturbed" in kinds:
            self._perturb(seed)
        return self.best

    @property
    def best(self) -> SwarmOutcome:
        """The best by value among those that keep their distance; ties go to a solved one."""
        return max(self.outcomes, key=lambda o: (o.separated, o.value, o.solution.status.success))

    def _advance(self) -> None:
        """Solve the most promising of the first outcomes further."""
        for outcome in self._promising(MAX_ADVANCED):
            if self._late:
                return
            if not outcome.solution.status.success:
                self._live.remove(outcome)
                self._solve(self.problem.restart(outcome), 1)

    def _promising(self, count: int) -> list[SwarmOutcome]:
        """The last outcomes of all starts with the best objectives, and the one of best value.

        An unfinished solve that does not yet reach the target in time has a low value, however
        good its objective; one that violates its constraints may be too good.
        """
        order = sorted(self._live, key=_merit)
        by_value = max(self._live, key=lambda o: (o.separated, o.value))
        chosen = order[:count]
        return chosen if by_value in chosen else [*chosen, by_value]

    @property
    def _late(self) -> bool:
        return time.perf_counter() > self.deadline

    def _perturb(self, seed: int) -> None:
        """Solve from changes and seeded perturbations of the best outcome."""
        if self.same_program:
            for _ in range(ROUNDS):
                best = self.best
                for guess in self.guesses.changed(self.problem.restart(best), N_CHANGED):
                    self._attempt(guess)
                if self.best is best:
                    break
        rng = np.random.default_rng(seed)
        for _ in range(N_PERTURBED):
            self._attempt(self.guesses.perturbed(self.problem.restart(self.best), rng))

    def _attempt(self, guess: InitialGuess) -> None:
        """Solve from a guess, and further while it promises to become the best."""
        if self._late:
            return
        best = self.best
        outcome = self._solve(guess)
        if outcome.value <= best.value and not outcome.solution.status.success:
            if self._late or _merit(outcome) > best.solution.objective + PROMISING:
                return
            outcome = self._solve(self.problem.restart(outcome), 1)
        if outcome.value > best.value:
            self._continue(outcome)

    def _solve(self, guess: InitialGuess, stage: int = 0) -> SwarmOutcome:
        if self.progress is not None:
            self.progress(f"optimizing {guess.name}", 0, None)
        problem = self.problem if stage else self.first_problem
        outcome = problem.solve(guess, self.solvers[stage])
        self.outcomes.append(outcome)
        self._live.append(outcome)
        return outcome

    def _continue(self, outcome: SwarmOutcome) -> None:
        """Solve from an outcome, with the arrival steps that it reaches, until both agree."""
        same_program = self.same_program
        for _ in range(3):
            guess = self.problem.restart(outcome)
            settled = same_program and np.array_equal(guess.arrivals, outcome.arrivals)
            if (settled and outcome.solution.status.success) or self._late:
                return
            improved = self._solve(guess, 2)
            if settled and improved.value <= outcome.value:
                return
            outcome, same_program = improved, True


def _merit(outcome: SwarmOutcome) -> float:
    """Log-odds of an outcome's cost, with its violation as a penalty; the least is the best."""
    solution = outcome.solution
    merit = solution.objective + solution.residuals.violation
    return merit if np.isfinite(merit) else np.inf
