"""From a scenario to a joint plan: many starts, the best of them made better."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

import numpy as np

from ..arrays import Counts, Floats
from ..certificate.success import success_bound
from ..errors import ScenarioError, SolverError, among
from ..guide import Guide
from ..nlp import Nlp
from ..planning import initial_velocities, plan
from ..problems.formation import motion_of
from ..problems.joint import OBJECTIVES, JointForm, JointTask, joint_instance, joint_nlp
from ..solvers import Ipopt, Solver, make_solver
from .law import PlanLaw
from .plan import SwarmOutcome, SwarmPlan
from .starts import SwarmStart, follow, initial_plans, lone_guide, perturbed

if TYPE_CHECKING:
    from ..scenario import Scenario

MOST_EXACT = 10
"""Members up to which plans maximise the exact probability; beyond, the mean field."""

STARTS = ("formations", "own", "perturbed")
"""Kinds of starts."""

MARGIN = 1e-5
"""Of the radius: how deep in the target the members arrive, for what a solver leaves."""

PERTURBED = 2
"""Seeded perturbations of the best plan."""

FIRST, POLISHED = 100, 500
"""Iterations of a start, and of the best ones after it."""

TOLERANCE = 1e-5
"""Ipopt's, of log-odds: a relative difference in the probability of failure."""

BEST = 2
"""Outcomes that are made better."""


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
        By default Ipopt, with a limited-memory Hessian: an exact one takes longer than all else.
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
        than 10 members by the mean field's.

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
    form = JointForm(
        scenario.n, scenario.n_steps, scenario.n <= MOST_EXACT, objective, distance > 0
    )
    search = _Search(scenario, task, form, _backends(solver), progress or (lambda _: None))
    deadline = math.inf if time_limit is None else started + time_limit
    best = search.run(starts, seed, deadline)
    return search.result(best, time.perf_counter() - started, min_distance)


def joint_task(scenario: Scenario, before: Floats, distance: float = 0.0) -> JointTask:
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
        distance=distance,
    )


def _require_known(objective: str, starts: Sequence[str]) -> None:
    if objective not in OBJECTIVES:
        raise SolverError(f"objective {objective!r} is unknown{among(objective, OBJECTIVES)}")
    if isinstance(starts, str) or not starts:
        raise SolverError(f"starts = {starts!r}; expected a list of {', '.join(STARTS)}")
    for kind in starts:
        if kind not in STARTS:
            raise SolverError(f"kind of start {kind!r} is unknown{among(kind, STARTS)}")


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


def _backends(solver: str | Solver) -> tuple[Solver, Solver]:
    """What solves starts, and what makes the best of them better."""
    if solver != "ipopt":
        backend = make_solver(solver)
        return backend, backend
    first, polished = (
        Ipopt(
            tolerance=TOLERANCE,
            max_iterations=most,
            hessian="limited-memory",
            memory=20,
            feasibility=1e-8,
        )
        for most in (FIRST, POLISHED)
    )
    return first, polished


