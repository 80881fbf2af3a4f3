"""From a scenario to a guide: the best outcome of a search, and how good any can be."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from ..errors import PlanningError, SolverError
from ..optimization.solvers import ProjectedGradient, Solver, make_solver
from ..problems.guide import GuideTask
from ..typing import FloatArray
from .bounds.grid import Relaxation
from .bounds.risk_bound import Certificate, arrival_multiplier
from .bounds.risk_bound import certify as certified
from .guide import Candidate, Guide, guide_from, integrate
from .homotopy import best_homotopy_classes
from .multistart import Multistart, preference

if TYPE_CHECKING:
    from ..scenario import Scenario


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
        Whether to prove how good the guide is: see `Guide.risk_bound` and `casswarm.planning.bounds`.
        Hazards written by users need a ``single_agent_lower_bound`` for it.
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

    Examples
    --------
    >>> import casswarm as csw
    >>> guide = csw.plan(csw.load_scenario("single-agent"))
    >>> guide.positions.shape, guide.velocities.shape
    ((31, 2), (30, 2))
    >>> bool(guide.risk_bound <= guide.risk)
    True
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


def initial_velocities(scenario: Scenario, guide: Guide) -> FloatArray:
    """V(-1) of every member, (n, 2): the scenario's, or the guide's first velocity."""
    given = scenario.swarm.velocity
    first = guide.velocities[0] if given == "guide" else np.asarray(given, float)
    return np.tile(first, (scenario.n, 1))


def certificate_of(
    scenario: Scenario, guide: Guide, gap: float = GAP, time_limit: float = TIME_LIMIT
) -> Certificate | None:
    """Proof of how good any guide of a scenario can be; None where its hazard knows no bounds.

    The path that the bound is held against is the best known without limits of acceleration and
    margin: the guide itself, or what Ipopt makes of the ways that dynamic programming finds.
    """
    hazard, start = scenario.hazard, scenario.guide_start
    if hazard.single_agent_lower_bound(start, start) is None:
        return None
    task = Relaxation.of(scenario)
    paths = [guide.positions]
    unlimited = np.isinf(scenario.guide_a_max) and scenario.swarm.velocity == "guide"
    if not (
        unlimited and guide.search == "global" and scenario.arrival_margin <= 1e-5 * task.radius
    ):
        paths += _relaxed_paths(scenario, task)
    risks = [task.dt * float(hazard.single_agent_rates(path[1:]).sum()) for path in paths]
    best = int(np.argmin(risks))
    multiplier = arrival_multiplier(task, paths[best], scenario.swarm.v_max)
    return certified(task, risks[best], multiplier, gap=gap, time_limit=time_limit)


def _relaxed_paths(scenario: Scenario, task: Relaxation) -> list[FloatArray]:
    """Locally best paths of the relaxation, from the best ways and next to their arrival steps."""
    free = replace(_task(scenario, task.start, None), radius=scenario.target.radius)
    free = replace(free, a_max=np.inf, a_max_first=np.inf)
    planner = Multistart(scenario, free, make_solver("ipopt"), lambda _: None)
    tried: list[Candidate] = []
    for way in best_homotopy_classes(task, 2):
        tried += planner.along(way, [way.arrival])
    for way in best_homotopy_classes(task, 1):
        tried += planner.along(way, [way.arrival - 1, way.arrival + 1])
    return [integrate(task.start, c.velocities, task.dt) for c in tried if np.isfinite(c.risk)]


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
    planner = Multistart(scenario, task, backend, progress or (lambda _: None))
    if isinstance(backend, ProjectedGradient):
        candidates = [planner.penalised()]
    elif near is not None and near.ways():
        candidates = planner.candidates_near(near)
    else:
        candidates = planner.candidates(search)
    best = min(candidates, key=preference)
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
            np.inf
            if before is None or not scenario.guide.acceleration_limited
            else scenario.swarm.a_max
        ),
        v_max=scenario.swarm.v_max,
        dt=scenario.time.dt,
    )


def _paper_options(scenario: Scenario, solver: str | Solver) -> dict[str, object]:
    if solver != ProjectedGradient.name:
        return {}
    options = scenario.guide
    return {"step": options.learning_rate, "max_iter": options.iterations, "keep": "best"}


def _checked_search(search: str | None, scenario: Scenario, solver: Solver) -> str:
    if search not in ("local", "global", None):
        raise SolverError(f"search {search!r} is unknown; allowed: 'local', 'global'")
    if isinstance(solver, ProjectedGradient):
        if search == "global":
            raise SolverError("projected-gradient starts from the straight line: search is 'local'")
        return "local"
    return search or scenario.guide.search


def _checked(guide: Guide) -> Guide:
    if guide.arrives:
        return guide
    outcomes = Counter(str(c.solution.status) for c in guide.candidates)
    told = ", ".join(f"{count} {status}" for status, count in outcomes.items())
    raise PlanningError(
        f"no guide found: of {len(guide.candidates)} solves ({told}) none arrives in the target. "
        "A larger a_max or t_f, a smaller guide.margin, or acceleration_limited = false gives it more room; "
        "check=False returns the best failure"
    )
