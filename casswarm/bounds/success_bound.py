"""A proven upper bound on the success probability of every policy, feedback included.

The least of two bounds:

- *independent clocks*: with r_i a lower bound on the risk that member i has accumulated when it
  arrives, whichever members protect it, P(success) <= 1 - prod_i (1 - exp(-r_i)): the proof is in
  ``docs/joint.md``. r_i is the least integral of phi(b) along any path from the member's initial
  position within the speed limit, with phi from `Hazard.least_rate` and b the single-agent rate.
  Where k > 1 members must arrive (``success.arrivals``), it is the probability that at least k of
  independent events of probability exp(-r_i) occur.
- *level game*: `casswarm.bounds.level_game`, which accounts for the protection that the
  lost no longer give; the proof is in ``docs/success-bound.md``. It is played for one arrival,
  whose probability is not exceeded by that of several.
"""

from __future__ import annotations

import math
import time
from dataclasses import dataclass, replace
from decimal import ROUND_FLOOR, Context
from functools import lru_cache

import numpy as np

from .._util.numbers import rounded_up
from .._util.text import shown
from ..grid.dynamic_programming import StageCosts, costs_to_go, least_cost, rounding, trace
from ..grid.nodes import Grid, NodeBlock, Relaxation, extremum_within_reach, multilinear, node_count
from ..scenario import Scenario
from ..scenario.ambiguity import Ambiguity, AmbiguityLike
from ..scenario.scenario_files import require_scenario
from ..typing import FloatArray
from .level_game import Effort, game_bound
from .risk_bound import arrival_multiplier

MAX_NODES = 1_000_000  # default maximum of nodes of the grid, over all steps
MAX_WORK = 6e7  # default of a level game, about a second; 1.5e8 is worth while for five members
ACCURACY = 0.01  # default relative improvement of the bound on failure to refine for
CLOCKS, GAME = "independent clocks", "level game"  # methods

_MULTIPLIER_NODES = 50_000  # of the grid on which the multiplier of arrival is estimated
_GAME_NODES = 4  # of potentials, for a node of the grid of risks
_ROUND_DOWN = 1 - 1e-12  # by more than the rounding of exponentials and products


@dataclass(frozen=True)
class SuccessBound:
    """Upper bound on the success probability of every policy, whatever it observes.

    Parameters
    ----------
    failure : float
        Proven lower bound on the probability of failure: that too few members arrive.
    risks : (n,)
        Proven lower bounds r_i on each member's accumulated risk at its arrival; infinite for a
        member that cannot arrive by t_f, 0 if nothing is proven.
    reason : str
        Why nothing is proven; empty for a certified bound.
    method : str
        Which bound it is: "independent clocks" or "level game".
    seconds : float
        Time that it took.
    limited : bool
        Whether the time limit ended its refinement: on a faster machine it might be lower.
    cases : tuple of SuccessBound
        Of a hazard that is not known, the bound of every case: `failure` is the least mean of
        theirs over the possible priors, and holds even if members knew the case.
    """

    failure: float
    risks: tuple[float, ...]
    reason: str = ""
    method: str = CLOCKS
    seconds: float = 0.0
    limited: bool = False
    cases: tuple[SuccessBound, ...] = ()

    @property
    def certified(self) -> bool:
        """True if a bound is proven."""
        return not self.reason

    @property
    def value(self) -> float:
        """The bound on the success probability; 1 if nothing is proven."""
        return min(1.0, math.nextafter(1.0 - self.failure, 2.0))

    def __float__(self) -> float:
        return self.value

    def as_dict(self) -> dict[str, object]:
        """Plain values, for a record."""
        names = ("failure", "risks", "certified", "reason", "method", "seconds", "limited")
        values = {name: getattr(self, name) for name in names} | {"risks": list(self.risks)}
        if self.cases:
            values["cases"] = [case.value for case in self.cases]
        return {"bound": self.value} | values

    def __str__(self) -> str:
        if not self.certified:
            return f"success is not certified: {self.reason}"
        if self.failure == 0.0:
            return f"no policy can exceed 1 ({self.method})"
        if self.failure < 1e-9:
            below = Context(prec=2, rounding=ROUND_FLOOR).create_decimal_from_float(self.failure)
            return f"no policy can exceed 1 - {float(below):.1e} ({self.method})"
        digits = max(4, 1 - math.floor(math.log10(self.failure)))
        value = f"{rounded_up(self.value, digits):.{digits}f}"
        return f"no policy can exceed {value} ({self.method})"


