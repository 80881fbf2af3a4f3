"""A proven upper bound on the success probability of every policy, feedback included.

A member that arrives has been through a risk of at least r_i, whoever protected it: the least
cumulated rate phi(b) along any path from where it starts that obeys the speed limit, with phi from
`Hazard.least_rate` and b the lone rate. Give every member an independent clock, exponential of mean
1, and let it be lost when its cumulated risk exceeds the clock: that is the chain. Success needs
some clock above r_i, so

    P(success) <= 1 - prod_i (1 - exp(-r_i)).

Limits of acceleration only take paths away. The proof, and what it leaves out, is in
``docs/joint.md``.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import TYPE_CHECKING

import casadi as ca
import numpy as np

from ...hazard import Hazard
from ...hazard.protection import LeastRate
from ...typing import BoolArray, Expr, FloatArray
from .dynamic_programming import StageCosts, backward, least, spread, trace
from .grid import Block, Grid, Relaxation
from .risk_bound import arrival_multiplier, first_grid, rounding

if TYPE_CHECKING:
    from ...scenario import Scenario

NODES = 1_000_000
"""Nodes of the grid, over all steps."""

_SKETCH = 50_000
"""Nodes of the grid on which the multiplier of arrival is estimated."""

_ROUNDED = 1 - 1e-12  # down by more than the rounding of exponentials and products


@dataclass(frozen=True)
class SuccessBound:
    """What no policy can exceed, whatever it observes.

    Parameters
    ----------
    failure : float
        Proven lower bound on the probability that nobody arrives.
    risks : (n,)
        Proven lower bounds r_i on each member's cumulated risk at its arrival; infinite for one
        that cannot arrive by t_f, 0 where nothing is proven.
    reason : str
        Why nothing is proven, empty where the bound is certified.
    """

    failure: float
    risks: tuple[float, ...]
    reason: str = ""

    @property
    def certified(self) -> bool:
        """Whether anything is proven."""
        return not self.reason

    @property
    def value(self) -> float:
        """The bound on the success probability, 1 where nothing is proven."""
        return min(1.0, math.nextafter(1.0 - self.failure, 2.0))

    def __float__(self) -> float:
        return self.value

    def as_dict(self) -> dict[str, object]:
        """Plain values, for a record."""
        return {
            "bound": self.value,
            "failure": self.failure,
            "risks": list(self.risks),
            "certified": self.certified,
            "reason": self.reason,
        }

    def __str__(self) -> str:
        if not self.certified:
            return f"success is not certified: {self.reason}"
        if self.failure < 1e-9:
            return f"no policy can exceed 1 - {_rounded_down(self.failure):.1e}"
        digits = max(4, 1 - math.floor(math.log10(self.failure)))
        above = math.ceil(self.value * 10.0**digits) / 10.0**digits
        return f"no policy can exceed {above:.{digits}f}"


def _rounded_down(value: float) -> float:
    """To two significant digits; 0 stays."""
    if value <= 0.0:
        return 0.0
    scale = 10.0 ** (1 - math.floor(math.log10(value)))
    return math.floor(value * scale) / scale if math.isfinite(scale) else 0.0


def success_bound(scenario: Scenario, nodes: int = NODES) -> SuccessBound:
    """Proven upper bound on the probability that some member arrives alive, for every policy.

    Feedback, randomness and memory included, whatever the limits of acceleration.

    Parameters
    ----------
    scenario : Scenario
    nodes : int
        Of the grid: more of them sharpen the members' risks, whose error falls as 1 / nodes where
        time steps need not be merged.

    Returns
    -------
    SuccessBound
        1, with a reason, where the hazard does not tell how well members can protect each other:
        the paper's two do.

    Raises
    ------
    ValueError
        Fewer than a thousand nodes.
    """
    if nodes < 1000:
        raise ValueError(f"nodes = {nodes!r}; allowed: whole numbers from 1000")
    return _bound(scenario, nodes)


@lru_cache(maxsize=64)
def _bound(scenario: Scenario, nodes: int) -> SuccessBound:
    hazard = scenario.hazard
    phi, start = hazard.least_rate(scenario.n), scenario.guide_start
    if phi is None or hazard.single_agent_lower_bound(start, start) is None:
        reason = (
            f"{type(hazard).__name__} does not tell the least rate of a member among "
            f"{scenario.n}; Saturation and SaturationCollision do"
        )
        return SuccessBound(0.0, (0.0,) * scenario.n, reason)
    task = replace(Relaxation.of(scenario), hazard=ProtectedHazard(hazard, phi))
    risks = lowest_risks(task, scenario.positions, nodes)
    failure = _ROUNDED * float(np.prod(-np.expm1(-risks)))
    return SuccessBound(failure, tuple(risks.tolist()))


def lowest_risks(task: Relaxation, starts: FloatArray, nodes: int) -> FloatArray:
    """Lower bounds (n,) on the risk of every path from each of `starts` (n, 2) to the target.

    Infinite where none arrives in time. One grid serves all starts: rounded to it at random, a
    path begins at the corners of its start's cell, and what the recursion finds there is
    interpolated.
    """
    grid = Grid.around(task, starts, nodes)
    prices = StageCosts(grid, multiplier=_multiplier(task))
    values = backward(prices)
    at = (starts - task.start) / grid.spacing
    cell = np.floor(at).astype(int)
    low = cell.min(axis=0)
    corner = Block((int(low[0]), int(low[1])), np.ones(tuple(cell.max(axis=0) - low + 1), bool))
    begin = spread(values[0], grid.blocks[0], corner, grid.reach)
    if grid.merged > 1:  # paths that arrive before their first sample
        begin = np.minimum(begin, prices.arrivals(corner))
    weight, first = at - cell, cell - low
    risks = np.zeros(len(starts))
    for i in (0, 1):
        for j in (0, 1):
            share = np.abs(1 - i - weight[:, 0]) * np.abs(1 - j - weight[:, 1])
            value = begin[first[:, 0] + i, first[:, 1] + j]
            risks += np.where(share > 0, share * np.where(share > 0, value, 0.0), 0.0)
    known = risks[np.isfinite(risks)]
    slack = rounding(prices, float(known.max(initial=0.0)))
    return np.where(
        _in_time(task, starts), np.maximum(0.0, np.minimum(risks, 1e300) - slack), np.inf
    )


def _in_time(task: Relaxation, starts: FloatArray) -> BoolArray:
    """Whether the target is within reach of starts (n, 2)."""
    missing = np.maximum(np.abs(task.center - starts) - task.steps * task.step, 0.0)
    return np.asarray(np.hypot(*missing.T) <= task.radius * (1 + 1e-9))


def _multiplier(task: Relaxation) -> float:
    """Of arrival, by the best path on the nodes of a small grid: any value is valid."""
    grid = first_grid(task, _SKETCH)
    prices = StageCosts(grid, certified=False, inside=True)
    values = backward(prices)
    if grid.merged > 1 or not np.isfinite(least(prices, values)):
        return 0.0
    path = task.start + grid.spacing * np.array(trace(prices, values), float)
    return arrival_multiplier(task, path, task.step / task.dt)


@dataclass(frozen=True, eq=False)
class ProtectedHazard(Hazard):
    """A member's least rate among n, wherever it is: a hazard of lone members.

    Parameters
    ----------
    base : Hazard
    least : LeastRate
    """

    base: Hazard
    least: LeastRate

    @property
    def radar_positions(self) -> FloatArray:
        """Those of the hazard itself."""
        return self.base.radar_positions

    def lone_expression(self, points: Expr) -> Expr:
        """phi of the lone rate, (2, m) to (1, m)."""
        rates = self.base.lone_expression(points)
        found = math.inf
        for intercept, slope in zip(self.least.intercepts, self.least.slopes, strict=True):
            found = ca.fmin(found, float(intercept) + float(slope) * rates)
        return found

    def expression(self, positions: Expr, alive: Expr) -> Expr:  # noqa: ARG002
        """Everybody as if the others were where they protect best."""
        return self.lone_expression(positions)

    def _evaluate(self, positions: FloatArray, alive: BoolArray) -> FloatArray:  # noqa: ARG002
        return self.least(self.base.single_agent_rates(positions))

    def single_agent_lower_bound(self, lower: FloatArray, upper: FloatArray) -> FloatArray | None:
        """phi does not fall: of the least lone rate."""
        found = self.base.single_agent_lower_bound(lower, upper)
        return None if found is None else self.least(np.maximum(found, 0.0))

    def lone_rates_below(
        self, east: FloatArray, north: FloatArray, spacing: float
    ) -> FloatArray | None:
        """Phi of the values below the lone rate: concave, it keeps interpolation below.

        I phi(v) <= phi(I v) <= phi(b) for I v <= b, where all v are at least 0; else the least
        rates of the cells around each node.
        """
        below = self.base.lone_rates_below(east, north, spacing)
        if below is None:
            return None
        if (below < 0).any():
            return super().lone_rates_below(east, north, spacing)
        return self.least(below)
