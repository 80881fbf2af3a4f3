"""Guides of a scenario: the best outcome of a multistart search, with a certificate."""

from __future__ import annotations

import math
import time
import warnings
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from typing_extensions import Unpack

from .._util.progress import reporter
from .._util.settings import Execution, SavedKeywords, given_values
from .._util.text import counted, shown
from ..bounds import (
    AccelerationBound,
    AccelerationLimits,
    acceleration_limits,
    bound_with_acceleration,
)
from ..bounds.acceleration_kernels import compile_kernels
from ..bounds.risk_bound import GAP, Certificate, arrival_multiplier, certify
from ..errors import CasswarmWarning, PlanningError, SolverError
from ..formation import ProjectedGradient
from ..grid.nodes import UNIT, Relaxation
from ..hazard import subdivided
from ..motion.kinematics import integrate
from ..problems.guide import GuideTask
from ..scenario import FormationOptions, GuideOptions, Scenario
from ..scenario.scenario_files import require_scenario
from ..solvers import Solver, make_solver
from ..typing import FloatArray, Progress, Search
from .frame import Frame
from .guide import Candidate, Guide
from .multistart import Multistart, best_homotopy_classes, preference

_TIME_LIMIT = 10.0  # seconds, of a proof by default
_BASELINE_MARGIN = 1e-6  # of the radius: rounding must not leave the last step outside the target
_SHARE = 0.3  # of the time, for the bound without limits of acceleration if there are any


def certify_guide(
    scenario: Scenario, guide: Guide, gap: float = GAP, deadline: float | None = None
) -> Certificate | None:
    """Certificate for the guides of a scenario; None if its hazard provides no lower bounds.

    The first bound, on the risk of all paths that obey the speed limit, is compared with the best
    known one: the guide itself, or what Ipopt reaches from the best homotopy classes. If it is not
    within `gap` of the guide's risk, and the guide obeys limits of acceleration, the second bound
    is for the paths that obey them, too. With ``time.substeps`` there is only the first, of paths
    that may turn and arrive after every part of a step. The `deadline` is a time of
    `time.monotonic`; by default the proof takes at most 10 seconds.

    Scenarios that differ by quarter turns and mirrors have the same bounds, for the same guide.
    """
    scenario = scenario.for_guide
    if scenario.target.other:
        return _certified_for_all(scenario, guide, gap, deadline)
    frame = Frame.of_agent(scenario, guide.positions[0], guide.velocities[0])
    scenario = frame.scenario_in(scenario)
    guide = frame.guide_to(guide)
    task = Relaxation.from_scenario(scenario)
    if not task.bounded:
        return None
    limits = _obeyed_limits(scenario, guide)
    paths = [guide.positions]
    limited = np.isfinite(scenario.guide_a_max) or scenario.swarm.velocity != "guide"
    smaller_target = scenario.arrival_margin > 1e-5 * task.radius
    if limited or smaller_target or guide.search != "global":
        paths += _relaxed_paths(scenario, task, math.inf if deadline is None else deadline)
    paths = [subdivided(path, scenario.time.substeps) for path in paths]
    risks = [task.dt * float(task.rates_along(path[1:]).sum()) for path in paths]
    best = int(np.argmin(risks))
    left = _TIME_LIMIT if deadline is None else max(0.0, deadline - time.monotonic())
    left *= 1.0 if limits is None else _SHARE
    multiplier = arrival_multiplier(task, paths[best])
    certificate = certify(task, risks[best], multiplier, gap=gap, time_limit=left)
    if limits is None or certificate.bound >= (1 - gap) * guide.risk:
        return certificate
    if deadline is None:
        compile_kernels()  # not at the expense of the proof
        deadline = time.monotonic() + _TIME_LIMIT - certificate.seconds
    accelerated = _accelerated(scenario, guide, task, limits, certificate.bound, gap, deadline)
    return replace(certificate, accelerated=accelerated)


def _certified_for_all(
    scenario: Scenario, guide: Guide, gap: float, deadline: float | None
) -> Certificate | None:
    """The certificate of the target zone with the least bound, as `certify_guide`.

    The guide that is compared is the given one: a bound above its risk shows that no path to a
    target zone is better.
    """
    velocity, certificates = scenario.swarm.velocity, []
    initial, targets = None if velocity == "guide" else velocity, scenario.by_target
    share = _TIME_LIMIT if deadline is None else max(0.0, deadline - time.monotonic())
    share /= len(targets)  # for the search as for the proof, if there is a deadline
    limit = math.inf if deadline is None else share / 2
    for one in targets:
        start, begun = guide.positions[0], time.monotonic()
        try:
            own = plan_from(one, start, search="global", initial_velocity=initial, time_limit=limit)
        except PlanningError:  # the time is over
            return None
        until = (time.monotonic() if deadline is None else begun) + share
        if own.arrives:
            certificate = certify_guide(one, own, gap, until)
        else:  # no path is known: that none to this target zone is better than the guide
            task, left = Relaxation.from_scenario(one), max(0.0, until - time.monotonic())
            bounded = task.bounded
            certificate = certify(task, guide.risk, gap=gap, time_limit=left) if bounded else None
        if certificate is None:
            return None
        certificates.append(certificate)
    return min(certificates, key=lambda each: each.risk_bound)


