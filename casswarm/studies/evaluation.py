"""Exact laws of policies, estimates for large swarms, and the optimum of two members."""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

from .._util.numbers import require_seed
from .._util.progress import reporter
from ..bounds import PairBound, pair_bound, require_pair
from ..chain.distribution import OutcomeDistribution
from ..chain.exact import MAX_MEMBERS, ExpansionOptions, StateSpaceExpansion
from ..chain.monte_carlo import Chain
from ..chain.stratified import MAX_PRUNED_FRACTION, VISITS, Estimate, sample_residual
from ..chain.transition import Lattice
from ..errors import PolicyError
from ..guide.guide import Guide
from ..guide.plan import initial_velocities, plan
from ..policies import make_policy
from ..policies.user import repeated
from ..scenario.scenario_files import require_scenario
from ..solvers import Solver, make_solver
from ..typing import FloatArray, Interval, Progress
from .inputs import policy_list, policy_name, resolve_policy, study_guide

if TYPE_CHECKING:
    from ..scenario import Scenario


TOLERANCE = 1e-3
MAX_STATES = 1_000_000
MAX_STATES_OF_LARGE = 10_000  # with more than MAX_MEMBERS members


def evaluate(
    scenario: Scenario,
    policy: Any = "leader",
    tolerance: float = TOLERANCE,
    *,
    max_states: int | None = None,
    aggregation_tol: float | None = None,
    guide: Guide | None = None,
    solver: str | Solver = "auto",
    solver_options: Mapping[str, Any] | None = None,
    progress: Progress | bool | None = None,
) -> OutcomeDistribution:
    """Compute the outcome distribution of the chain under a policy, within proven bounds.

    Nothing is sampled.

    Parameters
    ----------
    scenario : Scenario
        Of at most 12 members if `tolerance` is 0: all 2^n outcomes of a step are then enumerated.
    policy : str, Policy, or as in `simulate`
        One policy, or a list of one.
    tolerance : float
        Width of the bounds: the probability mass of unlikely states that may be left out.
    max_states : int
        Maximum number of distinct states to solve, by default a million, or ten thousand with more
        than 12 members. If that is too few for `tolerance`, the bounds are wider:
        `OutcomeDistribution.residual_mass` is their width, and `OutcomeDistribution.advice` says
        what would help.
    aggregation_tol : float, optional
        Largest spacing of the lattice of positions, in units of length. The policy's commands are
        rounded so that members move to lattice points, within v_max and a_max, and nearly equal
        states coincide. The bounds are proven for the policy with these commands. By default the
        spacing is `Policy.decision_tol` times v_max dt, which rounds no more than the policy's
        solver does: 2^-23 for policies that solve formation problems, 0 for all others. 0 rounds
        nothing; coarser lattices often need fewer states, for a policy that is rounded more.
    guide : Guide, optional
        Planned from the scenario by default.
    solver : str or Solver
        For the formation problems.
    solver_options : mapping, optional
        Options of a solver that is given by name.
    progress : Progress or bool, optional
        True for progress bars, or a function: see `Progress`. It receives the policy's name
        and the enumerated probability mass, of a total of 1.

    Returns
    -------
    OutcomeDistribution

    Raises
    ------
    PolicyError
        An unknown policy, several policies, a policy that answers the same state differently, a
        swarm that is too large for a tolerance of 0, or an `aggregation_tol` that is negative, too
        small for double precision, or too large for members to move.
    PlanningError
        No guide was found.
    ValueError
        A tolerance outside [0, 1), or fewer than one state.

    Examples
    --------
    >>> import casswarm as csw
    >>> distribution = csw.evaluate(csw.load_scenario("paper-1"), "leader", tolerance=1e-3)
    >>> low, high = distribution.success
    >>> 0 <= low <= high <= low + 1e-3
    True
    """
    require_scenario("evaluate", scenario)
    options = _options(scenario, tolerance, max_states)
    expansion, _ = _expansion(
        *(scenario, policy, options, aggregation_tol, guide, (solver, solver_options)),
        reporter(progress),
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
    aggregation_tol: float | None = None,
    guide: Guide | None = None,
    solver: str | Solver = "auto",
    solver_options: Mapping[str, Any] | None = None,
    progress: Progress | bool | None = None,
) -> Estimate:
    """Estimate the success probability: probable states are enumerated, the rest is sampled.

    For swarms whose exact distribution takes too many states. States of probability at least
    2 / `runs` are enumerated; with `max_states`, that many states, however improbable. The
    residual mass M is sampled by `runs` runs, so the interval is about M times as wide as that of
    `runs` plain runs, and narrower than that of as many plain runs as solve the same number of
    states (equal where M is nearly 1).

    Parameters
    ----------
    scenario, policy, guide, solver, solver_options
        As in `evaluate`.
    max_states, tolerance, aggregation_tol, progress
        As in `evaluate`, for the enumerated part.
    runs : int
        Number of runs that sample the residual mass, at least 1.
    seed : int
        From 0 to 2^64 - 1.

    Returns
    -------
    Estimate
        It separates what is proven from what is statistical.

    Raises
    ------
    PolicyError, PlanningError, ValueError
        As in `evaluate`; fewer than one run, or a seed out of range.
    """
    require_scenario("estimate", scenario)
    if runs < 1:
        raise ValueError(f"runs = {runs}; allowed: whole numbers from 1")
    seed = require_seed(seed)
    options = replace(
        _options(scenario, tolerance, max_states),
        max_pruned_fraction=MAX_PRUNED_FRACTION,
        min_probability=VISITS / runs if max_states is None else 0.0,
    )
    expansion, velocities = _expansion(
        *(scenario, policy, options, aggregation_tol, guide, (solver, solver_options)),
        reporter(progress),
    )
    chain = Chain(scenario, velocities, seed, lattice=expansion.options.lattice)
    return sample_residual(expansion, chain, runs)


