"""From a scenario to a guide: which starts, which arrival steps, and the best of them."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from .arrays import Floats
from .errors import PlanningError, SolverError
from .guide import Candidate, Guide, guide_from, path_of, sides_of
from .problems.guide import GuideTask, guide_instance, guide_nlp
from .problems.guide_penalised import penalised_guide_instance, penalised_guide_nlp
from .solution import Solution
from .solvers import ProjectedGradient, Solver, make_solver
from .solvers.base import VIOLATION
from .starts import around, resampled, straight

if TYPE_CHECKING:
    from .scenario import Scenario


COARSE = 8
"""Arrival steps tried first, evenly spread; the best one's neighbourhood is then halved to one."""

WAYS = 3
"""Ways around the radars, best first, whose arrival step a global search refines."""


def plan(
    scenario: Scenario,
    solver: str | Solver = "ipopt",
    *,
    search: str | None = None,
    check: bool = True,
    progress: Callable[[str], None] | None = None,
) -> Guide:
    """Least risky path of a lone agent from the swarm's place to the target.

    Parameters
    ----------
    scenario : Scenario
    solver : str or Solver
        ``"ipopt"``, or ``"projected-gradient"`` for the paper's penalised form.
    search : {"local", "global"}, optional
        From the straight line only, as in the paper, or from ways on both sides of every radar;
        the scenario's own choice by default.
    check : bool
        Whether to raise if no start led to the target; otherwise the best failure is returned.
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
    """
    given = scenario.swarm.velocity
    guide = plan_from(
        scenario,
        scenario.guide_start,
        solver,
        search=search,
        before=None if given == "guide" else given,
        progress=progress,
    )
    return _checked(guide) if check else guide


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
    task = GuideTask(
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


@dataclass(frozen=True)
class _Planner:
    scenario: Scenario
    task: GuideTask
    solver: Solver
    progress: Callable[[str], None]

    def candidates(self, search: str) -> list[Candidate]:
        """Outcomes of every start of a local or global search."""
        goal = self._goal()
        ways = {"straight": straight(self.task.start, goal)}
        radars = self.scenario.hazard.radar_positions
        if search == "global":
            ways |= dict(around(self.task.start, goal, radars))
        found: dict[str, list[Candidate]] = {}
        for name, polyline in ways.items():
            self.progress(name)
            found[name] = list(self._try(name, polyline, self._steps()))
        refined = self._most_promising(found) if self.scenario.guide.arrival == "any" else []
        for name in refined:
            self.progress(f"{name}, arrival step")
            self._refine(name, ways[name], found[name])
        return [candidate for tried in found.values() for candidate in tried]

    def candidates_near(self, guide: Guide) -> list[Candidate]:
        """Outcomes of starts that follow another agent's guide and its other ways."""
        possible = self._possible()
        tried: list[Candidate] = []
        for known in guide.ways()[:WAYS]:
            path = path_of(guide.positions[0], known.velocities, self.task.dt)
            around_known = {known.arrival + shift for shift in (-1, 0, 1)}
            steps = sorted(around_known.intersection(possible)) or possible[-1:]
            tried += self._try(known.start, np.vstack([self.task.start, path[1:]]), steps)
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

    def _try(self, name: str, polyline: Floats, steps: Iterable[int]) -> Iterator[Candidate]:
        nlp = guide_nlp(self.scenario.hazard, self.scenario.n_steps)
        task, unit = self.task.dimensionless(), self.task.v_max
        for arrival in steps:
            guess = resampled(polyline, arrival, self.task.dt) / unit
            instance = guide_instance(nlp, task, arrival, guess)
            solution = self.solver.solve(nlp, instance)[0]
            velocities = unit * nlp.variable("velocities", solution.x)[:arrival]
            yield self._priced(name, arrival, velocities, solution)

    def _refine(self, name: str, polyline: Floats, tried: list[Candidate]) -> None:
        """Try arrival steps between the best one and its neighbours until none is left."""
        while True:
            best = min(tried, key=_preference).arrival
            steps = np.array(sorted({c.arrival for c in tried}))
            at = int(np.searchsorted(steps, best))
            between = {(int(steps[i]) + best) // 2 for i in (at - 1, at + 1) if 0 <= i < len(steps)}
            fresh = between - set(steps.tolist())
            if not fresh:  # a neighbour may be one step above: (best + 1 + best) // 2 = best
                return
            tried += self._try(name, polyline, sorted(fresh))

    def _most_promising(self, found: dict[str, list[Candidate]]) -> list[str]:
        """Starts to refine: the best of each way around the radars, at most `WAYS`.

        The straight line too, so that a global search is never worse than a local one.
        """
        best = {name: min(tried, key=_preference) for name, tried in found.items()}
        chosen: dict[str, str] = {}
        for name in sorted(best, key=lambda start: _preference(best[start])):
            chosen.setdefault(best[name].sides, name)
        return list(dict.fromkeys([*list(chosen.values())[:WAYS], "straight"]))

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

    def _goal(self) -> Floats:
        """The nearest point of the target, margin taken off."""
        way = self.task.start - self.task.center
        distance = np.hypot(*way)
        shrink = min(1.0, self.task.radius / distance) if distance > 0 else 1.0
        return self.task.center + shrink * way

    def _steps(self) -> list[int]:
        """Arrival steps to try first: from the fewest possible to all, evenly."""
        possible = self._possible()
        places = np.linspace(0, len(possible) - 1, min(COARSE, len(possible))).round()
        return [possible[int(place)] for place in places]

    def _possible(self) -> list[int]:
        """Arrival steps that v_max allows and the scenario asks for, or else the horizon."""
        horizon = self.scenario.n_steps
        reach = np.arange(1, horizon + 1)[:, None] * self.task.dt * self.task.v_max
        outside = np.maximum(np.abs(self.task.center - self.task.start) - reach, 0.0)
        possible = 1 + np.flatnonzero(np.hypot(*outside.T) <= self.task.radius)
        if not possible.size or self.scenario.guide.arrival == "horizon":
            return [horizon]
        return [int(step) for step in possible]
