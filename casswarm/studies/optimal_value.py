"""The optimal success probability of two members, between an exact law and a proven bound."""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import TYPE_CHECKING

from ..planning.bounds import PairBound, pair_bound, require_pair
from ..planning.guide import Guide
from ..planning.plan import initial_velocities, plan
from ..policies import make_policy
from ..scenario.io import require_scenario
from ..typing import Interval
from .evaluation import evaluate

if TYPE_CHECKING:
    from ..scenario import Scenario

TOLERANCE = 1e-3
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
    tolerance: float = TOLERANCE,
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