def _options(scenario: Scenario, tolerance: float, max_states: int | None) -> ExpansionOptions:
    """Validated options of the enumeration."""
    if not 0 <= tolerance < 1:
        raise ValueError(f"tolerance = {tolerance}; allowed: from 0 to below 1")
    if max_states is None:
        max_states = MAX_STATES if scenario.n <= MAX_MEMBERS else MAX_STATES_OF_LARGE
    if max_states < 1:
        raise ValueError(f"max_states = {max_states}; allowed: whole numbers from 1")
    if scenario.n > MAX_MEMBERS and tolerance == 0:
        raise PolicyError(
            f"{scenario.name} has {scenario.n} members; a tolerance of 0 is for at most "
            f"{MAX_MEMBERS}, whose steps have {1 << MAX_MEMBERS} outcomes: give a larger tolerance",
            scenario=scenario.name,
            members=scenario.n,
            max_members=MAX_MEMBERS,
        )
    return ExpansionOptions(tolerance, max_states)


def _expansion(
    scenario: Scenario,
    policy: Any,
    options: ExpansionOptions,
    aggregation_tol: float | None,
    guide: Guide | None,
    solver: tuple[str | Solver, Mapping[str, Any] | None],
    progress: Progress | None,
) -> tuple[StateSpaceExpansion, FloatArray]:
    """Expand the chain's states; also returns V(-1)."""
    listed = policy_list(policy)
    if len(listed) > 1:
        raise PolicyError(
            f"one policy is evaluated at a time, not {len(listed)}: "
            f"{', '.join(map(policy_name, listed))}; call evaluate for each of them",
            policies=list(map(policy_name, listed)),
        )
    make_solver(solver[0], **(solver[1] or {}))  # before planning, which takes longer
    guide = study_guide(scenario, guide, solver[0], progress)
    resolved = resolve_policy(listed[0], scenario, guide, *solver)
    lattice = Lattice.along(guide, scenario, aggregation_tol, resolved.decision_tol)
    options = replace(options, lattice=lattice)
    velocities = initial_velocities(scenario, guide)
    expansion = StateSpaceExpansion(scenario, repeated(resolved), velocities, options)
    expansion.expand(progress)
    return expansion, velocities