def success_bound(
    scenario: Scenario,
    max_nodes: int = MAX_NODES,
    *,
    max_work: float = MAX_WORK,
    accuracy: float = ACCURACY,
    time_limit: float = math.inf,
    ambiguity: AmbiguityLike | Ambiguity = "mean",
) -> SuccessBound:
    """Proven upper bound on the success probability of every policy.

    The bound covers feedback, randomised and history-dependent policies, with any acceleration.
    Where members differ, all of them are as safe, fast and protective as any (a relaxation), and
    the level game lets all arrivals count. The bound depends on the speed of the machine only if a
    time limit ends its refinement.

    Parameters
    ----------
    scenario : Scenario
    max_nodes : int
        Of a grid, which takes at most 400 bytes of memory a node: 400 MB by default, wherever the
        members are. More nodes sharpen the members' risks, whose error falls as 1 / nodes if the
        grid can sample every time step.
    max_work : float
        Largest number of values that a level game looks up, about: 1e8 take a few seconds. More
        work usually, not always, gives a lower bound. Finite; 0 for the bound of independent clocks
        alone, which takes some hundredths of a second.
    accuracy : float
        The level game is refined until this raises the lower bound on the probability of failure by
        less than this fraction of it.
    time_limit : float
        Seconds after which no further game is begun, of every case if the hazard is not known.
    ambiguity : str or (str, float)
        Of a hazard that is not known: the priors against which no policy exceeds the bound, as in
        `casswarm.plan`; by default the scenario's own. The bound is the least mean over these of
        those of the cases.

    Returns
    -------
    SuccessBound
        1, with a reason, if the hazard does not provide the least rate of a member among others;
        the paper's two hazards do.

    Raises
    ------
    ValueError
        Fewer than a thousand nodes, an infinite work, or a negative work, accuracy or time.
    PlanningError
        An unknown set of priors.
    """
    chosen = Ambiguity.of(ambiguity)
    require_scenario("success_bound", scenario)
    if max_nodes < 1000:
        raise ValueError(f"max_nodes = {shown(max_nodes)}; allowed: whole numbers from 1000")
    limits = {"max_work": max_work, "accuracy": accuracy, "time_limit": time_limit}
    for name, limit in limits.items():
        if not limit >= 0:
            raise ValueError(f"{name} = {shown(limit)}; allowed: numbers from 0")
    if max_work == math.inf:
        raise ValueError("max_work = inf; allowed: finite numbers from 0, for example 1e9")
    compute = _bound if time_limit == math.inf else _bound.__wrapped__  # which may be limited
    options = max_nodes, max_work, accuracy, time_limit
    cases = [compute(case.scenario, *options) for case in scenario.cases]
    if len(cases) == 1:
        return cases[0]
    prior = np.array([case.weight for case in scenario.cases])
    worst = chosen.worst_prior(np.array([1.0 - case.failure for case in cases]), prior)
    used = [case for case, weight in zip(cases, worst, strict=True) if weight > 0]
    failure = _ROUND_DOWN * float(worst @ [case.failure for case in cases])
    return SuccessBound(
        failure if all(case.certified for case in used) else 0.0,
        tuple(np.min([case.risks for case in cases], axis=0).tolist()),
        next((case.reason for case in used if case.reason), ""),
        CLOCKS if all(case.method == CLOCKS for case in used) else GAME,
        math.fsum(case.seconds for case in cases),
        any(case.limited for case in cases),
        tuple(cases),
    )


