"""Joint plans of a scenario: solves from several initial guesses, the best of them continued."""

from __future__ import annotations

import math
import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from ..._util.text import did_you_mean
from ...errors import ScenarioError, SolverError
from ...optimization.solvers import Solver, make_solver
from ...problems.joint import OBJECTIVES, JointForm
from ...problems.joint_hessian import MAX_MEMBERS
from ...problems.joint_instances import JointTask
from ...typing import Progress
from ..bounds.success_bound import success_bound
from ..guide import Guide
from ..plan import initial_velocities, plan
from .distribution import PlanDistribution
from .initial_guesses import (
    INITIAL_GUESSES,
    OWN_GUIDES,
    InitialGuess,
    perturbed,
    single_agent_guide,
)
from .initial_guesses import initial_guesses as generate_guesses
from .plan import SwarmOutcome, SwarmPlan, least_distance
from .solve import MAX_EXACT, JointProblem, first_arrivals, newton, quasi_newton

if TYPE_CHECKING:
    from ...scenario import Scenario

MAX_EXACT_FIRST = 7
"""Maximum number of members of swarms whose first solves maximise the exact probability; those of
larger ones maximise the mean field's."""

N_PERTURBED = 2
"""Number of seeded perturbations of the best plan."""

FIRST_ITERATIONS, FINAL_ITERATIONS = 30, 200
"""Iterations of the first solves, and of those that continue the best of them."""

FIRST_ITERATIONS_MEAN_FIELD = 300
"""Iterations of the first solves of the mean field, which are cheap."""

MAX_CONTINUED = 2
"""Outcomes that are continued; only one if the first solves are of another program."""


def plan_swarm(
    scenario: Scenario,
    objective: str = "success",
    solver: str | Solver = "ipopt",
    *,
    initial_guesses: Sequence[str] = INITIAL_GUESSES,
    seed: int = 0,
    min_distance: float | None = None,
    time_limit: float | None = None,
    guide: Guide | None = None,
    solver_options: Mapping[str, Any] | None = None,
    progress: Progress | None = None,
) -> SwarmPlan:
    """Trajectories of all members that maximise the swarm's own probability of success.

    Parameters
    ----------
    scenario : Scenario
    objective : {"success", "arrivals", "survivors"}
        The probability that some member arrives alive by t_f, or the mean number of living members
        in the target, or alive anywhere, when the run ends: at the first arrival. With
        ``"arrivals"`` members stay outside the target until the common arrival step.
    solver : str or Solver
        By default Ipopt: with exact second derivatives for up to `MAX_MEMBERS` members, and with a
        limited-memory Hessian beyond.
    initial_guesses : sequence of str
        Of ``"formations"`` along a single agent's homotopy classes, ``"own"`` guides of the members
        (for swarms of at most 10), and ``"perturbed"``: random perturbations of the best plan.
    seed : int
        Of the perturbations.
    min_distance : float, optional
        Minimum distance of any two members at every step after the first.
    time_limit : float, optional
        Seconds after which no further solve starts. The result then depends on the machine.
    guide : Guide, optional
        Provides V(-1) if the scenario leaves that to the guide; planned from the scenario by
        default, so that every policy begins with the same velocity.
    solver_options : mapping, optional
        Options of the solver, if it is given by name; those of ``"ipopt"`` replace the settings
        chosen by the number of members.
    progress : Progress, optional
        Called before every solve.

    Returns
    -------
    SwarmPlan
        The best outcome of all starts by its exact value, whatever its solver's status, or by the
        mean field's with more than 10 members; among those that keep `min_distance`, if any do.

    Raises
    ------
    SolverError
        An unknown objective, kind of initial guess or solver.
    PlanningError
        No guide was found to provide V(-1).
    ScenarioError
        Members that are closer to each other than `min_distance` from the start.
    ValueError
        A distance or time limit out of range.
    """
    started = time.perf_counter()
    _require_known(objective, initial_guesses)
    _require_distance(scenario, min_distance)
    if time_limit is not None and not time_limit > 0:
        raise ValueError(f"time_limit = {time_limit!r}; allowed: seconds above 0")
    guide = plan(scenario, certify=False) if guide is None else guide
    search = _Search.from_scenario(
        scenario,
        JointTask.from_scenario(scenario, initial_velocities(scenario, guide), min_distance or 0.0),
        objective,
        _solvers(solver, scenario.n, solver_options),
        progress,
    )
    deadline = math.inf if time_limit is None else started + time_limit
    best = search.run(initial_guesses, seed, deadline)
    return search.result(best, time.perf_counter() - started, min_distance)


def _require_known(objective: str, kinds: Sequence[str]) -> None:
    if objective not in OBJECTIVES:
        hint = did_you_mean(objective, OBJECTIVES)
        raise SolverError(f"objective {objective!r} is unknown{hint}", objective=objective)
    if isinstance(kinds, str) or not kinds:
        allowed = ", ".join(INITIAL_GUESSES)
        raise SolverError(
            f"initial_guesses = {kinds!r}; expected a list of {allowed}", initial_guesses=kinds
        )
    for kind in kinds:
        if kind not in INITIAL_GUESSES:
            hint = did_you_mean(kind, INITIAL_GUESSES)
            raise SolverError(f"initial guess {kind!r} is unknown{hint}", initial_guesses=kinds)


def _require_distance(scenario: Scenario, min_distance: float | None) -> None:
    if min_distance is None:
        return
    if not 0 < min_distance < math.inf:
        raise ValueError(
            f"min_distance = {min_distance!r}; allowed: a finite number above 0, or None"
        )
    least = least_distance(scenario.positions[None])
    if least < min_distance:
        raise ScenarioError(
            f"min_distance = {min_distance!r}, but members start {least:g} apart; "
            "choose a smaller distance, or other initial positions (swarm.positions)",
            min_distance=min_distance,
            least_distance=least,
        )


def _solvers(
    solver: str | Solver, n: int, options: Mapping[str, Any] | None
) -> tuple[Solver, Solver]:
    """Solvers of the first solves, and of those that continue the best of them."""
    if solver != "ipopt" or options:
        backend = make_solver(solver, **dict(options or {}))
        return backend, backend
    if n <= MAX_MEMBERS:
        return newton(FIRST_ITERATIONS), newton(FINAL_ITERATIONS)
    first = FIRST_ITERATIONS if n <= MAX_EXACT_FIRST else FIRST_ITERATIONS_MEAN_FIELD
    return quasi_newton(first), quasi_newton(FINAL_ITERATIONS)


@dataclass
class _Search:
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
    ) -> _Search:
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
        for guess in generate_guesses(scenario, task, guide, own):
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

    def result(self, best: SwarmOutcome, seconds: float, min_distance: float | None) -> SwarmPlan:
        """The plan of the best outcome."""
        problem = self.problem
        scenario, task = problem.scenario, problem.task
        positions = problem.positions(best.velocities)
        exact = problem.form.exact
        return SwarmPlan(
            scenario=scenario.name,
            objective=problem.form.objective,
            positions=positions,
            velocities=best.velocities,
            initial_velocities=task.initial_velocities,
            motion=task.motion,
            arrivals=first_arrivals(scenario, positions),
            value=best.value,
            distribution=PlanDistribution.from_positions(scenario, positions) if exact else None,
            solution=best.solution,
            outcomes=tuple(self.outcomes),
            bound=success_bound(scenario),
            min_distance=min_distance,
            seconds=seconds,
        )
