"""Policies: what every member does, from the state of the swarm."""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import TYPE_CHECKING

from .._util.text import did_you_mean
from ..errors import PolicyError
from ..optimization.solvers import ProjectedGradient, Solver, make_solver
from ..planning.bounds.value_function import ValueFunction
from ..planning.guide import Guide
from ..planning.joint import plan_swarm
from ..planning.joint.replan import PlanTree
from ..planning.plan import initial_velocities, plan, plan_from
from ..problems.formation import motion_of
from .base import Policy
from .feedback import ConstrainedFeedbackPolicy, LeaderFeedbackPolicy
from .formation import ConstrainedPolicy, LeaderPolicy
from .independent import NaivePolicy
from .joint import JointPolicy
from .joint_feedback import ReplanningPolicy
from .leader_selection import LEADER_SELECTION
from .mpc import ConstrainedMpcPolicy, LeaderMpcPolicy

if TYPE_CHECKING:
    from ..scenario import Scenario

POLICIES = {
    "naive": "every member follows a guide of its own and ignores the others",
    "constrained": "all keep to a corridor around the guide, with the least total rate",
    "leader": "one member follows the guide, the others protect it",
    "constrained-feedback": "constrained, along the best way on from where the swarm is",
    "leader-feedback": "leader, who finds the best way on from where it is",
    "joint": "the ways of all members that maximise the swarm's success, planned at once",
    "joint-replanning": "joint, and survivors plan again",
    "constrained-mpc-3": "constrained, with the next 3 steps in view, or any other number",
    "leader-mpc-3": "leader, with the next 3 steps in view, or any other number",
}
"""Names that `make_policy` takes, each with what it does."""

_AHEAD = re.compile(r"(constrained|leader)-mpc-(\d+)")


def make_policy(
    name: str,
    scenario: Scenario,
    guide: Guide | None = None,
    solver: str | Solver = "auto",
    leader_selection: str = "nearest",
    horizon: int = 1,
) -> Policy:
    """Policy of a name.

    Parameters
    ----------
    name : str
        One of `POLICIES`: ``"naive"``, ``"constrained"``, ``"leader"``, ``"constrained-feedback"``,
        ``"leader-feedback"``, ``"joint"``, ``"joint-replanning"``; or ``"constrained"`` and
        ``"leader"`` with their look-ahead, such as ``"leader-mpc-3"``.
    scenario : Scenario
    guide : Guide, optional
        Planned from the scenario by default; the policies with feedback along the guide's best way
        on need none.
    solver : str or Solver
        Of the formation problems: a name of `casswarm.optimization.solvers.SOLVERS`, by default ``"auto"``.
    leader_selection : {"nearest", "first", "safest"}
        Who leads, for ``"leader"``.
    horizon : int
        Steps that ``"leader"`` and ``"constrained"`` look ahead; with 1 they are the paper's.

    Raises
    ------
    PolicyError
        An unknown name or rule of succession, a look-ahead that is none, or a guide of another
        scenario.
    PlanningError
        No guide was found.

    Examples
    --------
    >>> import numpy as np
    >>> import casswarm as csw
    >>> scenario = csw.load_scenario("paper-1")
    >>> policy = csw.make_policy("naive", scenario)
    >>> X = scenario.positions[None]  # a batch of one state
    >>> policy.velocities(0, X, np.zeros_like(X), np.ones((1, 5), bool)).shape
    (1, 5, 2)
    """
    kind, horizon = _ahead(name, horizon)
    _require_known("leader_selection", leader_selection, LEADER_SELECTION)
    options = scenario.formation
    paper = {"step": options.learning_rate, "max_iter": options.iterations, "start": "zero"}
    backend = make_solver(solver, **(paper if solver == ProjectedGradient.name else {}))
    if guide is not None:
        _require_fitting(scenario, guide)
    if kind in ("leader-feedback", "constrained-feedback"):
        return _feedback(kind, scenario, backend)
    guide = plan(scenario, certify=False) if guide is None else guide
    if kind == "naive":
        return NaivePolicy(motion_of(scenario), member_guides(scenario, guide))
    if kind.startswith("joint"):
        return _joint(kind, scenario, guide)
    return _formation(kind, scenario, guide, backend, leader_selection, horizon)


def _feedback(kind: str, scenario: Scenario, backend: Solver) -> Policy:
    shared = (
        scenario.hazard,
        motion_of(scenario),
        ValueFunction.of(scenario, certified=False),
        backend,
    )
    if kind == "leader-feedback":
        return LeaderFeedbackPolicy(*shared)
    return ConstrainedFeedbackPolicy(*shared, scenario.formation.rho)


def _joint(kind: str, scenario: Scenario, guide: Guide) -> Policy:
    found = plan_swarm(scenario, guide=guide)
    blind = JointPolicy.of(found)
    if kind == "joint":
        return blind
    return ReplanningPolicy(PlanTree.of(scenario, found), blind)


def _formation(
    kind: str,
    scenario: Scenario,
    guide: Guide,
    backend: Solver,
    leader_selection: str,
    horizon: int,
) -> Policy:
    shared = (scenario.hazard, motion_of(scenario), guide, backend)
    rho, called = scenario.formation.rho, f"{kind}-mpc-{horizon}"
    if horizon == 1:
        leads = kind == "leader"
        return LeaderPolicy(*shared, leader_selection) if leads else ConstrainedPolicy(*shared, rho)
    if kind == "leader":
        return LeaderMpcPolicy(*shared, leader_selection, name=called, horizon=horizon)
    return ConstrainedMpcPolicy(*shared, rho, name=called, horizon=horizon)


def _ahead(name: str, horizon: int) -> tuple[str, int]:
    """A policy's name without its look-ahead, and that."""
    if found := _AHEAD.fullmatch(name):
        if horizon != 1:
            raise PolicyError(f"policy {name!r} names its look-ahead: leave out horizon")
        name, horizon = found[1], int(found[2])
    _require_known("policy", name, POLICIES)
    if not isinstance(horizon, int) or horizon < 1:
        raise PolicyError(f"horizon = {horizon!r}; allowed: whole numbers from 1")
    if horizon > 1 and name not in ("leader", "constrained"):
        raise PolicyError(f"policy {name!r} has no look-ahead; leader and constrained have")
    return name, horizon


def _require_fitting(scenario: Scenario, guide: Guide) -> None:
    if guide.dt != scenario.time.dt or tuple(guide.center) != scenario.target.center:
        raise PolicyError(
            f"this guide leads to {tuple(guide.center)} in steps of {guide.dt}, but the scenario "
            f"{scenario.name!r} has its target at {scenario.target.center} and dt "
            f"{scenario.time.dt}: plan a guide for this scenario"
        )


def member_guides(scenario: Scenario, guide: Guide) -> tuple[Guide, ...]:
    """Every member's own guide, from where it starts with the swarm's initial velocity.

    Searched for as the swarm's guide was; one that does not arrive is kept, `Guide.arrives` tells.
    """
    before = initial_velocities(scenario, guide)
    guides: dict[tuple[float, ...], Guide] = {}
    for start, velocity in zip(scenario.positions, before, strict=True):
        if tuple(start) not in guides:
            guides[tuple(start)] = plan_from(
                scenario,
                start,
                search=guide.search,
                before=velocity,
                near=guide if guide.search == "global" else None,
            )
    return tuple(guides[tuple(start)] for start in scenario.positions)


def _require_known(kind: str, name: str, known: Mapping[str, object]) -> None:
    if name not in known:
        raise PolicyError(f"{kind} {name!r} is unknown{did_you_mean(name, known)}")
