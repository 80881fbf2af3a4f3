"""From a scenario to a guide: which starts, which arrival steps, and the best of them."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from .arrays import Floats
from .certificate.grid import Relaxation
from .certificate.refinement import Certificate, arrival_multiplier
from .certificate.refinement import certify as certified
from .certificate.ways import Way, best_ways
from .errors import PlanningError, SolverError
from .guide import Candidate, Guide, guide_from, path_of, sides_of
from .problems.guide import GuideTask, guide_instance, guide_nlp
from .problems.guide_penalised import penalised_guide_instance, penalised_guide_nlp
from .solution import Solution
from .solvers import ProjectedGradient, Solver, make_solver
from .solvers.base import VIOLATION
from .starts import resampled, straight

if TYPE_CHECKING:
    from .scenario import Scenario


COARSE = 8
"""Arrival steps tried first, evenly spread; the best one's neighbourhood is then halved to one."""

WAYS = 4
"""Ways around the radars, best first, from which a global search starts."""

NEAR = 3
"""Ways of a known guide, best first, that a search near it starts from."""

GAP, TIME_LIMIT = 0.01, 10.0
"""Relative gap at which a certificate is good enough, and the seconds that it may take."""


def plan(
    scenario: Scenario,
    solver: str | Solver = "ipopt",
    *,
    search: str | None = None,
    check: bool = True,
    certify: bool = True,
    gap: float = GAP,
    time_limit: float = TIME_LIMIT,
    progress: Callable[[str], None] | None = None,
) -> Guide:
    """Least risky path of a lone agent from the swarm's place to the target.

    Parameters
    ----------
    scenario : Scenario
    solver : str or Solver
        ``"ipopt"``, or ``"projected-gradient"`` for the paper's penalised form.
    search : {"local", "global"}, optional
        From the straight line only, as in the paper, or also from the ways that dynamic
        programming finds; the scenario's own choice by default.
    check : bool
        Whether to raise if no start led to the target; otherwise the best failure is returned.
    certify : bool
        Whether to prove how good the guide is: see `Guide.risk_bound` and `casswarm.certificate`.
        Hazards written by users need a ``least_lone_rate`` for it.
    gap : float
        Relative distance of the bound from the best known risk at which the proof may end; above
        0, below 1.
    time_limit : float
        Seconds that the proof may take; what is proven by then is proven.
    progress : callable, optional
        Called with the name of every start.

    Returns
    -------
    Guide
        The outcome of least risk among the starts and arrival steps tried (a few spread up to the
        horizon, then those around the best); `Guide.candidates` holds them all. Each is a local
        minimum of the program in `casswarm.problems.guide`, priced up to its first arrival: a path
        that crosses the target's rim before its planned last step has arrived there.

    Raises
    ------
    PlanningError
        No start led to the target; the message counts the outcomes.
    SolverError
        A solver that is unknown, or cannot take the guide problem.
    ValueError
        A gap or time limit out of range.
    """
    if not 0 < gap < 1:
        raise ValueError(f"gap = {gap!r}; allowed: above 0, below 1 (0.01 is one percent)")
    if not time_limit > 0:
        raise ValueError(f"time_limit = {time_limit!r}; allowed: seconds above 0")
    given = scenario.swarm.velocity
    guide = plan_from(
        scenario,
        scenario.guide_start,
        solver,
        search=search,
        before=None if given == "guide" else given,
        progress=progress,
    )
    guide = _checked(guide) if check else guide
    if not (certify and guide.arrives):
        return guide
    (progress or (lambda _: None))("certificate")
    certificate = certificate_of(scenario, guide, gap, time_limit)
    if certificate is None:
        return guide
    return replace(guide, risk_bound=certificate.bound, certificate=certificate)


