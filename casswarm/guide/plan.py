"""Guides of a scenario: the best outcome of a multistart search, with a certificate."""

from __future__ import annotations

import math
import time
import warnings
from collections.abc import Mapping
from dataclasses import replace
from typing import Any, Literal, TypeAlias, overload

from typing_extensions import Unpack

from .._util.progress import reporter
from .._util.settings import Execution, SavedKeywords, given_values
from .._util.text import counted, shown
from ..bounds.risk_bound import GAP
from ..errors import CasswarmWarning, PlanningError
from ..scenario import Scenario
from ..scenario.ambiguity import Ambiguity, AmbiguityLike
from ..scenario.scenario_files import require_scenario
from ..solvers import Solver
from ..typing import Search
from .agent import plan_from
from .certificate import certify_guide
from .guide import Guide
from .mixture import MixedGuide, plan_mixture
from .risk_mixture import plan_risk_mixture

_BASELINE_MARGIN = 1e-6  # of the radius: rounding must not leave the last step outside the target


Objective: TypeAlias = Literal["survival", "risk"]


@overload
def plan(
    scenario: Scenario,
    solver: str | Solver = ...,
    *,
    ambiguity: None = ...,
    objective: Objective = ...,
    search: Search | None = ...,
    check: bool = ...,
    certify: bool = ...,
    gap: float = ...,
    solver_options: Mapping[str, Any] | None = ...,
    execution: Execution | None = ...,
    **plain: Unpack[SavedKeywords],
) -> Guide: ...


@overload
def plan(
    scenario: Scenario,
    solver: str | Solver = ...,
    *,
    ambiguity: AmbiguityLike,
    objective: Objective = ...,
    certify: bool = ...,
    gap: float = ...,
    execution: Execution | None = ...,
    **plain: Unpack[SavedKeywords],
) -> MixedGuide: ...


def plan(
    scenario: Scenario,
    solver: str | Solver = "ipopt",
    *,
    ambiguity: AmbiguityLike | None = None,
    objective: Objective = "survival",
    search: Search | None = None,
    check: bool = True,
    certify: bool = True,
    gap: float = GAP,
    solver_options: Mapping[str, Any] | None = None,
    execution: Execution | None = None,
    **plain: Unpack[SavedKeywords],
) -> Guide | MixedGuide:
    """Path of least risk of a single agent from the swarm's initial position to the target.

    Parameters
    ----------
    scenario : Scenario
    solver : str or Solver
        A name of `casswarm.solvers.SOLVERS`, by default ``"ipopt"``;
        ``"projected-gradient"`` solves the paper's penalised form.
    ambiguity : {"mean", "worst"}, ("cvar", a) or ("tv", r), optional
        Of a hazard that is not known (``[[hazard.case]]``): the priors q for which a mixture of
        paths shall be good. The prior p of the scenario; all of them; q <= p / a, the mean over the
        worst fraction a of *cases* (of the event of survival itself CVaR would say nothing); or
        sum_k abs(q_k - p_k) <= r.
    objective : {"survival", "risk"}
        With cases, ``"risk"`` plans for means of the risks, as much of the literature does,
        instead of the mean survival; without `ambiguity`, the guide of the prior mean.
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
    Guide or MixedGuide
        With `ambiguity` a mixture of guides with its value between proven ends, for a hazard that
        is known the mixture of one. Else the outcome of least risk among the starts and arrival
        steps tried (a few spread up to the horizon, then those next to the best);
        `Guide.candidates` holds all of them. Each is a local minimum of the program in
        `casswarm.problems.guide`, with its risk up to its first arrival: a path that crosses the
        target's rim before its planned last step has arrived there.

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
    if objective not in ("survival", "risk"):
        raise ValueError(f"objective = {shown(objective)}; allowed: 'survival', 'risk'")
    weights = [case.weight for case in scenario.cases]
    if ambiguity is not None:
        chosen = Ambiguity.of(ambiguity)
        _require_mixture(solver, search, solver_options)
        if len(weights) > 1:
            options: dict[str, Any] = {"certify": certify, "gap": gap, "progress": progress}
            planned = plan_risk_mixture if objective == "risk" else plan_mixture
            return planned(scenario, chosen, time_limit=time_limit, **options)
        limits: dict[str, Any] = {"time_limit": time_limit, "progress": progress}
        known = plan(scenario, check=check, certify=certify, gap=gap, **limits)
        return MixedGuide.of_guide(known, chosen, objective)
    if objective == "risk":
        scenario = scenario.believed
    guide = plan_from(
        scenario,
        scenario.guide_start,
        solver,
        search=search,
        initial_velocity=scenario.swarm.initial_velocity,
        solver_options=solver_options,
        time_limit=math.inf if time_limit is None else time_limit,
        progress=progress,
    )
    if check and not guide.arrives:
        raise _no_arrival(scenario, guide)
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


def _require_mixture(solver: object, search: object, options: object) -> None:
    """Refuse arguments that a mixture of guides does not take."""
    given = {"solver": solver != "ipopt", "search": search is not None}
    given |= {"solver_options": options is not None}
    if names := [name for name, is_given in given.items() if is_given]:
        raise ValueError(
            f"{names[0]}= is not for a mixture of guides: leave it out, or plan without ambiguity="
        )


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


def _no_arrival(scenario: Scenario, guide: Guide) -> PlanningError:
    from .remedies import remedies  # seldom needed

    counts = ", ".join(f"{count} {status}" for status, count in guide.outcomes.items())
    found = None if guide.note else remedies(scenario)
    advice = "there are paths that obey all limits: try Ipopt with guide.search = 'global'"
    if guide.note:
        advice = f"{guide.note}: raise it, or choose a larger time.dt"
    elif found is None:
        advice = "try a larger a_max or t_f, or a smaller guide.margin"
    elif found:
        changes = "".join(f"\n  {change}" for change in found)
        advice = f"the limits of motion contradict each other, and one change is enough:{changes}"
    return PlanningError(
        f"no guide found: of {counted(len(guide.candidates), 'solve')} ({counts}) none arrives in "
        f"the target; check=False returns the best failure; {advice}",
        outcomes=guide.outcomes,
        remedies=found,
    )
