"""Exact laws of policies on a scenario."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from .chain.evaluate import MOST_MEMBERS, Law, propagate
from .errors import PolicyError
from .guide import Guide
from .planning import plan
from .policies import as_policy, initial_velocities, make_policy
from .solvers import Solver

if TYPE_CHECKING:
    from .scenario import Scenario

TOLERANCE = 1e-4
MOST_STATES = 200_000


def evaluate(
    scenario: Scenario,
    policy: Any = "leader",
    tolerance: float = TOLERANCE,
    *,
    most_states: int = MOST_STATES,
    guide: Guide | None = None,
    solver: str | Solver = "auto",
    progress: Callable[[int, int], None] | None = None,
) -> Law:
    """Exact law of the chain under a policy, up to a bracket; no sampling.

    Parameters
    ----------
    scenario : Scenario
        Of at most 12 members: a step has 2^n outcomes.
    policy : str, Policy, or as in `simulate`
    tolerance : float
        Width of the brackets: the mass of unlikely states that may be set aside.
    most_states : int
        Distinct states kept at the most; where that is too few for `tolerance`, the brackets are
        wider, and `Law.unresolved` says how wide.
    guide : Guide, optional
        Planned from the scenario by default.
    solver : str or Solver
        Of the formation problems.
    progress : callable, optional
        Called after every step with the step and the number of states that it solved.

    Returns
    -------
    Law

    Raises
    ------
    PolicyError
        An unknown policy, or a swarm that is too large.
    PlanningError
        No guide was found.
    ValueError
        A tolerance outside [0, 1), or fewer than one state.
    """
    if not 0 <= tolerance < 1:
        raise ValueError(f"tolerance = {tolerance}; allowed: from 0 to below 1")
    if most_states < 1:
        raise ValueError(f"most_states = {most_states}; allowed: whole numbers from 1")
    if scenario.n > MOST_MEMBERS:
        raise PolicyError(
            f"{scenario.name} has {scenario.n} members; the exact law is for at most "
            f"{MOST_MEMBERS}, whose steps have {1 << MOST_MEMBERS} outcomes: use simulate"
        )
    guide = plan(scenario) if guide is None else guide
    made = (
        make_policy(policy, scenario, guide, solver)
        if isinstance(policy, str)
        else as_policy(policy)
    )
    before = initial_velocities(scenario, guide)
    return propagate(scenario, made, before, tolerance, most_states, progress)