@dataclass
class _Search:
    """The solves of one joint plan.

    Parameters
    ----------
    scenario : Scenario
    task : JointTask
    form : JointForm
    solvers : pair of Solver
        For starts, and to make the best better.
    progress : callable
    """

    scenario: Scenario
    task: JointTask
    form: JointForm
    solvers: tuple[Solver, Solver]
    progress: Callable[[str], None]
    outcomes: list[SwarmOutcome] = field(default_factory=list)

    @property
    def nlp(self) -> Nlp:
        """The program; built once for all searches of its kind."""
        return joint_nlp(self.scenario.hazard, self.form)

    def run(self, kinds: Sequence[str], seed: int, deadline: float) -> SwarmOutcome:
        """The best outcome of all starts; always one at least."""
        for start in self._initial(kinds):
            self.outcomes.append(self.solved(start, self.solvers[0]))
            if time.perf_counter() > deadline:
                return self.best
        for outcome in sorted(self.outcomes, key=lambda o: -o.value)[:BEST]:
            self._polish(outcome, deadline)
        if "perturbed" in kinds:
            rng = np.random.default_rng(seed)
            for _ in range(PERTURBED):
                if time.perf_counter() > deadline:
                    break
                best = self.best
                start = perturbed(self._again(best), self.task, rng)
                found = self.solved(start, self.solvers[0], keep=True)
                if found.value > best.value:
                    self._polish(found, deadline)
        return self.best

    @property
    def best(self) -> SwarmOutcome:
        """By value; a solved one before its equals."""
        return max(self.outcomes, key=lambda o: (o.value, o.solution.status.success))

    def _initial(self, kinds: Sequence[str]) -> Iterator[SwarmStart]:
        guide = lone_guide(self.scenario, self.task.before[0])
        own = "own" in kinds and self.scenario.n <= MOST_EXACT
        for start in initial_plans(self.scenario, self.task, guide, own):
            if start.origin == "own guides" or "formations" in kinds or not own:
                yield start

    def _polish(self, outcome: SwarmOutcome, deadline: float) -> None:
        """Solve on from an outcome, with the arrival steps that it has, until both agree."""
        for _ in range(3):
            again = self._again(outcome)
            settled = np.array_equal(again.arrivals, outcome.arrivals)
            if (settled and outcome.solution.status.success) or time.perf_counter() > deadline:
                return
            found = self.solved(again, self.solvers[1], keep=True)
            if settled and found.value <= outcome.value:
                return
            outcome = found

    def _again(self, outcome: SwarmOutcome) -> SwarmStart:
        """A start from an outcome, at the steps at which its members really arrive."""
        real = first_steps(self.scenario, self.positions(outcome.velocities))
        arrivals = np.where((real > 0) & (outcome.arrivals > 0), real, outcome.arrivals)
        if self.form.outside:
            arrivals = outcome.arrivals
        return SwarmStart(outcome.origin, arrivals, outcome.velocities)

    def solved(self, start: SwarmStart, solver: Solver, keep: bool = False) -> SwarmOutcome:
        """What a solver makes of a start; kept among the outcomes where `keep`."""
        begun = time.perf_counter()
        self.progress(start.origin)
        form, arrivals = self.form, start.arrivals
        if form.outside:  # runs end at the first arrival: all at once
            arrivals = np.where(arrivals > 0, arrivals.max(), 0)
        instance = joint_instance(self.nlp, form, self.task, arrivals, start.velocities)
        solution = solver.solve(self.nlp, instance)[0]
        flat = self.nlp.variable("velocities", solution.x)
        last = int(arrivals.max()) if arrivals.all() else form.horizon
        wanted = self.task.v_max * flat.reshape(form.horizon, form.n, 2)[:last]
        if not np.isfinite(wanted).all():
            wanted = start.velocities[:last]
        velocities = self.flown(wanted)
        value = self.value(velocities, arrivals)
        seconds = time.perf_counter() - begun
        found = SwarmOutcome(start.origin, arrivals, velocities, value, solution, seconds)
        if keep:
            self.outcomes.append(found)
        return found

    def flown(self, wanted: Floats) -> Floats:
        """Velocities within the limits, on to the target's centre where a member has not arrived.

        What a solver's tolerance leaves beyond a limit is taken away as the chain would.
        """
        task, motion = self.task, motion_of(self.scenario)
        found = np.empty_like(wanted)
        previous = task.before
        for step, velocity in enumerate(wanted):
            sets = motion.sets(previous)
            beyond = sets.violation(velocity) > 0
            found[step] = np.where(beyond[:, None], sets.project(velocity), velocity)
            previous = found[step]
        reached = first_steps(self.scenario, self.positions(found))
        if reached.all():
            return found[: int(reached.max())]
        left = self.scenario.n_steps - len(found)
        if left <= 0:
            return found
        here = replace(task, start=self.positions(found)[-1], before=previous)
        goals = np.broadcast_to(task.center, (left, self.form.n, 2))
        return np.concatenate([found, follow(here, np.array(goals))])

    def positions(self, velocities: Floats) -> Floats:
        """X(0..T), (T+1, n, 2), as the chain computes them."""
        found = np.empty((len(velocities) + 1, *self.task.start.shape))
        found[0] = self.task.start
        for step, velocity in enumerate(velocities):
            found[step + 1] = found[step] + self.task.dt * velocity
        return found

    def value(self, velocities: Floats, arrivals: Counts) -> float:
        """What is maximised, of velocities (T, n, 2): exactly where that can be."""
        share = 1.0 if self.form.objective == "success" else self.form.n
        if self.form.exact:
            law = PlanLaw.of(self.scenario, self.positions(velocities))
            return share * (1.0 - law.cost(self.form.objective))
        instance = joint_instance(self.nlp, self.form, self.task, arrivals, velocities)
        odds = float(self.nlp.evaluate(instance.start[0], instance.parameters[0])[0])
        return share * float(1.0 / (1.0 + np.exp(odds)))

    def result(self, best: SwarmOutcome, seconds: float, min_distance: float | None) -> SwarmPlan:
        """The plan of the best outcome."""
        positions = self.positions(best.velocities)
        return SwarmPlan(
            scenario=self.scenario.name,
            objective=self.form.objective,
            positions=positions,
            velocities=best.velocities,
            before=self.task.before,
            motion=motion_of(self.scenario),
            arrivals=first_steps(self.scenario, positions),
            value=best.value,
            law=PlanLaw.of(self.scenario, positions) if self.form.exact else None,
            solution=best.solution,
            outcomes=tuple(self.outcomes),
            bound=success_bound(self.scenario),
            min_distance=min_distance,
            seconds=seconds,
        )


def first_steps(scenario: Scenario, positions: Floats) -> Counts:
    """First step at which each member (n,) of ways (T+1, n, 2) is in the target, 0 for never."""
    inside = scenario.target.contains(positions[1:])
    return np.where(inside.any(axis=0), inside.argmax(axis=0) + 1, 0)
