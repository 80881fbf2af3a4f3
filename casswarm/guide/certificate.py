"""Certificates of guides: bounds on the risk of all paths, with and without acceleration limits."""

from __future__ import annotations

import math
import time
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ..bounds import (
    AccelerationBound,
    AccelerationLimits,
    acceleration_limits,
    bound_with_acceleration,
)
from ..bounds.acceleration_kernels import compile_kernels
from ..bounds.risk_bound import GAP, Certificate, arrival_multiplier, certify
from ..errors import PlanningError
from ..formation import ProjectedGradient
from ..grid.nodes import UNIT, Relaxation
from ..hazard import subdivided
from ..motion.kinematics import integrate
from ..problems.guide import GuideTask
from ..scenario import Scenario
from ..solvers import make_solver
from ..typing import FloatArray
from .agent import plan_from
from .frame import Frame
from .guide import Candidate, Guide
from .multistart import Multistart, best_homotopy_classes

TIME_LIMIT = 10.0
"""Seconds of a proof by default."""

_SHARE = 0.3  # of the time, for the bound without limits of acceleration if there are any


def certify_guide(
    scenario: Scenario,
    guide: Guide,
    gap: float = GAP,
    deadline: float | None = None,
    others: Sequence[Guide] = (),
) -> Certificate | None:
    """Certificate for the guides of a scenario; None if its hazard provides no lower bounds.

    The first bound, on the risk of all paths that obey the speed limit, is compared with the best
    known one: the guide itself, or what Ipopt reaches from the best homotopy classes. If it is not
    within `gap` of the guide's risk, and the guide obeys limits of acceleration, the second bound
    is for the paths that obey them, too, and end as deep in the target as this guide and `others`.
    With ``time.substeps`` there is only the first, of paths that may turn and arrive after every
    part of a step. The `deadline` is a time of `time.monotonic`; by default the proof takes at most
    10 seconds.

    Scenarios that differ by quarter turns and mirrors have the same bounds, for the same guide.
    """
    scenario = scenario.for_guide
    if scenario.target.other:
        return _certified_for_all(scenario, guide, gap, deadline)
    frame = Frame.of_agent(scenario, guide.positions[0], guide.velocities[0])
    scenario = frame.scenario_in(scenario)
    guide, *others = map(frame.guide_to, (guide, *others))
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
    left = TIME_LIMIT if deadline is None else max(0.0, deadline - time.monotonic())
    left *= 1.0 if limits is None else _SHARE
    multiplier = arrival_multiplier(task, paths[best])
    certificate = certify(task, risks[best], multiplier, gap=gap, time_limit=left)
    if limits is None or certificate.bound >= (1 - gap) * guide.risk:
        return certificate
    if deadline is None:
        compile_kernels()  # not at the expense of the proof
        deadline = time.monotonic() + TIME_LIMIT - certificate.seconds
    proof = task, limits, certificate.bound, gap, deadline
    accelerated = _accelerated(scenario, guide, others, *proof)
    return replace(certificate, accelerated=accelerated)


def _certified_for_all(
    scenario: Scenario, guide: Guide, gap: float, deadline: float | None
) -> Certificate | None:
    """The certificate of the target zone with the least bound, as `certify_guide`.

    The guide that is compared is the given one: a bound above its risk shows that no path to a
    target zone is better.
    """
    certificates, targets = [], scenario.by_target
    initial = scenario.swarm.initial_velocity
    share = TIME_LIMIT if deadline is None else max(0.0, deadline - time.monotonic())
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
    others: Sequence[Guide],
    task: Relaxation,
    limits: AccelerationLimits,
    known: float,
    gap: float,
    deadline: float,
) -> AccelerationBound:
    """Bound on the paths within the limits that end as deep in the target as all guides do."""
    radius = task.radius - scenario.arrival_margin
    ends = np.array([each.positions[-1] for each in (guide, *others)]) - task.center
    depth = float(np.hypot(*ends.T).max()) * (1 + 8 * UNIT)
    task = replace(task, radius=max(radius, depth))
    best = guide.risk
    if guide.search != "global":
        best = min(best, _least_known_risk(scenario, task, deadline))
    return bound_with_acceleration(task, limits, best, gap=gap, deadline=deadline, known=known)


def _least_known_risk(scenario: Scenario, task: Relaxation, deadline: float) -> float:
    """Risk of the best path of a global search that ends within the relaxation's radius."""
    start = GuideTask.from_scenario(scenario, task.start, scenario.swarm.initial_velocity)
    scenario = scenario.with_values({"guide.arrival": "any"})
    multistart = Multistart(scenario, start, make_solver("ipopt"), deadline=deadline)
    least = math.inf
    for candidate in multistart.candidates("global"):
        end = integrate(task.start, candidate.velocities, task.dt)[-1]
        if np.hypot(*(end - task.center)) <= task.radius:
            least = min(least, candidate.risk)
    return least