def _relaxed_paths(scenario: Scenario, task: Relaxation, deadline: float) -> list[FloatArray]:
    """Locally best paths of the relaxation, in two homotopy classes and near their arrival steps.

    The grid is not that of `Multistart`, whose target is smaller by the margin.
    """
    free = replace(
        GuideTask.from_scenario(scenario, task.start), radius=scenario.target.radius, a_max=np.inf
    )
    multistart = Multistart(scenario, free, make_solver("ipopt"), deadline=deadline)
    candidates: list[Candidate] = []
    for path, shifts in zip(best_homotopy_classes(task, 2), ((-1, 0, 1), (0,)), strict=False):
        arrival = multistart.arrival_of(path)
        candidates += multistart.candidates_along(path, [arrival + shift for shift in shifts])
    dt = scenario.time.dt
    return [integrate(task.start, c.velocities, dt) for c in candidates if np.isfinite(c.risk)]


def _obeyed_limits(scenario: Scenario, guide: Guide) -> AccelerationLimits | None:
    """The scenario's limits of acceleration if the guide obeys them.

    The paper's penalised form has none, even if one of its guides happens to obey them.
    """
    if np.isinf(scenario.guide_a_max) or guide.solution.solver == ProjectedGradient.name:
        return None
    if scenario.time.substeps > 1:
        return None  # the bound is proven for steps without parts
    limits = acceleration_limits(scenario)
    changes = np.hypot(*np.diff(guide.positions, 2, axis=0).T)
    first = np.hypot(*(guide.positions[1] - guide.positions[0] - limits.displacement))
    obeyed = changes.max(initial=0.0) <= limits.later and first <= limits.first
    return limits if obeyed else None


def _accelerated(
    scenario: Scenario,
    guide: Guide,
    task: Relaxation,
    limits: AccelerationLimits,
    known: float,
    gap: float,
    deadline: float,
) -> AccelerationBound:
    """Bound on the paths within the limits that end as deep in the target as guides do."""
    radius = task.radius - scenario.arrival_margin
    depth = float(np.hypot(*(guide.positions[-1] - task.center))) * (1 + 8 * UNIT)
    task = replace(task, radius=max(radius, depth))
    best = guide.risk
    if guide.search != "global":
        best = min(best, _least_known_risk(scenario, task, deadline))
    return bound_with_acceleration(task, limits, best, gap=gap, deadline=deadline, known=known)


def _least_known_risk(scenario: Scenario, task: Relaxation, deadline: float) -> float:
    """Risk of the best path of a global search that ends within the relaxation's radius."""
    velocity = scenario.swarm.velocity
    start = GuideTask.from_scenario(scenario, task.start, None if velocity == "guide" else velocity)
    scenario = scenario.with_values({"guide.arrival": "any"})
    multistart = Multistart(scenario, start, make_solver("ipopt"), deadline=deadline)
    least = math.inf
    for candidate in multistart.candidates("global"):
        end = integrate(task.start, candidate.velocities, task.dt)[-1]
        if np.hypot(*(end - task.center)) <= task.radius:
            least = min(least, candidate.risk)
    return least


