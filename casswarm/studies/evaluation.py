"""Exact laws of policies on a scenario."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

from ..chain.distribution import OutcomeDistribution
from ..chain.exact import MAX_MEMBERS, ExpansionOptions, StateSpaceExpansion, expand
from ..chain.monte_carlo import Chain
from ..chain.stratified import MAX_PRUNED_FRACTION, VISITS, Estimate, sample_residual
from ..errors import PolicyError
from ..optimization.solvers import Solver
from ..planning.guide import Guide
from ..planning.plan import initial_velocities, plan
from ..policies import as_policy, make_policy
from ..typing import FloatArray, Progress

if TYPE_CHECKING:
    from ..scenario import Scenario

TOLERANCE = 1e-4
MAX_STATES = 1_000_000
MAX_STATES_OF_LARGE = 10_000


def evaluate(
    scenario: Scenario,
    policy: Any = "leader",
    tolerance: float = TOLERANCE,
    *,
    max_states: int | None = None,
    aggregation_tol: float = 0.0,
    guide: Guide | None = None,
    solver: str | Solver = "auto",
    progress: Progress | None = None,
) -> OutcomeDistribution:
    """Exact law of the chain under a policy, up to a bracket; no sampling.

    Parameters
    ----------
    scenario : Scenario
        Of at most 12 members for a `tolerance` of 0, for then all 2^n outcomes of a step count.
    policy : str, Policy, or as in `simulate`
    tolerance : float
        Width of the brackets: the mass of unlikely states that may be set aside.
    max_states : int
        Distinct states solved at the most, by default a million, or ten thousand with more than 12
        members; where that is too few for `tolerance`, the brackets are
        wider, `OutcomeDistribution.residual_mass` says how wide, and `OutcomeDistribution.advice` what would help.
    aggregation_tol : float
        States in one cell of a grid of this width count as equal. The default merges what is equal
        to the last bit, so brackets are proven; a policy's solver leaves differences of about 1e-8
        between states that would be equal, so 1e-6 often needs far fewer states, and the bracket is
        then that of a chain whose states are moved by at most so much at every step.
    guide : Guide, optional
        Planned from the scenario by default.
    solver : str or Solver
        Of the formation problems.
    progress : Progress, optional
        Receives the policy's name and the enumerated probability mass, of a total of 1.

    Returns
    -------
    OutcomeDistribution

    Raises
    ------
    PolicyError
        An unknown policy, or a swarm that is too large for a tolerance of 0.
    PlanningError
        No guide was found.
    ValueError
        A tolerance outside [0, 1), fewer than one state, or a negative `aggregation_tol`.

    Examples
    --------
    >>> import casswarm as csw
    >>> law = csw.evaluate(csw.load_scenario("paper-1"), "leader", tolerance=1e-3)
    >>> low, high = law.success
    >>> 0 <= low <= high <= low + 1e-3
    True
    """
    expansion, _ = _expansion(
        scenario, policy, tolerance, max_states, aggregation_tol, guide, solver, progress
    )
    return expansion.distribution()


def estimate(
    scenario: Scenario,
    policy: Any = "leader",
    runs: int = 10_000,
    seed: int = 0,
    *,
    max_states: int | None = None,
    tolerance: float = TOLERANCE,
    aggregation_tol: float = 0.0,
    guide: Guide | None = None,
    solver: str | Solver = "auto",
    progress: Progress | None = None,
) -> Estimate:
    """Success probability of a policy: the head of its law exactly, the rest sampled.

    For swarms whose exact law takes too many states. States of a probability of at least 2 / `runs`
    are followed exactly: as many plain runs would visit nearly all of them anyway. `runs` runs then
    share the mass M that is left, so the interval is about M times as wide as that of `runs` plain
    runs, and narrower than that of as many plain runs as solve the same number of states (equal
    where M is nearly 1). With `max_states`, the head takes what you give it, however light its
    states are.

    Parameters
    ----------
    scenario, policy, max_states, tolerance, aggregation_tol, guide, solver, progress
        As in `evaluate`; the head.
    runs : int
        Runs that share the mass that the head leaves, at least 1.
    seed : int

    Returns
    -------
    Estimate
        Which states what is proven and what is statistical.

    Raises
    ------
    PolicyError, PlanningError, ValueError
        As in `evaluate`; fewer than one run, a negative seed.
    """
    for name, value, least in (("runs", runs, 1), ("seed", seed, 0)):
        if value < least:
            raise ValueError(f"{name} = {value}; allowed: whole numbers from {least}")
    expansion, velocities = _expansion(
        scenario,
        policy,
        tolerance,
        max_states,
        aggregation_tol,
        guide,
        solver,
        progress,
        MAX_PRUNED_FRACTION,
        min_probability=VISITS / runs if max_states is None else 0.0,
    )
    return sample_residual(expansion, Chain(scenario, velocities, seed), runs)


def _expansion(
    scenario: Scenario,
    policy: Any,
    tolerance: float,
    max_states: int | None,
    aggregation_tol: float,
    guide: Guide | None,
    solver: str | Solver,
    progress: Progress | None,
    max_pruned_fraction: float = math.inf,
    min_probability: float = 0.0,
) -> tuple[StateSpaceExpansion, FloatArray]:
    """The expansion of the chain, and V(-1)."""
    if not 0 <= tolerance < 1:
        raise ValueError(f"tolerance = {tolerance}; allowed: from 0 to below 1")
    if max_states is None:
        max_states = MAX_STATES if scenario.n <= MAX_MEMBERS else MAX_STATES_OF_LARGE
    if max_states < 1:
        raise ValueError(f"max_states = {max_states}; allowed: whole numbers from 1")
    if not 0 <= aggregation_tol < float("inf"):
        raise ValueError(f"aggregation_tol = {aggregation_tol}; allowed: finite numbers from 0")
    if scenario.n > MAX_MEMBERS and tolerance == 0:
        raise PolicyError(
            f"{scenario.name} has {scenario.n} members; without tolerance the law is for at most "
            f"{MAX_MEMBERS}, whose steps have {1 << MAX_MEMBERS} outcomes: give a tolerance"
        )
    guide = plan(scenario, certify=False) if guide is None else guide
    made = (
        make_policy(policy, scenario, guide, solver)
        if isinstance(policy, str)
        else as_policy(policy)
    )
    velocities = initial_velocities(scenario, guide)
    options = ExpansionOptions(
        tolerance, max_states, aggregation_tol, max_pruned_fraction, min_probability
    )
    return expand(scenario, made, velocities, options, progress), velocities
