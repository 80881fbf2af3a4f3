"""Policies by name."""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from .._util.text import did_you_mean, shown
from ..errors import PolicyError
from ..formation.task import LEADER_SELECTION
from ..grid import ValueFunction
from ..guide.agent import guide_solver, initial_velocities, papers_solver, plan_from
from ..guide.guide import Guide
from ..guide.plan import plan
from ..joint import PlanTree, plan_swarm
from ..motion.step import Motion
from ..scenario.scenario_files import require_scenario
from ..scenario.variations import require_default
from ..solvers import Solver
from ..typing import LeaderSelection
from .base import Policy, require_guide_of
from .bayes import BayesPolicy
from .formation_policies import (
    ConstrainedFeedbackPolicy,
    ConstrainedPolicy,
    FeedbackPolicy,
    FormationPolicy,
    LeaderFeedbackPolicy,
    LeaderPolicy,
)
from .planned_paths import JointPolicy, NaivePolicy, OptimalPolicy, ReplanningPolicy

if TYPE_CHECKING:
    from ..scenario import Scenario

POLICIES = {
    "naive": "every member follows its own guide and ignores the others",
    "constrained": "all members stay in a corridor around the guide, with the least total rate",
    "leader": "one member follows the guide, the others protect it",
    "constrained-feedback": "constrained, around the best path from where the swarm is",
    "leader-feedback": "leader, on the best path from where it is",
    "joint": "the paths of all members, planned at once for the swarm's success",
    "joint-replanning": "joint, and survivors replan after losses",
    "optimal": "joint-replanning for two members, from the best path of their dynamic program, too",
    "constrained-mpc-3": "constrained, with a horizon of 3 steps, or of any other number",
    "leader-mpc-3": "leader, with a horizon of 3 steps, or of any other number",
}
"""Names that `make_policy` takes, each with a description."""

_MPC = re.compile(r"(constrained|leader)-mpc-(\d+)")


def make_policy(
    name: str | Scenario,
    scenario: Scenario | str,
    guide: Guide | None = None,
    solver: str | Solver = "auto",
    *,
    leader_selection: LeaderSelection | None = None,
    horizon: int = 1,
    solver_options: Mapping[str, Any] | None = None,
) -> Policy:
    """Policy of a name.

    The name and the scenario may be given in either order.

    Parameters
    ----------
    name : str
        ``"naive"``, ``"constrained"``, ``"leader"``, ``"constrained-feedback"``,
        ``"leader-feedback"``, ``"joint"``, ``"joint-replanning"``, ``"optimal"``; or
        ``"constrained"`` and ``"leader"`` with their horizon, such as ``"leader-mpc-3"``.
    scenario : Scenario
    guide : Guide, optional
        Planned from the scenario by default; feedback policies need none.
    solver : str or Solver
        Solver of the formation problems: a name of `casswarm.solvers.SOLVERS`, by
        default ``"auto"``. With ``"projected-gradient"`` a guide that is not given is planned by
        the paper's method, too; the guides of naive members are by the method of the guide.
    leader_selection : {"nearest", "first", "safest"}, optional
        Rule that selects the leader, for ``"leader"``; by default the scenario's,
        ``formation.leader_selection``.
    horizon : int
        Number of steps over which ``"leader"`` and ``"constrained"`` optimise; with 1 they are the
        paper's policies.
    solver_options : mapping, optional
        Options of a solver given by name.

    Raises
    ------
    PolicyError
        An unknown name or rule of leader selection, an invalid horizon, or a guide of another
        scenario.
    PlanningError
        No guide was found.
    TypeError
        The first two arguments are not a name and a scenario.

    Examples
    --------
    >>> import numpy as np
    >>> import casswarm as csw
    >>> scenario = csw.load_scenario("paper-1")
    >>> policy = csw.make_policy("naive", scenario)
    >>> X = scenario.positions
    >>> policy.velocities(0, X, np.zeros_like(X), np.ones(5, bool)).shape
    (5, 2)
    """
    name, scenario = _in_order(name, scenario)
    kind, horizon = _parsed(name, horizon)
    if leader_selection is None:
        leader_selection = scenario.formation.leader_selection
    _require_known("leader_selection", leader_selection, LEADER_SELECTION)
    backend = papers_solver(scenario, solver, scenario.formation, solver_options, start="zero")
    if guide is not None:
        require_guide_of(scenario, guide)
    if kind in ("leader-feedback", "constrained-feedback"):
        return _weighing(scenario, _feedback_policy(kind, scenario.believed, backend))
    if kind == "optimal":
        OptimalPolicy.require_pair(scenario)  # before a guide is planned
    if guide is None:
        guide = plan(scenario.believed, guide_solver(solver), certify=False)
    if kind == "optimal":
        return OptimalPolicy.from_scenario(scenario, guide)
    if kind == "naive":
        return NaivePolicy(Motion.from_scenario(scenario), member_guides(scenario.believed, guide))
    if kind.startswith("joint"):
        swarm_plan = plan_swarm(scenario, guide=guide, certify=False)
        open_loop = JointPolicy.from_plan(swarm_plan)
        if kind == "joint":
            return open_loop
        return ReplanningPolicy(PlanTree(scenario, swarm_plan), open_loop)
    full_name = kind if horizon == 1 else f"{kind}-mpc-{horizon}"
    if horizon > 1:
        for key in ("swarm.speed", "swarm.kind"):
            require_default(scenario, key, f"the policy {full_name}")
    motion, options = Motion.from_scenario(scenario), scenario.formation
    shared = (scenario.believed.hazard, motion, guide, backend, horizon)
    spare = max(0, scenario.n_steps - guide.arrival)
    wait = min(spare, scenario.time.steps_within(scenario.guide.max_wait))
    counts = None if scenario.swarm.kind is None else scenario.swarm.counting
    policy: FormationPolicy
    if kind == "leader":
        own = leader_selection, full_name, options.follower_weight
        policy = LeaderPolicy(*shared, *own, max_wait=wait, counts=counts)
    else:
        policy = ConstrainedPolicy(*shared, options.rho, full_name, max_wait=wait, counts=counts)
    return _weighing(scenario, policy)