def plan(
    scenario: Scenario,
    solver: str | Solver = "ipopt",
    *,
    search: Search | None = None,
    check: bool = True,
    certify: bool = True,
    gap: float = GAP,
    solver_options: Mapping[str, Any] | None = None,
    execution: Execution | None = None,
    **plain: Unpack[SavedKeywords],
) -> Guide:
    """Path of least risk of a single agent from the swarm's initial position to the target.

    Parameters
    ----------
    scenario : Scenario
    solver : str or Solver
        A name of `casswarm.solvers.SOLVERS`, by default ``"ipopt"``;
        ``"projected-gradient"`` solves the paper's penalised form.
    search : {"local", "global"}, optional
        Whether to start from the straight line only, as in the paper, or also from the homotopy
        classes found by dynamic programming; the scenario's choice by default.
    check : bool
        Whether to raise an error if no start reaches the target; otherwise the best failure is
        returned.
    certify : bool
        Whether to prove a lower bound on the risk of any guide: see `Guide.risk_bound` and
        `casswarm.bounds`. Custom hazards need a ``lower_bound`` for it.
    gap : float
        Relative distance of the bound from the best known risk at which the proof may end; above
        0, below 1.
    solver_options : mapping, optional
        Options of the solver, if it is given by name.
    execution, **plain
        Values of `Execution`, in this record or as plain keywords:

        - `time_limit`: seconds for planning as a whole. A search that takes longer ends with the
          best guide so far, not certified, and `Guide.note` says so; the proof takes what is left
          of the time, and ends with the bound reached by then. Ipopt ends in time, the projected
          gradient and the building of a problem do not. By default the search takes as long as it
          needs, and the proof at most 10 seconds.
        - `progress`, which is called before every start, before every solve that may take long,
          and before the proof.

    Returns
    -------
    Guide
        The outcome of least risk among the starts and arrival steps tried (a few spread up to the
        horizon, then those next to the best); `Guide.candidates` holds all of them. Each is a local
        minimum of the program in `casswarm.problems.guide`, with its risk up to its first arrival:
        a path that crosses the target's rim before its planned last step has arrived there.

    Raises
    ------
    PlanningError
        No start reaches the target, or none within the time limit; the message and `outcomes`
        count the outcomes.
    SolverError
        A solver that is unknown, or that cannot take the guide problem.
    ValueError
        A gap or time limit out of range.
    TypeError
        A value that is given plainly and in a record, or is none of these.

    Warns
    -----
    CasswarmWarning
        No solve succeeded: the guide is a path that arrives, but no minimum. `Guide.note` says why.

    Examples
    --------
    >>> import casswarm as csw
    >>> guide = csw.plan(csw.load_scenario("single-agent"))
    >>> guide.positions.shape, guide.velocities.shape
    ((31, 2), (30, 2))
    >>> bool(guide.risk_bound <= guide.risk)
    True
    """
    require_scenario("plan", scenario)
    values = given_values("plan", execution, plain=plain, time_limit=None, progress=None)
    time_limit, progress = values
    if not 0 < gap < 1:
        raise ValueError(f"gap = {shown(gap)}; allowed: above 0, below 1 (0.01 is one percent)")
    if time_limit is not None and not time_limit > 0:
        raise ValueError(f"time_limit = {shown(time_limit)}; allowed: seconds above 0")
    started, progress = time.monotonic(), reporter(progress)
    velocity = scenario.swarm.velocity
    guide = plan_from(
        scenario,
        scenario.guide_start,
        solver,
        search=search,
        initial_velocity=None if velocity == "guide" else velocity,
        solver_options=solver_options,
        time_limit=math.inf if time_limit is None else time_limit,
        progress=progress,
    )
    if check and not guide.arrives:
        raise _no_arrival(guide)
    if guide.arrives and guide.failed and not guide.note:
        reason = f"{guide.solution.solver}: {guide.solution.message}"
        guide = replace(guide, note=f"not a minimum: no solve succeeded ({reason})")
        warnings.warn(guide.note, CasswarmWarning, stacklevel=2)
    if not (certify and guide.arrives) or guide.note:
        return guide
    if progress is not None:
        progress("proving a lower bound", 0, None)
    deadline = None if time_limit is None else started + time_limit
    certificate = certify_guide(scenario, guide, gap, deadline)
    if certificate is None:
        return guide
    return replace(guide, risk_bound=certificate.risk_bound, certificate=certificate)


def plan_baseline(scenario: Scenario, guide: Guide, *, time_limit: float | None = None) -> Guide:
    """Global search for a guide of the paper's form: no a_max, no margin, any arrival step.

    It shows what the paper's projected gradient, a local method, leaves to be found. The limits
    that it drops are those that this method ignores.

    Parameters
    ----------
    scenario : Scenario
    guide : Guide
        Compared with it: a plan of the same scenario, usually of ``"projected-gradient"``. Its
        certificate without limits of acceleration, if any, holds for the baseline, too.
    time_limit : float, optional
        Seconds, as in `plan`.

    Returns
    -------
    Guide
        With the certificate of `guide`, so that both have the same bound; not certified if it is
        not.

    Raises
    ------
    PlanningError, ValueError
        As `plan`.

    Examples
    --------
    >>> import casswarm as csw
    >>> scenario = csw.load_scenario("single-agent")
    >>> guide = csw.plan(scenario, certify=False)
    >>> csw.plan_baseline(scenario, guide).risk < guide.risk
    True
    """
    require_scenario("plan_baseline", scenario)
    relaxed = scenario.with_values(
        {
            "guide.acceleration_limited": False,
            "guide.margin": _BASELINE_MARGIN * scenario.target.radius,
            "guide.arrival": "any",
        }
    )
    baseline = plan(relaxed, search="global", certify=False, time_limit=time_limit)
    if guide.certificate is None:
        return baseline
    certificate = replace(guide.certificate, accelerated=None)
    return replace(baseline, risk_bound=certificate.bound, certificate=certificate)


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
    velocity = scenario.swarm.velocity
    first = guide.velocities[0] if velocity == "guide" else np.asarray(velocity, float)
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


def _no_arrival(guide: Guide) -> PlanningError:
    counts = ", ".join(f"{count} {status}" for status, count in guide.outcomes.items())
    advice = "try a larger a_max or t_f, a smaller guide.margin, or acceleration_limited = false"
    if guide.note:
        advice = f"{guide.note}: raise it, or choose a larger time.dt"
    return PlanningError(
        f"no guide found: of {counted(len(guide.candidates), 'solve')} ({counts}) none arrives in "
        f"the target; {advice}; check=False returns the best failure",
        outcomes=guide.outcomes,
    )
