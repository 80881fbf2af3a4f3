"""From a scenario to a joint plan: many starts, the best of them made better."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from ..._util.text import did_you_mean
from ...errors import ScenarioError, SolverError
from ...optimization.solvers import Solver, make_solver
from ...problems.formation import Motion
from ...problems.joint import OBJECTIVES, JointForm
from ...problems.joint_hessian import MAX_ITERATIONS
from ...problems.joint_instances import JointTask
from ...typing import FloatArray
from ..bounds.success_bound import success_bound
from ..guide import Guide
from ..plan import initial_velocities, plan
from .distribution import PlanDistribution
from .initial_guesses import SwarmStart, initial_plans, perturbed, single_agent_guide
from .plan import SwarmOutcome, SwarmPlan
from .solve import MAX_EXACT, JointProblem, first_steps, newton, quasi_newton

if TYPE_CHECKING:
    from ...scenario import Scenario

EXACT_STARTS = 7
"""Members up to which starts maximise the exact probability too; beyond, the mean field first."""

STARTS = ("formations", "own", "perturbed")
"""Kinds of starts."""

MARGIN = 1e-5
"""Of the radius: how deep in the target the members arrive, for what a solver leaves."""

PERTURBED = 2
"""Seeded perturbations of the best plan."""

FIRST, POLISHED = 30, 200
"""Iterations of a start, and of the best ones after it."""

FIRST_ROUGH, POLISHED_LARGE = 300, 200
"""The same where starts are solved by the mean field: those are cheap, the exact ones dear."""

BEST = 2
"""Outcomes that are made better; one in swarms of more than `EXACT_STARTS`."""


def plan_swarm(
    scenario: Scenario,
    objective: str = "success",
    solver: str | Solver = "ipopt",
    *,
    starts: Sequence[str] = STARTS,
    seed: int = 0,
    min_distance: float | None = None,
    time_limit: float | None = None,
    guide: Guide | None = None,
    progress: Callable[[str], None] | None = None,
) -> SwarmPlan:
    """Ways of all members that maximise the swarm's own probability of success.

    Parameters
    ----------
    scenario : Scenario
    objective : {"success", "arrivals", "survivors"}
        The probability that some member arrives alive by t_f, or the mean number of living members
        in the target, or alive anywhere, when the run ends: at the first arrival. With
        ``"arrivals"`` members stay out of the target until the common arrival step.
    solver : str or Solver
        By default Ipopt: with exact second derivatives for up to `MAX_ITERATIONS` members, and with a
        limited-memory Hessian beyond.
    starts : sequence of str
        Of ``"formations"`` along the ways of a lone agent, ``"own"`` guides of the members (in
        swarms of at most 10), and ``"perturbed"``: the best plan, disturbed at random.
    seed : int
        Of the perturbations.
    min_distance : float, optional
        Least distance of any two members at every step after the first.
    time_limit : float, optional
        Seconds after which no further start is tried. The answer then depends on the machine.
    guide : Guide, optional
        Gives V(-1) where the scenario leaves that to the guide; planned from the scenario by
        default, as everywhere, so that every policy begins with the same velocity.
    progress : callable, optional
        Called with the name of every start.

    Returns
    -------
    SwarmPlan
        The best outcome of all starts by its exact value, whatever its solver's status; with more
        than 10 members by the mean field's. Of outcomes that keep `min_distance` if any does.

    Raises
    ------
    SolverError
        An unknown objective, kind of start or solver.
    PlanningError
        No guide was found that would give V(-1).
    ScenarioError
        Members that are nearer to each other than `min_distance` from the start.
    ValueError
        A distance or time limit out of range.
    """
    started = time.perf_counter()
    _require_known(objective, starts)
    distance = _checked_distance(scenario, min_distance)
    if time_limit is not None and not time_limit > 0:
        raise ValueError(f"time_limit = {time_limit!r}; allowed: seconds above 0")
    guide = plan(scenario, certify=False) if guide is None else guide
    task = joint_task(scenario, initial_velocities(scenario, guide), distance)
    form = JointForm(scenario.n, scenario.n_steps, scenario.n <= MAX_EXACT, objective, distance > 0)
    rough = JointForm(
        scenario.n, scenario.n_steps, scenario.n <= EXACT_STARTS, objective, distance > 0
    )
    search = _Search(
        JointProblem(scenario, task, form),
        JointProblem(scenario, task, rough),
        _backends(solver, scenario.n),
        progress or (lambda _: None),
    )
    deadline = math.inf if time_limit is None else started + time_limit
    best = search.run(starts, seed, deadline)
    return search.result(best, time.perf_counter() - started, min_distance)


def joint_task(scenario: Scenario, before: FloatArray, distance: float = 0.0) -> JointTask:
    """What the members of a scenario are to do, from V(-1) `before` (n, 2)."""
    return JointTask(
        start=scenario.positions,
        before=before,
        center=np.asarray(scenario.target.center, float),
        radius=scenario.target.radius,
        margin=MARGIN * scenario.target.radius,
        v_max=scenario.swarm.v_max,
        a_max=scenario.swarm.a_max,
        dt=scenario.time.dt,
        steps=scenario.n_steps,
        distance=distance,
    )


def _require_known(objective: str, starts: Sequence[str]) -> None:
    if objective not in OBJECTIVES:
        raise SolverError(
            f"objective {objective!r} is unknown{did_you_mean(objective, OBJECTIVES)}"
        )
    if isinstance(starts, str) or not starts:
        raise SolverError(f"starts = {starts!r}; expected a list of {', '.join(STARTS)}")
    for kind in starts:
        if kind not in STARTS:
            raise SolverError(f"kind of start {kind!r} is unknown{did_you_mean(kind, STARTS)}")


def _checked_distance(scenario: Scenario, given: float | None) -> float:
    if given is None:
        return 0.0
    if not 0 < given < math.inf:
        raise ValueError(f"min_distance = {given!r}; allowed: a finite number above 0, or None")
    i, j = np.triu_indices(scenario.n, 1)
    apart = np.hypot(*(scenario.positions[i] - scenario.positions[j]).T)
    if apart.size and apart.min() < given:
        raise ScenarioError(
            f"min_distance = {given!r}, but members start {apart.min():g} apart; "
            "give less, or place them further apart (swarm.positions)"
        )
    return given


def _backends(solver: str | Solver, n: int) -> tuple[Solver, Solver]:
    """What solves starts, and what makes the best of them better."""
    if solver != "ipopt":
        backend = make_solver(solver)
        return backend, backend
    if n <= MAX_ITERATIONS:
        return newton(FIRST), newton(POLISHED)
    if n <= EXACT_STARTS or n > MAX_EXACT:
        return quasi_newton(FIRST if n <= EXACT_STARTS else FIRST_ROUGH), quasi_newton(POLISHED)
    return quasi_newton(FIRST_ROUGH), quasi_newton(POLISHED_LARGE)


@dataclass
class _Search:
    """The solves of one joint plan.

    Parameters
    ----------
    problem, rough : JointProblem
        The problem, and the one that starts are solved with: in larger swarms by the mean field.
    solvers : pair of Solver
        For starts, and to make the best better.
    progress : callable
    """

    problem: JointProblem
    rough: JointProblem
    solvers: tuple[Solver, Solver]
    progress: Callable[[str], None]
    outcomes: list[SwarmOutcome] = field(default_factory=list)

    def run(self, kinds: Sequence[str], seed: int, deadline: float) -> SwarmOutcome:
        """The best outcome of all starts; always one at least."""
        for start in self._initial(kinds):
            self._solved(start)
            if time.perf_counter() > deadline:
                return self.best
        for outcome in self._promising():
            self._polish(outcome, deadline)
        if "perturbed" in kinds:
            rng = np.random.default_rng(seed)
            for _ in range(PERTURBED):
                if time.perf_counter() > deadline:
                    break
                best = self.best
                start = perturbed(self.problem.again(best), self.problem.task, rng)
                found = self._solved(start)
                if found.value > best.value:
                    self._polish(found, deadline)
        return self.best

    @property
    def best(self) -> SwarmOutcome:
        """By value, of those that keep their distance; a solved one before its equals."""
        return max(self.outcomes, key=lambda o: (o.apart, o.value, o.solution.status.success))

    def _promising(self) -> list[SwarmOutcome]:
        """The best outcomes, and the one of the best objective: it may still be on its way.

        What has not yet come to the target in time is worth little, however good the way.
        """
        order = sorted(self.outcomes, key=lambda o: (not o.apart, -o.value))
        chosen = order[: BEST if self.problem.form == self.rough.form else 1]
        hopeful = min(self.outcomes, key=lambda o: np.nan_to_num(o.solution.objective, nan=np.inf))
        return chosen if hopeful in chosen else [*chosen, hopeful]

    def _initial(self, kinds: Sequence[str]) -> Iterator[SwarmStart]:
        scenario, task = self.problem.scenario, self.problem.task
        guide = single_agent_guide(scenario, task.before[0])
        own = "own" in kinds and scenario.n <= MAX_EXACT
        for start in initial_plans(scenario, task, guide, own):
            if start.origin == "own guides" or "formations" in kinds or not own:
                yield start

    def _solved(self, start: SwarmStart, polish: bool = False) -> SwarmOutcome:
        self.progress(start.origin)
        problem = self.problem if polish else self.rough
        self.outcomes.append(problem.solved(start, self.solvers[polish]))
        return self.outcomes[-1]

    def _polish(self, outcome: SwarmOutcome, deadline: float) -> None:
        """Solve on from an outcome, with the arrival steps that it has, until both agree."""
        exact = self.problem.form == self.rough.form
        for _ in range(3):
            again = self.problem.again(outcome)
            settled = exact and np.array_equal(again.arrivals, outcome.arrivals)
            if (settled and outcome.solution.status.success) or time.perf_counter() > deadline:
                return
            found = self._solved(again, polish=True)
            if settled and found.value <= outcome.value:
                return
            outcome, exact = found, True

    def result(self, best: SwarmOutcome, seconds: float, min_distance: float | None) -> SwarmPlan:
        """The plan of the best outcome."""
        problem = self.problem
        scenario, positions = problem.scenario, problem.positions(best.velocities)
        return SwarmPlan(
            scenario=scenario.name,
            objective=problem.form.objective,
            positions=positions,
            velocities=best.velocities,
            before=problem.task.before,
            motion=Motion.from_scenario(scenario),
            arrivals=first_steps(scenario, positions),
            value=best.value,
            law=PlanDistribution.of(scenario, positions) if problem.form.exact else None,
            solution=best.solution,
            outcomes=tuple(self.outcomes),
            bound=success_bound(scenario),
            min_distance=min_distance,
            seconds=seconds,
        )