VALUE_TOLERANCE = 1e-3
TIME_LIMIT = 60.0

_UNLIMITED = 8.0  # ||V - V'||^2 <= 8 v_max^2 for any two velocities


@dataclass(frozen=True)
class OptimalValue:
    """Brackets of the success probability of the best policy of two members.

    Parameters
    ----------
    success : Interval
        With the scenario's limit of acceleration: the exact law of the policy ``"optimal"``, and a
        bound that no policy exceeds.
    unlimited : Interval
        The same without a limit of acceleration.
    bounds : tuple of PairBound
        The proofs of the upper ends: without the limit and, unless it cannot bind, with it.
    seconds : float
    """

    success: Interval
    unlimited: Interval
    bounds: tuple[PairBound, ...]
    seconds: float

    def __str__(self) -> str:
        low, high = self.success
        free_low, free_high = self.unlimited
        return (
            f"optimal success between {low:.4f} and {high:.4f}; without a limit of acceleration "
            f"between {free_low:.4f} and {free_high:.4f}"
        )


def optimal_value(
    scenario: Scenario,
    tolerance: float = VALUE_TOLERANCE,
    *,
    time_limit: float = TIME_LIMIT,
    guide: Guide | None = None,
) -> OptimalValue:
    """Bracket the success probability of the best policy of two members, feedback included.

    Parameters
    ----------
    scenario : Scenario
        Of two members.
    tolerance : float
        Width of a bracket at which its refinement ends.
    time_limit : float
        Seconds for the upper ends. How far they are refined depends on the machine.
    guide : Guide, optional
        Provides V(-1) if the scenario leaves that to the guide; planned by default.

    Returns
    -------
    OptimalValue

    Raises
    ------
    PlanningError
        Another number of members, or a hazard without bounds of the rates of two members.

    Examples
    --------
    >>> import casswarm as csw
    >>> from casswarm.scenario.variations import with_parameters
    >>> scenario = with_parameters(csw.load_scenario("gauntlet"), {"n": 2, "time.t_f": 5.3})
    >>> low, high = csw.optimal_value(scenario, time_limit=1.0).success
    >>> 0 < low <= high <= 1
    True
    """
    require_scenario("optimal_value", scenario)
    require_pair(scenario)
    started = time.monotonic()
    guide = plan(scenario, certify=False) if guide is None else guide
    velocities = initial_velocities(scenario, guide)
    largest = _UNLIMITED * scenario.swarm.v_max**2
    free = scenario.with_values(
        {
            "swarm.a_max": max(largest, scenario.swarm.a_max),
            "swarm.velocity": velocities[0].tolist(),
            "guide.a_max": None,
        }
    )
    known = _success(scenario, guide)
    limited = scenario.swarm.a_max < largest
    free_known = max(known, _success(free, plan(free, certify=False)) if limited else known)
    deadline = time.monotonic() + time_limit
    share = time_limit / 2 if limited else time_limit
    bounds = [pair_bound(free, free_known, tolerance=tolerance, time_limit=share)]
    if limited and bounds[0].value - known > tolerance:
        left = max(0.0, deadline - time.monotonic())
        bounds.append(
            pair_bound(
                scenario,
                known,
                initial_velocities=velocities,
                tolerance=tolerance,
                time_limit=left,
            )
        )
    return OptimalValue(
        Interval(known, min(bound.value for bound in bounds)),
        Interval(free_known, bounds[0].value),
        tuple(bounds),
        time.monotonic() - started,
    )


def _success(scenario: Scenario, guide: Guide) -> float:
    """Lower bound of the exact success probability of the policy optimal."""
    policy = make_policy("optimal", scenario, guide)
    return float(evaluate(scenario, policy, tolerance=0.0, guide=guide).success.low)