def _feedback_policy(kind: str, scenario: Scenario, solver: Solver) -> FeedbackPolicy:
    """The policy of a feedback guide, for a hazard that is known."""
    require_default(scenario, "swarm.kind", f"the policy {kind}")
    value = ValueFunction.from_scenario(scenario, certified=False)
    shared = scenario.hazard, Motion.from_scenario(scenario), value, solver
    if kind == "leader-feedback":
        weight = scenario.formation.follower_weight
        return LeaderFeedbackPolicy(*shared, follower_weight=weight)
    return ConstrainedFeedbackPolicy(*shared, scenario.formation.rho)


def _weighing(scenario: Scenario, policy: FormationPolicy | FeedbackPolicy) -> Policy:
    """The policy, or the one that weighs the cases of the hazard by their posterior."""
    if len(scenario.cases) == 1 or scenario.formation.belief == "prior":
        return policy
    return BayesPolicy(scenario, policy)


def _in_order(first: Any, second: Any) -> tuple[str, Scenario]:
    """The name and the scenario among the first two arguments of `make_policy`."""
    name, scenario = (first, second) if isinstance(first, str) else (second, first)
    if not isinstance(first, str) and not isinstance(second, str):
        raise TypeError(
            f"make_policy() needs the name of a policy and a Scenario, not {type(first).__name__} "
            f"and {type(second).__name__}; casswarm.as_policy makes a policy of a function or an "
            "object"
        )
    require_scenario("make_policy", scenario)
    return name, scenario


def _parsed(name: str, horizon: int) -> tuple[str, int]:
    """A policy's name without its horizon, and the horizon."""
    if match := _MPC.fullmatch(name):
        if horizon != 1:
            raise PolicyError(
                f"policy {name!r} includes its horizon: omit horizon = {horizon}", policy=name
            )
        name, horizon = match[1], int(match[2])
    _require_known("policy", name, POLICIES)
    if not isinstance(horizon, int) or horizon < 1:
        raise PolicyError(
            f"horizon = {shown(horizon)}; allowed: whole numbers from 1",
            policy=name,
            horizon=horizon,
        )
    if horizon > 1 and name not in ("leader", "constrained"):
        raise PolicyError(
            f"policy {name!r} has no horizon; leader and constrained have one",
            policy=name,
            horizon=horizon,
        )
    return name, horizon


def require_policy_name(name: str) -> None:
    """Raise PolicyError for a name that `make_policy` does not take."""
    _parsed(name, 1)


def _require_known(kind: str, name: str, known: Mapping[str, object]) -> None:
    if name not in known:
        message = f"{kind} {name!r} is unknown{did_you_mean(name, known)}"
        raise PolicyError(message, **{kind: name})


def member_guides(
    scenario: Scenario, guide: Guide, solver_options: Mapping[str, Any] | None = None
) -> tuple[Guide, ...]:
    """Every member's own guide, from its initial position and velocity.

    They are planned with the search of the swarm's guide, by projected gradient if that is its
    method, else by Ipopt. One that does not arrive is included, see `Guide.arrives`.
    """
    near = guide if guide.search == "global" else None
    guides: dict[tuple[object, ...], Guide] = {}
    velocities = initial_velocities(scenario, guide)
    starts = [*zip(scenario.swarm.member_kinds, *scenario.positions.T.tolist(), strict=True)]
    for member, start in enumerate(starts):
        if start not in guides:
            guides[start] = plan_from(
                scenario.with_kind_of(member),
                start[1:],
                guide_solver(guide.solution.solver),
                search=guide.search,
                initial_velocity=velocities[member],
                near=near,
                solver_options=solver_options,
            )
    return tuple(guides[start] for start in starts)
