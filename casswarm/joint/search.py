"""Multistart search for a joint plan: solves from several initial guesses, the best continued."""

from __future__ import annotations

import logging
import math
import time
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
from typing_extensions import Unpack

from .._util.numbers import require_seed
from .._util.progress import reporter
from .._util.settings import Execution, SavedKeywords, given_values
from .._util.text import did_you_mean, shown
from ..bounds.success_bound import success_bound
from ..errors import PlanningError, ScenarioError, SolverError
from ..guide.agent import initial_velocities
from ..guide.frame import Frame
from ..guide.guide import Guide
from ..guide.plan import plan
from ..motion.kinematics import integrate, interpolated
from ..motion.step import Motion
from ..problems.joint import OBJECTIVES, JointForm, JointTask
from ..scenario.cases import require_known
from ..scenario.members import with_accelerations
from ..scenario.scenario_files import require_scenario
from ..scenario.variations import require_default
from ..solvers import Solver, make_solver
from ..typing import FloatArray, Objective, Progress, Seed
from .initial_guesses import INITIAL_GUESSES, Guesses, InitialGuess, delayed, padded, track
from .plan_distribution import MAX_EXACT, MAX_MEMBERS, likely_sets, plan_law
from .solve import STAGED, JointProblem, first_arrivals, stage_solver
from .swarm_plan import SwarmOutcome, SwarmPlan, least_distance

if TYPE_CHECKING:
    from ..scenario import Scenario


LOG = logging.getLogger(__name__)

MANY, MOST_PLANNED = 50, 200
"""Numbers of members above which there is a warning of the time that a plan takes, and an error."""

COARSEST = 15
"""Number of steps of the coarsest search."""

MAX_REFINEMENT = 4
"""Maximum ratio of the numbers of steps of a search and of the coarser one before it."""

SAME = 0.15
"""Distance, in radii of the target, up to which trajectories count as the same."""