def certificate_of(
    scenario: Scenario, guide: Guide, gap: float = GAP, time_limit: float = TIME_LIMIT
) -> Certificate | None:
    """Proof of how good any guide of a scenario can be; None where its hazard knows no bounds.

    The path that the bound is held against is the best known without limits of acceleration and
    margin: the guide itself, or what Ipopt makes of the ways that dynamic programming finds.
    """
    hazard, start = scenario.hazard, scenario.guide_start
    if hazard.least_lone_rate(start, start) is None:
        return None
    task = Relaxation.of(scenario)
    paths = [guide.positions]
    unlimited = np.isinf(scenario.guide_a_max) and scenario.swarm.velocity == "guide"
    if not (
        unlimited and guide.search == "global" and scenario.arrival_margin <= 1e-5 * task.radius
    ):
        paths += _relaxed_paths(scenario, task)
    risks = [task.dt * float(hazard.lone_rates(path[1:]).sum()) for path in paths]
    best = int(np.argmin(risks))
    multiplier = arrival_multiplier(task, paths[best], scenario.swarm.v_max)
    return certified(task, risks[best], multiplier, gap=gap, time_limit=time_limit)


def _relaxed_paths(scenario: Scenario, task: Relaxation) -> list[Floats]:
    """Locally best paths of the relaxation, from the best ways and next to their arrival steps."""
    free = replace(_task(scenario, task.start, None), radius=scenario.target.radius)
    free = replace(free, a_max=np.inf, a_max_first=np.inf)
    planner = _Planner(scenario, free, make_solver("ipopt"), lambda _: None)
    tried: list[Candidate] = []
    for way in best_ways(task, 2):
        tried += planner.along(way, [way.arrival])
    for way in best_ways(task, 1):
        tried += planner.along(way, [way.arrival - 1, way.arrival + 1])
    return [path_of(task.start, c.velocities, task.dt) for c in tried if np.isfinite(c.risk)]


def plan_from(
    scenario: Scenario,
    start: ArrayLike,
    solver: str | Solver = "ipopt",
    *,
    search: str | None = None,
    before: ArrayLike | None = None,
    near: Guide | None = None,
    progress: Callable[[str], None] | None = None,
) -> Guide:
    """Like `plan`, for an agent at `start` (2,), whether it arrives or not.

    `before` (2,) is its velocity V(-1), from which the members' a_max bounds the first change; by
    default it may start with any velocity. With `near`, the guide of an agent close by, the search
    starts from its ways around the radars, the best few, at their arrival steps and those next to
    them: a tenth of the work.
    """
    task = _task(scenario, start, before)
    backend = make_solver(solver, **_paper_options(scenario, solver))
    search = _checked_search(search, scenario, backend)
    planner = _Planner(scenario, task, backend, progress or (lambda _: None))
    if isinstance(backend, ProjectedGradient):
        candidates = [planner.penalised()]
    elif near is not None and near.ways():
        candidates = planner.candidates_near(near)
    else:
        candidates = planner.candidates(search)
    best = min(candidates, key=_preference)
    return guide_from(
        scenario.hazard,
        task.start,
        best,
        tuple(candidates),
        task.dt,
        task.center,
        search,
    )


def _task(scenario: Scenario, start: ArrayLike, before: ArrayLike | None) -> GuideTask:
    return GuideTask(
        start=np.asarray(start, float),
        center=np.asarray(scenario.target.center, float),
        radius=scenario.target.radius - scenario.arrival_margin,
        before=np.zeros(2) if before is None else np.asarray(before, float),
        a_max=scenario.guide_a_max,
        a_max_first=(
            np.inf if before is None or not scenario.guide.flyable else scenario.swarm.a_max
        ),
        v_max=scenario.swarm.v_max,
        dt=scenario.time.dt,
    )


def _paper_options(scenario: Scenario, solver: str | Solver) -> dict[str, object]:
    if solver != ProjectedGradient.name:
        return {}
    options = scenario.guide
    return {"step": options.learning_rate, "iterations": options.iterations, "keep": "best"}


