"""Policies: what every member does, from the state of the swarm."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

from ..certificate.value import ValueFunction
from ..errors import PolicyError, among
from ..guide import Guide
from ..planning import initial_velocities, plan, plan_from
from ..problems.formation import motion_of
from ..solvers import ProjectedGradient, Solver, make_solver
from ..swarm import plan_swarm
from ..swarm.replanning import PlanTree
from .base import Decision, Policy, UserPolicy, as_policy
from .feedback import ConstrainedFeedbackPolicy, LeaderFeedbackPolicy
from .formation import ConstrainedPolicy, LeaderPolicy
from .joint import JointPolicy
from .joint_feedback import JointFeedbackPolicy
from .naive import NaivePolicy
from .succession import SUCCESSIONS

if TYPE_CHECKING:
    from ..scenario import Scenario

POLICIES = {
    "naive": "every member follows a guide of its own and ignores the others",
    "constrained": "all keep to a corridor around the guide, with the least total rate",
    "leader": "one member follows the guide, the others protect it",
    "constrained-feedback": "constrained, along the best way on from where the swarm is",
    "leader-feedback": "leader, who finds the best way on from where it is",
    "joint": "the ways of all members that maximise the swarm's success, planned at once",
    "joint-feedback": "joint, and survivors plan again",
}
"""Names that `make_policy` takes, each with what it does."""


def make_policy(
    name: str,
    scenario: Scenario,
    guide: Guide | None = None,
    solver: str | Solver = "auto",
    succession: str = "nearest",
) -> Policy:
    """Policy of a name.

    Parameters
    ----------
    name : {"naive", "constrained", "leader", "constrained-feedback", "leader-feedback", "joint", \
            "joint-feedback"}
    scenario : Scenario
    guide : Guide, optional
        Planned from the scenario by default; the policies with feedback need none.
    solver : str or Solver
        Of the formation problems: a name of `casswarm.solvers.SOLVERS`, by default ``"auto"``.
    succession : {"nearest", "first", "safest"}
        Who leads, for ``"leader"``.

    Raises
    ------
    PolicyError
        An unknown name or rule of succession, or a guide of another scenario.
    PlanningError
        No guide was found.

    Examples
    --------
    >>> import numpy as np
    >>> import casswarm as cs
    >>> scenario = cs.load_scenario("paper-1")
    >>> policy = cs.make_policy("naive", scenario)
    >>> X = scenario.positions[None]  # a batch of one state
    >>> policy.velocities(0, X, np.zeros_like(X), np.ones((1, 5), bool)).shape
    (1, 5, 2)
    """
    _require_known("policy", name, POLICIES)
    _require_known("succession", succession, SUCCESSIONS)
    motion, options = motion_of(scenario), scenario.formation
    paper = {"step": options.learning_rate, "iterations": options.iterations, "start": "zero"}
    backend = make_solver(solver, **(paper if solver == ProjectedGradient.name else {}))
    if guide is not None:
        _require_fitting(scenario, guide)
    if name in ("leader-feedback", "constrained-feedback"):
        value = ValueFunction.of(scenario, certified=False)
        if name.startswith("leader"):
            return LeaderFeedbackPolicy(scenario.hazard, motion, value, backend)
        return ConstrainedFeedbackPolicy(scenario.hazard, motion, value, backend, options.rho)
    guide = plan(scenario, certify=False) if guide is None else guide
    if name.startswith("joint"):
        joint = plan_swarm(scenario, guide=guide)
        blind = JointPolicy.of(joint)
        if name == "joint":
            return blind
        return JointFeedbackPolicy(PlanTree.of(scenario, joint), blind)
    if name == "naive":
        return NaivePolicy(motion, member_guides(scenario, guide))
    if name == "leader":
        return LeaderPolicy(scenario.hazard, motion, guide, backend, succession)
    return ConstrainedPolicy(scenario.hazard, motion, guide, backend, options.rho)


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
        raise PolicyError(f"{kind} {name!r} is unknown{among(name, known)}")


__all__ = [
    "POLICIES",
    "SUCCESSIONS",
    "ConstrainedFeedbackPolicy",
    "ConstrainedPolicy",
    "Decision",
    "JointFeedbackPolicy",
    "JointPolicy",
    "LeaderFeedbackPolicy",
    "LeaderPolicy",
    "NaivePolicy",
    "Policy",
    "UserPolicy",
    "as_policy",
    "initial_velocities",
    "make_policy",
    "member_guides",
    "motion_of",
]