def coarsened(scenario: Scenario) -> Scenario | None:
    """The scenario with fewer steps in the same time of flight; None if it has few.

    The change of velocity per unit of time has the same limit.
    """
    steps = max(COARSEST, -(-scenario.n_steps // MAX_REFINEMENT))
    if scenario.n_steps < 2 * steps:
        return None
    ratio = scenario.n_steps / steps
    dt = scenario.time.dt * ratio
    values: dict[str, object] = {
        "time.dt": dt,
        "time.t_f": dt * (steps + 0.5),
        **with_accelerations(scenario.swarm, lambda a_max: a_max * ratio**2),
        "guide.a_max": scenario.guide_a_max * ratio**2,
    }
    return scenario.with_values(values)


def refined(outcome: SwarmOutcome, task: JointTask, coarse_steps: int) -> InitialGuess:
    """A guess for a task from an outcome with fewer steps: its velocities, interpolated in time."""
    ratio = task.steps / coarse_steps
    arrivals = np.ceil(outcome.arrivals * ratio - 1e-9).astype(int)
    velocities = np.concatenate([task.initial_velocities[None], outcome.velocities])
    last = int(arrivals.max()) if arrivals.all() else task.steps
    times = np.minimum((np.arange(last) + 0.5) / ratio + 0.5, len(velocities) - 1)
    return InitialGuess(outcome.start, arrivals, interpolated(velocities, times))


def distinct(
    task: JointTask, outcomes: Iterable[SwarmOutcome], known: Iterable[SwarmOutcome] = ()
) -> list[SwarmOutcome]:
    """The outcomes with trajectories that differ from those before them, and from known ones."""
    seen = [_whole(task, outcome.velocities) for outcome in known]
    found = []
    for outcome in outcomes:
        path = _whole(task, outcome.velocities)
        if all(abs(path - other).max() > SAME * task.radius for other in seen):
            seen.append(path)
            found.append(outcome)
    return found


def _whole(task: JointTask, velocities: FloatArray) -> FloatArray:
    """Positions (N+1, n, 2) of members that stop at the end."""
    return padded(integrate(task.start, velocities, task.motion.dt), task.steps)


def coarse_task(task: JointTask, scenario: Scenario) -> JointTask:
    """The task in a scenario with fewer steps."""
    coarse = JointTask.from_scenario(scenario, task.initial_velocities, task.min_distance)
    return replace(coarse, start=task.start)


ITERATIONS = 20, 25, 200
"""Iterations of the first solves, of those that continue the best of them, and of those to the end.
"""

FIRST_ITERATIONS_MEAN_FIELD = 300
"""Iterations of the first solves of the mean field, which are cheap."""

MAX_EXACT_FIRST = 8
"""Maximum number of members of swarms whose first solves maximise the exact probability; those of
larger ones maximise the mean field's."""

MAX_GUESSES, MAX_GUESSES_LARGE = 9, 6
"""First solves, of swarms of at most `MAX_EXACT_FIRST` members and of larger ones."""

N_WAVES, N_CHANGED, N_PERTURBED = 24, 8, 6
"""Number of random guesses, of changes of the best plan, and of random perturbations."""

MAX_WAVES, N_WAVES_LARGE = 6, 8
"""Number of members above which there are fewer random guesses, and their number then."""

ROUNDS = 2
"""Rounds of changes and perturbations; each only if the one before found a better plan."""

PROMISING = 0.2
"""Log-odds by which an unfinished solve may be worse than the best to be continued."""

IMPROVEMENT = 1e-6
"""Relative decrease of the cost that counts as a better plan: others are rounding."""

MAX_ADVANCED, MAX_CONTINUED, MAX_REFINED = 8, 2, 4
"""Outcomes that are solved further, and that are continued to the end; only one of those if the
first solves are of another program; and outcomes with coarse steps that are refined."""


class JointSearch:
    """The solves of one joint plan, of which none starts after the deadline (`perf_counter`).

    `solver` is one of `STAGED`, or the solver of all stages: the first solves, those that continue
    the best of them, and those to the end.
    """

    def __init__(
        self,
        scenario: Scenario,
        task: JointTask,
        objective: str,
        solver: str | Solver,
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
        first = ITERATIONS[0] if self.first_problem.form.exact else FIRST_ITERATIONS_MEAN_FIELD
        problems = self.first_problem, self.problem, self.problem
        self.solvers = [
            solver
            if isinstance(solver, Solver)
            else stage_solver(solver, problem.hazards, problem.form, iterations)
            for problem, iterations in zip(problems, (first, *ITERATIONS[1:]), strict=True)
        ]
        self.deadline, self.progress = deadline, progress
        self.guesses = Guesses(scenario, task, objective)
        coarse = coarsened(scenario)
        self.coarse = None
        if coarse is not None:
            arguments = objective, solver, deadline, progress
            self.coarse = JointSearch(coarse, coarse_task(task, coarse), *arguments)
        self.outcomes: list[SwarmOutcome] = []
        self._live: list[SwarmOutcome] = []  # those that no other continues

    def run(self, kinds: Sequence[str], seed: int) -> SwarmOutcome:
        """The best outcome of all starts, of which there is at least one."""
        rng = np.random.default_rng(seed)
        if self.coarse is None:
            self._solve(self._first(kinds, rng))
        else:
            self.coarse.run(kinds, seed)
            self._solve(self.coarse.refined(self.problem.task), 1)
        if self.same_program:
            self._advance()
        for outcome in self._promising(MAX_CONTINUED if self.same_program else 1):
            self._continue(outcome)
        if "perturbed" in kinds:
            self._perturb(rng)
        return self.best

    def _first(self, kinds: Sequence[str], rng: np.random.Generator) -> list[InitialGuess]:
        """The first guesses."""
        exact_first = self.problem.form.n <= MAX_EXACT_FIRST
        guesses = self.guesses.first(kinds, MAX_GUESSES if exact_first else MAX_GUESSES_LARGE)
        if "waves" in kinds and exact_first:
            few = self.problem.form.n > MAX_WAVES
            guesses += self.guesses.waves(N_WAVES_LARGE if few else N_WAVES, rng)
        return guesses

    def refined(self, task: JointTask) -> list[InitialGuess]:
        """Guesses for a task with more steps, from the best outcomes."""
        chosen = self._promising(MAX_REFINED)
        return [refined(outcome, task, self.problem.task.steps) for outcome in chosen]

    @property
    def best(self) -> SwarmOutcome:
        """The best by value among those that keep their distance; ties go to a solved one."""
        return max(self.outcomes, key=lambda o: (o.separated, o.value, o.solution.status.success))

    def _advance(self) -> None:
        """Solve the most promising of the first outcomes further."""
        unfinished = [o for o in self._promising(MAX_ADVANCED) if not o.solution.status.success]
        if not self._late:
            self._live = [outcome for outcome in self._live if outcome not in unfinished]
            self._solve([self.problem.restart(outcome) for outcome in unfinished], 1)

    def _promising(self, count: int) -> list[SwarmOutcome]:
        """The last outcomes of all starts with the best objectives, and the one of best value.

        An unfinished solve that does not yet reach the target in time has a low value, however
        good its objective; one that violates its constraints may be too good.
        """
        order = sorted(self._live, key=_merit)
        by_value = max(self._live, key=lambda o: (o.separated, o.value))
        chosen = distinct(self.problem.task, order)[:count]
        return chosen if by_value in chosen else [*chosen, by_value]

    @property
    def _late(self) -> bool:
        return time.perf_counter() > self.deadline

    def _perturb(self, rng: np.random.Generator) -> None:
        """Solve from changes and perturbations of the best outcome, while they improve it."""
        for _ in range(ROUNDS):
            best, plan = self.best, self.problem.restart(self.best)
            coarsest = self.coarse is None
            share = 1 if coarsest else 2  # coarse plans have been changed before
            guesses = [self.guesses.perturbed(plan, rng) for _ in range(N_PERTURBED // share)]
            if self.same_program:
                guesses += self.guesses.changed(plan, N_CHANGED // share, coarsest)
            self._attempt(guesses)
            if not self._improves(self.best, best):
                break

    def _improves(self, outcome: SwarmOutcome, best: SwarmOutcome) -> bool:
        """Return True if an outcome is better by more than rounding, or if only it is separated."""
        form = self.problem.form
        largest = 1.0 if form.objective == "success" else form.n
        least = IMPROVEMENT * (largest - best.value)
        return outcome.value > best.value + least or outcome.separated > best.separated

    def _attempt(self, guesses: Sequence[InitialGuess]) -> None:
        """Solve from guesses, and those further that promise to become the best."""
        if self._late:
            return
        best = self.best
        outcomes = self._solve(guesses)
        unfinished = [
            outcome
            for outcome in outcomes
            if outcome.value <= best.value
            and not outcome.solution.status.success
            and _merit(outcome) <= best.solution.objective + PROMISING
        ]
        if not self._late:
            unfinished = distinct(self.problem.task, unfinished, [best])
            outcomes += self._solve([self.problem.restart(outcome) for outcome in unfinished], 1)
        leading = max(outcomes, key=lambda outcome: outcome.value, default=best)
        if self._improves(leading, best):
            self._continue(leading)

    def _solve(self, guesses: Sequence[InitialGuess], stage: int = 0) -> list[SwarmOutcome]:
        """Solve from guesses, together unless the time is limited; the first at any rate."""
        problem = self.problem if stage else self.first_problem
        size = 1 if np.isfinite(self.deadline) else max(1, len(guesses))
        outcomes: list[SwarmOutcome] = []
        for first in range(0, len(guesses), size):
            if first and self._late:
                break
            part = guesses[first : first + size]
            if self.progress is not None:
                count = f"{len(part)} initial guesses"
                names = part[0].name if len(part) == 1 else count
                self.progress(f"optimising {names}", 0, None)
            outcomes += problem.solve(part, self.solvers[stage])
        self.outcomes += outcomes
        self._live += outcomes
        return outcomes

    def _continue(self, outcome: SwarmOutcome) -> None:
        """Solve from an outcome, with the arrival steps that it reaches, until both agree."""
        same_program = self.same_program
        for _ in range(3):
            guess = self.problem.restart(outcome)
            settled = same_program and np.array_equal(guess.arrivals, outcome.arrivals)
            if (settled and outcome.solution.status.success) or self._late:
                return
            (improved,) = self._solve([guess], 2)
            if settled and improved.value <= outcome.value:
                return
            outcome, same_program = improved, True


def _merit(outcome: SwarmOutcome) -> float:
    """Log-odds of an outcome's cost, with its violation as a penalty; the least is the best."""
    solution = outcome.solution
    merit = solution.objective + solution.residuals.violation
    return merit if np.isfinite(merit) else np.inf


def plan_swarm(
    scenario: Scenario,
    objective: Objective = "success",
    solver: str | Solver = "auto",
    *,
    initial_guesses: Sequence[str] = INITIAL_GUESSES,
    seed: Seed = 0,
    min_distance: float | None = None,
    guide: Guide | None = None,
    certify: bool = True,
    solver_options: Mapping[str, Any] | None = None,
    execution: Execution | None = None,
    **plain: Unpack[SavedKeywords],
) -> SwarmPlan:
    """Trajectories of all members that maximise the swarm's own probability of success.

    Parameters
    ----------
    scenario : Scenario
        Of a hazard that is not known, for the prior; see `plan_swarm_mixture` for others.
    objective : {"success", "arrivals", "survivors"}
        The probability that some member arrives alive by t_f, or the mean number of living members
        in the target, or alive anywhere, when the run ends: at the first arrival. With
        ``"arrivals"`` members stay outside the target until the common arrival step.
    solver : str or Solver
        By default casswarm's own interior-point method with exact second derivatives for up to 8
        members, if the rates are made of kernels, and else Ipopt: with exact second derivatives for
        up to 6 members, and with a limited-memory Hessian beyond.
    initial_guesses : sequence of str
        Of ``"formations"`` along a single agent's homotopy classes, ``"own"`` paths of the members
        (for swarms of at most 10), ``"waves"``: straight lines with random waves (for at most 8
        members), and ``"perturbed"``: changes and perturbations of the best plan.
        Those with the least exact cost are optimised, and the best of them to the end.
    seed : int
        Of the random waves and perturbations, from 0 to 2^64 - 1; all else is deterministic.
    min_distance : float, optional
        Minimum distance of any two members at every step after the first.
    guide : Guide, optional
        Provides V(-1) if the scenario leaves that to the guide; planned from the scenario by
        default, so that every policy begins with the same velocity.
    certify : bool
        Whether to compute `SwarmPlan.bound`, which takes up to some seconds.
    solver_options : mapping, optional
        Options of the solver, if it is given by name, with which it runs in all stages of the
        search; without them, ``"auto"`` and ``"ipopt"`` have settings for each stage.
    execution, **plain
        Values of `Execution`, in this record or as plain keywords: `time_limit`, seconds after
        which no further solve starts (the result then depends on the machine), and `progress`,
        which is called before every solve.

    Returns
    -------
    SwarmPlan
        The best outcome of all starts by its exact value, whatever its solver's status, or by the
        mean field's with more than 10 members; among those that keep `min_distance`, if any do.
        Its `success` has proven bounds; with more than 62 members it is None.

        It is planned in a `Frame` that the scenario's geometry defines: scenarios that differ by
        quarter turns and mirrors about the origin, and by the order of members, have the same plan.

    Raises
    ------
    SolverError
        An unknown objective, kind of initial guess or solver.
    PlanningError
        No guide was found to provide V(-1); more than 200 members.
    ScenarioError
        Members that are closer to each other than `min_distance` from the start.
    ValueError
        A distance, time limit or seed out of range.
    TypeError
        A value that is given plainly and in a record, or is none of these.
    """
    require_scenario("plan_swarm", scenario)
    _require_few(scenario)
    values = given_values("plan_swarm", execution, plain=plain, time_limit=None, progress=None)
    time_limit, progress = values
    started, seed, progress = time.perf_counter(), require_seed(seed), reporter(progress)
    _require_known(objective, initial_guesses)
    _require_distance(scenario, min_distance)
    if time_limit is not None and not time_limit > 0:
        raise ValueError(f"time_limit = {shown(time_limit)}; allowed: seconds above 0")
    guide = plan(scenario.believed, certify=False) if guide is None else guide
    # before the search, whose result it could cost
    bound = success_bound(scenario) if certify else None
    velocities = initial_velocities(scenario, guide)
    frame = Frame.of_scenario(scenario, velocities[0])
    framed = frame.scenario_in(scenario)
    task = JointTask.from_scenario(framed, frame.members_to(velocities), min_distance or 0.0)
    if solver not in STAGED or solver_options:
        solver = make_solver(solver, **dict(solver_options or {}))
    deadline = math.inf if time_limit is None else started + time_limit
    search = JointSearch(framed, task, objective, solver, deadline, frame.reported(progress))
    found = search.run(initial_guesses, seed)
    best = found.in_scenario(frame)
    positions = integrate(scenario.positions, best.velocities, scenario.time.dt)
    exact, likely = search.problem.form.exact, None
    if not exact and scenario.n <= MAX_MEMBERS:
        likely = likely_sets(framed, search.problem.positions(found.velocities))
    return SwarmPlan(
        scenario=scenario.name,
        objective=objective,
        positions=positions,
        velocities=best.velocities,
        initial_velocities=velocities,
        motion=Motion.from_scenario(scenario),
        arrivals=first_arrivals(scenario, positions),
        value=best.value,
        distribution=plan_law(scenario, positions) if exact else None,
        solution=best.solution,
        outcomes=tuple(outcome.in_scenario(frame) for outcome in search.outcomes),
        bound=bound,
        min_distance=min_distance,
        seconds=time.perf_counter() - started,
        likely=likely,
    )


def _require_known(objective: str, kinds: Sequence[str]) -> None:
    if objective not in OBJECTIVES:
        hint = did_you_mean(objective, OBJECTIVES)
        raise SolverError(f"objective {objective!r} is unknown{hint}", objective=objective)
    if isinstance(kinds, str) or not kinds:
        allowed = ", ".join(INITIAL_GUESSES)
        raise SolverError(
            f"initial_guesses = {shown(kinds)}; expected a list of {allowed}", initial_guesses=kinds
        )
    for kind in kinds:
        if kind not in INITIAL_GUESSES:
            hint = did_you_mean(kind, INITIAL_GUESSES)
            raise SolverError(f"initial guess {kind!r} is unknown{hint}", initial_guesses=kinds)


def _require_few(scenario: Scenario) -> None:
    if scenario.n > MOST_PLANNED:
        raise PlanningError(
            f"{scenario.name!r} has {scenario.n} members; joint plans are for at most "
            f"{MOST_PLANNED}: use the policies leader or constrained",
            members=scenario.n,
        )
    for key in ("time.substeps", "target.other", "swarm.speed"):
        require_default(scenario, key, "a joint plan")
    if scenario.n > MAX_EXACT:
        for key in ("success.arrivals", "swarm.kind"):
            require_default(scenario, key, f"a joint plan of more than {MAX_EXACT} members")
        require_known(scenario, f"a joint plan of more than {MAX_EXACT} members")
    if scenario.n > MANY:
        LOG.warning(
            "a joint plan of %d members takes minutes (50 take about 2, 100 about 8); time_limit "
            "ends the search after the solve that is then running",
            scenario.n,
        )


def _require_distance(scenario: Scenario, min_distance: float | None) -> None:
    if min_distance is None:
        return
    if not 0 < min_distance < math.inf:
        raise ValueError(
            f"min_distance = {shown(min_distance)}; allowed: a finite number above 0, or None"
        )
    least = least_distance(scenario.positions[None])
    if least < min_distance:
        raise ScenarioError(
            f"min_distance = {min_distance!r}, but members start {least:g} apart; "
            "choose a smaller distance, or other initial positions (swarm.positions)",
            min_distance=min_distance,
            least_distance=least,
        )


_ITERATIONS = 300


def alternative_plan(scenario: Scenario, plan: SwarmPlan, positions: FloatArray) -> SwarmPlan:
    """The better one of a plan for success and what a solve from other trajectories leads to.

    Parameters
    ----------
    scenario : Scenario
        Of few enough members for an exact distribution.
    plan : SwarmPlan
        For success.
    positions : (T+1, n, 2)
        Trajectories to track as closely as the limits allow, to their ends.

    Returns
    -------
    SwarmPlan
        Its outcomes include that of the solve, whichever plan is the better one.
    """
    task = JointTask.from_scenario(scenario, plan.initial_velocities)
    problem = JointProblem(scenario, task, JointForm(plan.n, task.steps, True, "success", False))
    goals = positions[1 + np.minimum(np.arange(task.steps), len(positions) - 2)]
    arrivals = first_arrivals(scenario, positions)
    arrivals = delayed(task, np.where(arrivals > 0, arrivals, task.steps)[None])[0]
    guess = InitialGuess("alternative", arrivals, track(task, goals))
    solver = stage_solver("auto", problem.hazards, problem.form, _ITERATIONS)
    (outcome,) = problem.solve([guess], solver)
    outcomes = *plan.outcomes, outcome
    if outcome.value <= plan.value:
        return replace(plan, outcomes=outcomes)
    trajectories = problem.positions(outcome.velocities)
    return replace(
        plan,
        positions=trajectories,
        velocities=outcome.velocities,
        arrivals=first_arrivals(scenario, trajectories),
        value=outcome.value,
        distribution=plan_law(scenario, trajectories),
        solution=outcome.solution,
        outcomes=outcomes,
    )