def _checked_search(search: str | None, scenario: Scenario, solver: Solver) -> str:
    if search not in ("local", "global", None):
        raise SolverError(f"search {search!r} is unknown; allowed: 'local', 'global'")
    if isinstance(solver, ProjectedGradient):
        if search == "global":
            raise SolverError("projected-gradient starts from the straight line: search is 'local'")
        return "local"
    return search or scenario.guide.search


def _preference(candidate: Candidate) -> tuple[bool, bool, float]:
    """Arriving and solved first, then by risk."""
    arrives = bool(np.isfinite(candidate.risk))
    return not arrives, not candidate.solution.status.success, candidate.risk


def _checked(guide: Guide) -> Guide:
    if guide.arrives:
        return guide
    outcomes = Counter(str(c.solution.status) for c in guide.candidates)
    told = ", ".join(f"{count} {status}" for status, count in outcomes.items())
    raise PlanningError(
        f"no guide found: of {len(guide.candidates)} solves ({told}) none arrives in the target. "
        "A larger a_max or t_f, a smaller guide.margin, or flyable = false gives it more room; "
        "check=False returns the best failure"
    )


Start = Callable[[int, float], Floats]
"""Velocities (steps, 2) of an initial path, from a number of steps and dt."""


def _resampling(polyline: Floats) -> Start:
    return lambda steps, dt: resampled(polyline, steps, dt)