@lru_cache(maxsize=64)
def _bound(
    scenario: Scenario, max_nodes: int, max_work: float, accuracy: float, time_limit: float
) -> SuccessBound:
    started, counting = time.monotonic(), scenario.swarm.counting
    scenario = scenario.most_favourable
    discs, least = scenario.target.discs, scenario.hazard.least_rate(scenario.n)
    tasks = [Relaxation.from_scenario(scenario, target=disc) for disc in discs]
    task, among = tasks[0], [replace(each, least=least) for each in tasks]
    if least is None or not task.bounded:
        kind = type(task.hazard.after(1)).__name__
        reason = (
            f"{kind} does not provide the least rate of a member among {scenario.n}; "
            "Saturation and SaturationCollision do"
        )
        return SuccessBound(0.0, (0.0,) * scenario.n, reason)
    risks = np.min([lowest_risks(a, scenario.positions, max_nodes) for a in among], axis=0)
    failure = _ROUND_DOWN * _fewer_than(scenario.success.arrivals, risks[counting])
    method, limited = CLOCKS, False
    # the game has one target, and does not know that those lost within a step protect to its end
    plain = scenario.time.substeps == len(discs) == 1
    if scenario.n > 1 and max_work > 0 and plain:
        effort = Effort(_GAME_NODES * max_nodes, max_work, accuracy, started + time_limit)
        game = game_bound(task, scenario.positions, _multiplier(task), effort)
        limited = game.limited
        if 1.0 - game.value > failure:
            failure, method = math.nextafter(1.0 - game.value, 0.0), GAME
    seconds = time.monotonic() - started
    return SuccessBound(failure, tuple(risks.tolist()), "", method, seconds, limited)


def _fewer_than(arrivals: int, risks: FloatArray) -> float:
    """Probability that fewer than so many of independent events of probability exp(-r_i) occur."""
    if arrivals == 1:
        return float(np.prod(-np.expm1(-risks)))
    occurred = np.zeros(arrivals)  # probability of 0, 1, ... events so far
    occurred[0] = 1.0
    for risk in risks:
        rises = math.exp(-risk) * occurred[:-1]
        occurred *= -math.expm1(-risk)
        occurred[1:] += rises
    return float(occurred.sum())


def lowest_risks(task: Relaxation, starts: FloatArray, max_nodes: int) -> FloatArray:
    """Lower bounds (n,) on the risk of every path from each of `starts` (n, 2) to the target.

    Infinite if no path arrives in time. One grid serves all starts, unless they are so far apart
    that it would have too many nodes; then each has its own. A path that is randomly
    rounded to the grid begins at a corner of its start's cell, so the costs to go of the corners
    are interpolated.
    """
    reachable = replace(task, radius=task.radius * (1 + 1e-9)).reachable(starts, task.steps)
    risks = np.full(len(starts), np.inf)
    near = np.flatnonzero(reachable)
    coarsest = 1 << (task.steps - 1).bit_length()  # stride, with which a single start's grid fits
    shared = near.size < 2 or node_count(task, coarsest, 1, starts[near]) <= max_nodes
    for group in [near] if shared else near[:, None]:
        if group.size:
            risks[group] = _lowest_risks(task, starts[group], max_nodes)
    return risks


def _lowest_risks(task: Relaxation, starts: FloatArray, max_nodes: int) -> FloatArray:
    """Lower bounds of the risk from starts from which the target can be reached."""
    grid = Grid.finest(task, max_nodes, starts)
    stage_costs = StageCosts(grid, multiplier=_multiplier(task))
    to_go = costs_to_go(stage_costs)
    nodes = (starts - task.start) / grid.spacing
    cells = np.floor(nodes).astype(int)
    low = cells.min(axis=0)
    corners = NodeBlock.between(low, cells.max(axis=0) + 1)
    initial = extremum_within_reach(to_go[0], grid.nodes[0], corners, grid.reach)
    if grid.stride > 1:  # paths that arrive before their first sample
        initial = np.minimum(initial, stage_costs.terminal(corners))
    risks = multilinear(initial, cells - low, nodes - cells)
    largest = float(initial[np.isfinite(initial)].max(initial=0.0))
    slack = rounding(stage_costs, largest, interpolated=True)
    return np.maximum(0.0, np.minimum(risks, 1e300) - slack)


def _multiplier(task: Relaxation) -> float:
    """Multiplier of arrival, from the best path on a small grid; any value is valid."""
    grid = Grid.finest(task, _MULTIPLIER_NODES)
    stage_costs = StageCosts(grid, certified=False, inside=True)
    to_go = costs_to_go(stage_costs)
    if grid.stride > 1 or not np.isfinite(least_cost(stage_costs, to_go)):
        return 0.0
    path = task.start + grid.spacing * np.array(trace(stage_costs, to_go), float)
    return arrival_multiplier(task, path)
