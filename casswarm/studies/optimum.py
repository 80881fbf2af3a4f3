"""The success probability of the best policy of two members, bracketed."""

from __future__ import annotations

import math
import time
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal

from ..bounds import PairBound, pair_bound, require_pair
from ..bounds.success_bound import success_bound
from ..guide.agent import initial_velocities
from ..guide.guide import Guide
from ..guide.plan import plan
from ..policies import make_policy
from ..scenario.scenario_files import require_scenario
from ..typing import Interval
from .evaluation import TOLERANCE, evaluate

if TYPE_CHECKING:
    from ..scenario import Scenario

TIME_LIMIT = 60.0
_ROUNDING = 1e-13  # of sums of probabilities, whose order depends on the machine
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
        The proofs of the upper ends: without the limit and, unless it cannot bind, with it. Where a
        bracket is not closed and `success_bound` is smaller, that is its upper end.
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
    delay: int | Literal["never"] | None = None,
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
    delay : int or "never", optional
        Number of steps after which losses are known, by default the scenario's. The lower ends are
        those of policies that get news so late; the upper ends are of policies that know losses at
        once, which can ignore what they know too early.

    Returns
    -------
    OptimalValue

    Raises
    ------
    PlanningError
        Another number of members, or a hazard without bounds of the rates of two members.
    ValueError
        A tolerance or time limit that is negative or NaN.

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
    if delay is not None:
        scenario = scenario.replace(information={"delay": delay})
    require_pair(scenario)
    for name, value in (("tolerance", tolerance), ("time_limit", time_limit)):
        if not value >= 0:
            raise ValueError(f"{name} = {value}; allowed: numbers from 0")
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
        limits: dict[str, Any] = {"tolerance": tolerance, "time_limit": left}
        bounds.append(pair_bound(scenario, known, initial_velocities=velocities, **limits))
    highest = min(bound.value for bound in bounds)
    general = success_bound(scenario).value if highest - known > tolerance else 1.0
    return OptimalValue(
        Interval(known, min(highest, general)),
        Interval(free_known, min(bounds[0].value, general)),
        tuple(bounds),
        time.monotonic() - started,
    )


def _success(scenario: Scenario, guide: Guide) -> float:
    """Lower bound of the exact success probability of the policy optimal, below rounding errors."""
    policy = make_policy("optimal", scenario, guide)
    low = evaluate(scenario, policy, tolerance=0.0, guide=guide).success.low
    return max(0.0, (math.floor(low / _ROUNDING) - 1) * _ROUNDING)