@dataclass(frozen=True)
class _Planner:
    scenario: Scenario
    task: GuideTask
    solver: Solver
    progress: Callable[[str], None]

    def candidates(self, search: str) -> list[Candidate]:
        """Outcomes of every start of a local or global search."""
        found: dict[str, list[Candidate]] = {}
        starts: dict[str, Start] = {"straight": self._line}
        steps = {"straight": self._steps()}
        if search == "global":
            relaxation = replace(
                Relaxation.of(self.scenario, self.task.start), radius=self.task.radius
            )
            ways = best_ways(relaxation, WAYS)
            starts |= {way.sides or "way": way.velocities for way in ways}
            steps |= {way.sides or "way": self._steps_near(way.arrival) for way in ways}
            steps["straight"] = self._steps(3)
        for name, start in starts.items():
            self.progress(name)
            found[name] = list(self._try(name, start, steps[name]))
        refined = self._most_promising(found) if self.scenario.guide.arrival == "any" else []
        for name in refined:
            self.progress(f"{name}, arrival step")
            self._refine(name, starts[name], found[name])
        return [candidate for tried in found.values() for candidate in tried]

    def along(self, way: Way, steps: Iterable[int]) -> list[Candidate]:
        """Outcomes of a way at those of the arrival steps that are possible."""
        possible = set(self._possible())
        return list(
            self._try(way.sides or "way", way.velocities, sorted(possible.intersection(steps)))
        )

    def candidates_near(self, guide: Guide) -> list[Candidate]:
        """Outcomes of starts that follow another agent's guide and its other ways."""
        possible = self._possible()
        tried: list[Candidate] = []
        for known in guide.ways()[:NEAR]:
            path = path_of(guide.positions[0], known.velocities, self.task.dt)
            around_known = {known.arrival + shift for shift in (-1, 0, 1)}
            steps = sorted(around_known.intersection(possible)) or possible[-1:]
            polyline = np.vstack([self.task.start, path[1:]])
            tried += self._try(known.start, _resampling(polyline), steps)
        return tried

    def penalised(self) -> Candidate:
        """Outcome of the paper's penalised form, from the straight line over all steps."""
        task = replace(self.task, radius=self.scenario.target.radius)
        nlp = penalised_guide_nlp(self.scenario.hazard, self.scenario.n_steps)
        line = resampled(straight(task.start, task.center), self.scenario.n_steps, task.dt)
        instance = penalised_guide_instance(nlp, task, self.scenario.guide.gamma, line)
        self.progress("straight")
        solution = self.solver.solve(nlp, instance)[0]
        velocities = nlp.variable("velocities", solution.x)
        return self._priced("straight", self.scenario.n_steps, velocities, solution)

    def _try(self, name: str, start: Start, steps: Iterable[int]) -> Iterator[Candidate]:
        nlp = guide_nlp(self.scenario.hazard, self.scenario.n_steps)
        task, unit = self.task.dimensionless(), self.task.v_max
        for arrival in steps:
            guess = start(arrival, self.task.dt) / unit
            instance = guide_instance(nlp, task, arrival, guess)
            solution = self.solver.solve(nlp, instance)[0]
            velocities = unit * nlp.variable("velocities", solution.x)[:arrival]
            yield self._priced(name, arrival, velocities, solution)

    def _refine(self, name: str, start: Start, tried: list[Candidate]) -> None:
        """Try arrival steps between the best one and its neighbours until none is left."""
        while True:
            best = min(tried, key=_preference).arrival
            steps = np.array(sorted({c.arrival for c in tried}))
            at = int(np.searchsorted(steps, best))
            between = {(int(steps[i]) + best) // 2 for i in (at - 1, at + 1) if 0 <= i < len(steps)}
            fresh = between - set(steps.tolist())
            if not fresh:  # a neighbour may be one step above: (best + 1 + best) // 2 = best
                return
            tried += self._try(name, start, sorted(fresh))

    def _most_promising(self, found: dict[str, list[Candidate]]) -> list[str]:
        """Starts to refine: the best of each way around the radars, at most two of them."""
        best = {name: min(tried, key=_preference) for name, tried in found.items()}
        chosen: dict[str, str] = {}
        for name in sorted(best, key=lambda start: _preference(best[start])):
            chosen.setdefault(best[name].sides, name)
        return list(chosen.values())[:2]

    def _priced(self, name: str, arrival: int, velocities: Floats, solution: Solution) -> Candidate:
        task = self.task
        finite = np.isfinite(velocities).all()
        velocities = (
            np.clip(velocities, -task.v_max, task.v_max) if finite else np.zeros_like(velocities)
        )
        positions = path_of(task.start, velocities, task.dt)
        risk = np.inf
        inside = self.scenario.target.contains(positions[1:])
        if inside.any() and solution.residuals.violation <= VIOLATION:
            first = int(inside.argmax()) + 1
            velocities, positions = velocities[:first], positions[: first + 1]
            risk = float(task.dt * self.scenario.hazard.lone_rates(positions[1:]).sum())
        radars = self.scenario.hazard.radar_positions
        return Candidate(name, arrival, sides_of(positions, radars), velocities, risk, solution)

    def _line(self, steps: int, dt: float) -> Floats:
        """Velocities (steps, 2) straight to the nearest point of the target, margin taken off."""
        way = self.task.start - self.task.center
        distance = np.hypot(*way)
        shrink = min(1.0, self.task.radius / distance) if distance > 0 else 1.0
        return resampled(straight(self.task.start, self.task.center + shrink * way), steps, dt)

    def _steps(self, most: int = COARSE) -> list[int]:
        """Arrival steps to try first: from the fewest possible to all, evenly."""
        possible = self._possible()
        places = np.linspace(0, len(possible) - 1, min(most, len(possible))).round()
        return [possible[int(place)] for place in places]

    def _steps_near(self, arrival: int) -> list[int]:
        """Arrival steps next to one, and the last: limits of acceleration take their time."""
        possible = self._possible()
        nearest = min(possible, key=lambda step: abs(step - arrival))
        near = {nearest - 1, nearest, nearest + 1, possible[-1]}
        return sorted(near.intersection(possible))

    def _possible(self) -> list[int]:
        """Arrival steps that v_max allows and the scenario asks for, or else the horizon."""
        horizon = self.scenario.n_steps
        reach = np.arange(1, horizon + 1)[:, None] * self.task.dt * self.task.v_max
        outside = np.maximum(np.abs(self.task.center - self.task.start) - reach, 0.0)
        possible = 1 + np.flatnonzero(np.hypot(*outside.T) <= self.task.radius)
        if not possible.size or self.scenario.guide.arrival == "horizon":
            return [horizon]
        return [int(step) for step in possible]
