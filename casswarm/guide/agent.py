"""The guide of one agent: the best outcome of a multistart search, in the agent's own frame."""

from __future__ import annotations

import math
import time
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from .._util.text import counted
from ..errors import PlanningError, SolverError
from ..formation import ProjectedGradient
from ..problems.guide import GuideTask
from ..scenario import FormationOptions, GuideOptions, Scenario
from ..solvers import Solver, make_solver
from ..typing import FloatArray, Progress, Search
from .frame import Frame
from .guide import Guide
from .multistart import Multistart, preference


def plan_from(
    scenario: Scenario,
    start: ArrayLike,
    solver: str | Solver = "ipopt",
    *,
    search: Search | None = None,
    initial_velocity: ArrayLike | None = None,
    near: Guide | None = None,
    solver_options: Mapping[str, Any] | None = None,
    time_limit: float = math.inf,
    progress: Progress | None = None,
) -> Guide:
    """Guide of an agent at `start` (2,), neither certified nor required to arrive; see `plan`.

    The members' a_max bounds the change from `initial_velocity` (2,), V(-1), which may be any
    velocity by default. If `near`, the guide of a nearby agent, is given, the search starts from
    its best homotopy classes, at their arrival steps and the adjacent ones, in a tenth of the time.

    Raises
    ------
    PlanningError
        The time limit has passed before the first solve.
    """
    scenario = scenario.for_guide
    if scenario.target.other:
        return _nearest_of_all(
            scenario,
            start,
            solver,
            search=search,
            initial_velocity=initial_velocity,
            near=near,
            solver_options=solver_options,
            time_limit=time_limit,
            progress=progress,
        )
    deadline = time.monotonic() + time_limit
    task = GuideTask.from_scenario(scenario, start, initial_velocity)
    backend = papers_solver(scenario, solver, scenario.guide, solver_options, keep="best")
    kind = _checked_search(search, scenario, backend)
    frame = Frame.of_agent(scenario, task.start, task.initial_velocity)
    turned = replace(
        task,
        start=frame.points_to(task.start),
        center=frame.points_to(task.center),
        initial_velocity=frame.points_to(task.initial_velocity),
    )
    multistart = Multistart(
        frame.scenario_in(scenario), turned, backend, frame.reported(progress), deadline
    )
    if isinstance(backend, ProjectedGradient):
        candidates = [multistart.penalised()]
    elif near is not None and near.best_per_homotopy_class():
        candidates = multistart.candidates_near(frame.guide_to(near))
    else:
        candidates = multistart.candidates(kind)
    if not candidates:
        raise PlanningError(
            f"no guide found: the time limit of {time_limit:g} s ended the search before its first "
            "solve; raise it, or choose a larger time.dt",
            time_limit=time_limit,
        )
    first = candidates.index(min(candidates, key=preference))
    outcomes = tuple(map(frame.inverse.candidate_to, candidates))
    parts = scenario.by_parts.hazard, scenario.time.substeps
    guide = Guide.from_candidate(parts[0], task, outcomes[first], outcomes, kind, parts[1])
    if not multistart.expired:
        return guide
    solves = counted(len(candidates), "solve")
    note = f"the time limit of {time_limit:g} s ended the search after {solves}"
    return replace(guide, note=note)


def _nearest_of_all(
    scenario: Scenario,
    start: ArrayLike,
    solver: str | Solver,
    *,
    near: Guide | None,
    **options: Any,
) -> Guide:
    """The best guide of those to each target zone, as `plan_from`, with its candidates only."""
    options["time_limit"] /= len(scenario.by_target)
    guides, failure = [], None
    for one in scenario.by_target:
        same = near if near is not None and tuple(near.center) == one.target.center else None
        try:
            guides.append(plan_from(one, start, solver, near=same, **options))
        except PlanningError as error:  # the time is over
            failure = error
    if failure is not None and not guides:
        raise failure
    best = min(guides, key=lambda guide: (not guide.arrives, guide.risk))
    inside = scenario.target.contains(best.positions[1:])
    first = int(inside.argmax()) + 1 if inside.any() else best.arrival
    if first == best.arrival:
        return best
    positions = best.positions[: first + 1]  # which crosses another target zone
    arrived = [disc for disc in scenario.target.discs if disc.contains(positions[-1])]
    return replace(
        best,
        positions=positions,
        velocities=best.velocities[:first],
        rates=best.rates[:first],
        center=np.array(arrived[0].center),
    )


def guide_solver(solver: str | Solver) -> str:
    """Solver of guides beside another solver: the paper's method beside itself, else Ipopt."""
    name = solver if isinstance(solver, str) else solver.name
    return name if name == ProjectedGradient.name else "ipopt"


def initial_velocities(scenario: Scenario, guide: Guide) -> FloatArray:
    """V(-1) of every member, (n, 2): the scenario's velocity, or the guide's first velocity.

    It is shortened to the limits of members that are slower than the guide.
    """
    given = scenario.swarm.initial_velocity
    first = guide.velocities[0] if given is None else np.asarray(given, float)
    if scenario.swarm.kind is None:
        return np.tile(first, (scenario.n, 1))
    limits = [GuideTask.from_scenario(scenario.with_kind_of(i), first) for i in range(scenario.n)]
    return np.array([each.limited(first) for each in limits])


def papers_solver(
    scenario: Scenario,
    solver: str | Solver,
    table: GuideOptions | FormationOptions,
    options: Mapping[str, Any] | None,
    **others: Any,
) -> Solver:
    """The solver, with the paper's options from a table of the scenario for its own method."""
    paper = {
        "step": table.learning_rate,
        "x_scale": 1.0 / scenario.time.dt,  # steps in displacements
        "max_iter": table.iterations,
    }
    defaults = paper | others if solver == ProjectedGradient.name else {}
    return make_solver(solver, **defaults | dict(options or {}))


def _checked_search(search: Search | None, scenario: Scenario, solver: Solver) -> Search:
    if search not in ("local", "global", None):
        raise SolverError(
            f"search {search!r} is unknown; allowed: 'local', 'global'", search=search
        )
    if isinstance(solver, ProjectedGradient):
        if search == "global":
            raise SolverError(
                "projected-gradient starts from the straight line: search is 'local'", search=search
            )
        return "local"
    return search or scenario.guide.search
