"""The level game: an upper bound on the success of every policy from the members' levels.

A member's level is the value of a potential at its position, a lower bound on the single-agent risk
that is left to it. In the game the members' levels are all that counts: whoever wants to lower its
own by delta is exposed to a single-agent risk of at least delta, with less protection from members
whose levels stay behind, because they are far away. The value of the game bounds the success of
every policy; the proof, with that of the interpolation, is in ``docs/success-bound.md``.

Any potential and grid of levels give a valid bound. Their choice is guided by the value of the game
in which all members always have the same level and drop as far as they can, which is nearly
optimal.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Generator
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np

from ..grid.dynamic_programming import StageCosts, rounding
from ..grid.nodes import UNIT, CellBlock, Grid, NodeBlock, Relaxation, box_extremum, multilinear
from ..hazard.rate_bounds import LeastRate
from ..typing import FloatArray
from .level_game_kernels import (
    Buffers,
    Moves,
    Tables,
    best_moves,
    fill_levels,
    limit_slope,
    make_decreasing,
)
from .refinement import Clock, refined

MAX_NODES = 1_000_000  # default maximum of nodes of a potential, over all steps

_MAX_REACH = 16
_CHAMFER = math.sqrt(4 - 2 * math.sqrt(2)) * (1 + 1e-12)
"""kappa: at most so many times the distance is a path along straight and diagonal edges."""

_GROUP = 6  # members of a game
_COARSE_NODES = 1_000_000  # of the potentials that are compared
_LARGEST = np.geomspace(0.06, 0.5, 18)  # drops that are compared, relative to the mean level
_SLOPES = (2.0, 4.0, 8.0, 16.0)  # relative to the mean slope between the members and the target
_LOST_LEVEL = 0.01  # relative loss of level for a small slope
_CELLS = (1, 2, 3, 4, 5, 6, 7, 8, 10, 12, 16, 20, 24, 32, 40, 48, 64)
_STAGE = 30.0  # ratio of work of one stage and the one before
_FIRST_WORK = 1e6
_LATE = "the time limit is reached"
_UNITS = 16  # of density of a neighbour
_COMPARED = 64  # members at most, when choices are compared: any choice gives a valid bound
_HIGHEST = 64.0  # levels are cut off here: exp(-64) is below the rounding of a probability


@dataclass(frozen=True, eq=False)
class Potential:
    """Levels on a rectangle of grid nodes; in between bilinear, and constant outwards.

    A potential w_t, t = 0, ..., N, satisfies, for all positions x and all x' within reach of x,

        (P1)  w_t(x) <= dt b(x') + w_(t+1)(x'),    b the single-agent rate after step t;
        (P2)  w_t(x) <= 0 in the target;
        (P3)  |x - y|^2 >= (|w_t(x) - w_t(y)| / L)^2 - h^2 / 2;
        (P4)  w_t(x) - w_(t+1)(x') <= d.

    w_t(x) is the *level* of a member at x, L the *slope*, and d the *largest drop* of a step. The
    largest function with (P1) and (P2) is the value function. Derived in ``docs/success-bound.md``.
    `slack` bounds their rounding errors: (P1) and (P2) hold for w_t - slack (N + 1 - t) / (N + 1).
    """

    task: Relaxation  # its start is node (0, 0)
    starts: FloatArray = field(repr=False)  # (n, 2), initial positions of the members
    reach: int  # k, nodes by which a coordinate changes in a step: the spacing is h = s / k
    low: tuple[int, ...]  # index of the first node
    values: tuple[FloatArray, ...] = field(repr=False)  # (nx, ny), for steps 0 to N
    slope: float  # L, infinite without a limit
    largest: float  # d, infinite without a limit
    slack: float

    @property
    def spacing(self) -> float:
        """h, the side of a cell."""
        return self.task.step / self.reach

    def levels(self, step: int, positions: FloatArray) -> FloatArray:
        """Lower bounds (B,) of the levels at positions (B, 2) at a step, rounding included."""
        nodes = (positions - self.task.start) / self.spacing - self.low
        last = np.array(self.values[0].shape) - 1
        nodes = np.clip(nodes, 0.0, last)
        cells = np.minimum(np.floor(nodes).astype(int), last - 1)
        return multilinear(self.values[step], cells, nodes - cells) - self.slack

    @cached_property
    def start_levels(self) -> FloatArray:
        """Levels (n,) of the members at step 0."""
        return self.levels(0, self.starts)

    def least_squared_distance(self, gaps: FloatArray) -> FloatArray:
        """Least squared distance of two members whose levels differ by at least `gaps`."""
        return np.maximum(0.0, (gaps / self.slope) ** 2 - 0.5 * self.spacing**2)


class PotentialFamily:
    """The potentials of members on one grid, by slope.

    Parameters
    ----------
    task : Relaxation
        Whose hazard provides lower bounds of single-agent rates.
    starts : (n, 2)
        Positions of the members at step 0.
    max_nodes : int
        Maximum number of nodes over all steps, unless the coarsest grid has more.
    multiplier : float
        Of arrival, as of `StageCosts`.
    """

    def __init__(
        self,
        task: Relaxation,
        starts: FloatArray,
        max_nodes: int = MAX_NODES,
        multiplier: float = 0.0,
    ) -> None:
        # node values that are not negative, whatever the hazard: see `Relaxation.rates_below`
        self.task = replace(task, least=LeastRate(np.zeros(1), np.ones(1)))
        self.starts, self.multiplier = starts, multiplier
        self.reach = 1
        while self.reach < _MAX_REACH and self._count(2 * self.reach) <= max_nodes:
            self.reach *= 2

    @cached_property
    def _block(self) -> CellBlock:
        return CellBlock.full(self._rectangle(self.reach))

    @cached_property
    def _stage_costs(self) -> StageCosts:
        samples = self.task.steps if self.task.hazard.changes else 1  # which all steps share
        grid = Grid(self.task, 1, self.reach, ((self._block,),) * samples)
        return StageCosts(grid, True, self.multiplier)

    def _costs(self, step: int) -> FloatArray:
        """Lower bounds of the single-agent risk of arriving at every node at a step, from 1."""
        nodes = self._stage_costs.nodes
        costs = nodes[min(step, len(nodes)) - 1][0] * (1 - 1e-9)
        costs[[0, -1]] = 0.0  # what is outside counts as at the edge
        costs[:, [0, -1]] = 0.0
        return np.asarray(costs)

    @cached_property
    def _slack(self) -> float:
        stage_costs = self._stage_costs
        per_path = rounding(stage_costs, _HIGHEST, interpolated=True)
        largest = _HIGHEST + stage_costs.max_terminal
        return per_path + 64 * UNIT * (self.task.steps + 1) * largest

    @property
    def size(self) -> int:
        """Number of nodes over all steps."""
        return self._count(self.reach)

    def _count(self, reach: int) -> int:
        return self._rectangle(reach).size * self.task.steps

    def _rectangle(self, reach: int) -> NodeBlock:
        """Nodes of the positions on paths from the starts to the target, and of a margin."""
        task = self.task
        spacing = task.step / reach
        near = self.starts[task.reachable(self.starts, task.steps)]
        offsets = ((near if len(near) else self.starts[:1]) - task.start) / spacing
        low, high = np.floor(offsets.min(axis=0)), np.ceil(offsets.max(axis=0))
        center, radius = (task.center - task.start) / spacing, task.radius / spacing
        ahead = reach * np.arange(1, task.steps + 1)[:, None]
        back = ahead[::-1] - reach
        first = np.maximum(np.floor(center - radius) - back, low - ahead).min(axis=0)
        last = np.minimum(np.ceil(center + radius) + back, high + ahead).max(axis=0)
        margin = 2 * reach  # that leaving and coming back does not pay where a slope limits levels
        return NodeBlock.between(np.minimum(first, low) - margin, np.maximum(last, high) + margin)

    def potential(self, slope: float = math.inf, largest: float = math.inf) -> Potential:
        """The largest potential on the nodes with this slope and largest drop: equation (S1)."""
        edge = slope / _CHAMFER * (self.task.step / self.reach)
        nodes = self._block.nodes
        highest = np.minimum(self._stage_costs.terminal(nodes), _HIGHEST)
        values: list[FloatArray] = []
        for step in range(self.task.steps, -1, -1):
            level = highest.copy()
            if values:
                costs = np.minimum(self._costs(step + 1), largest)
                after = box_extremum(values[-1] + costs, nodes, nodes, self.reach)
                np.minimum(level, after, out=level)
            if math.isfinite(slope):
                limit_slope(level, edge, math.sqrt(2) * edge)
            values.append(level)
        return Potential(
            *(self.task, self.starts, self.reach, nodes.first, tuple(values[::-1])),
            *(slope, largest, self._slack),
        )


@dataclass(frozen=True, eq=False)
class LevelGame:
    """The level game of a potential whose levels fall by at most `potential.largest` in a step.

    The success of the `players` counts, who can all reach the target; the other members protect
    them at no distance all the time.
    """

    potential: Potential  # with a finite slope and largest drop
    cells: int  # D, number of levels of the grid by which a level can fall in a step
    players: tuple[int, ...]

    @cached_property
    def starts(self) -> FloatArray:
        """Levels of the players at step 0."""
        return self.potential.start_levels[list(self.players)]

    @property
    def members(self) -> int:
        """Number of players."""
        return len(self.players)

    @cached_property
    def spacing(self) -> float:
        """g, the distance of neighbouring levels; a drop is at most `cells` of them."""
        potential = self.potential
        return (potential.largest + potential.slack) * (1 + 1e-9) / self.cells

    @cached_property
    def size(self) -> int:
        """M, the number of levels; higher ones count as the last."""
        return max(2, math.ceil(float(self.starts.max()) / self.spacing) + 1)

    def value(self) -> float:
        """Upper bound on the success probability of every policy."""
        if self.members == 0:
            return 0.0
        if (self.starts <= 0).any() or self._least_slopes[-1] <= 0:  # drops may cost nothing
            return 1.0
        steps = self.potential.task.steps
        highest = max(1.0, float(self.node_values[-1].max()))
        rounding = 256 * UNIT * self.members * self.cells * (steps + 1) * highest
        return min(1.0, self.at(self.starts) + rounding)

    @cached_property
    def node_values(self) -> list[FloatArray]:
        """G_k (C(M + k - 1, k),) for k = 0, ..., n alive, by the rank of the set of levels."""
        values, rows = [np.zeros(1)], [np.zeros((1, 0), np.int64)]
        for alive in range(1, self.members + 1):
            count = math.comb(self.size + alive - 1, alive)
            rows.append(np.zeros((count, alive), np.int64))
            fill_levels(rows[-1])
            arrived = max(1.0, float(values[-1].max()))
            known = [*values[1:], np.zeros(count)]
            parts = [
                np.where(at[:, 0] == 0, arrived, v) for at, v in zip(rows[1:], known, strict=True)
            ]
            offsets = np.cumsum([0, *map(len, values)])
            tables = Tables(np.concatenate([values[0], *parts]), offsets, self._binomials)
            moves, buffers = self._moves(alive), Buffers.of(alive)
            for corrected in (False, True):
                best_moves(rows[-1], moves, corrected, buffers, tables)
            values.append(tables.values[offsets[-1] :])
            if alive < self.members:  # which are interpolated otherwise: see `_least_slopes`
                make_decreasing(rows[-1], self._binomials, values[-1])
        return values

    @cached_property
    def _binomials(self) -> np.ndarray:
        n = self.members
        return np.array(
            [[math.comb(i, j) for j in range(n + 2)] for i in range(self.size + n + 1)], np.int64
        )

    @cached_property
    def _least_slopes(self) -> FloatArray:
        """Least ratios of risk and drop with 1, ..., n alive; not increasing."""
        slopes = [float(np.diff(self._risks(k), axis=1).min()) for k in range(1, self.members + 1)]
        return np.asarray(np.minimum.accumulate(slopes) / self.spacing * (1 - 1e-9))

    def _risks(self, alive: int) -> FloatArray:
        """Least risk (S, D + 1) of a member by the density of its neighbours and its drop."""
        dt, total = self.potential.task.dt, alive + len(self.potential.starts) - self.members
        densities: FloatArray = total - alive + np.arange(_UNITS * (alive - 1) + 1) / _UNITS
        rates = np.arange(self.cells + 1, dtype=float) * (self.spacing / dt)
        least = self.potential.task.hazard.least_rates(total, densities, rates)
        assert least is not None
        least[:, 0] = 0.0
        return dt * least

    def _moves(self, alive: int) -> Moves:
        risks = self._risks(alive)
        rises = np.diff(risks, axis=1)
        slope = self._least_slopes[alive - 1] * self.spacing
        steepness = np.zeros_like(risks)
        steepness[:, 1:] = rises / slope * -math.expm1(-slope)
        surplus = np.exp(rises.max(axis=1))
        behind = np.arange(self.size + 2, dtype=float) * self.spacing
        squared = self.potential.least_squared_distance(behind)
        density = np.where(squared > 0, self.potential.task.hazard.density_bound(squared), 1.0)
        density = _UNITS * np.minimum(density, 1.0)
        return Moves(np.exp(-risks), steepness, surplus, math.exp(slope), density)

    def at(self, levels: FloatArray) -> float:
        """V, without rounding errors: the value with living members at `levels` (k,).

        It is interpolated in exp(-slope level), and may be larger than 1 where it is coarse.
        """
        alive = len(levels)
        nodes = np.minimum(levels / self.spacing, self.size - 1)
        cells = np.minimum(np.floor(nodes).astype(int), self.size - 2)
        slope = self._least_slopes[alive - 1] * self.spacing if alive else 0.0
        upper = np.expm1(-slope * (nodes - cells)) / math.expm1(-slope) if alive else nodes
        total = 0.0
        for corner in itertools.product((0, 1), repeat=alive):
            weight = float(np.prod(np.where(corner, upper, 1 - upper)))
            corners = np.sort(cells + np.array(corner, int))
            rank = sum(math.comb(int(level) + i, i + 1) for i, level in enumerate(corners))
            total += weight * float(self.node_values[alive][rank])
        return total


def look_ups(members: int, size: int, cells: int) -> float:
    """Number of values that `LevelGame.value` looks up for states of all members, about.

    A move of two to five members takes about as long as 45 look-ups.
    """
    of_move = max(45.0, 0.4 * 2.0**members * (1 + members / 2))
    return math.comb(size + members - 1, members) * (cells + 1.0) ** members * of_move


class GameBound(NamedTuple):
    """A bound on the success probability of every policy."""

    value: float
    limited: bool  # whether the time limit made it weaker


class Choice(NamedTuple):
    """Largest drop of a potential and the number of levels in it."""

    largest: float
    cells: int


class Effort(NamedTuple):
    """Limits of the computation and its accuracy; see `success_bound`."""

    max_nodes: int  # of a potential, over all steps
    max_work: float  # largest number of values that a game looks up, about; finite
    accuracy: float  # of the bound on failure: refine until it rises by less, relatively
    deadline: float  # of `time.monotonic`; no game is begun that is expected to end later


def game_bound(
    task: Relaxation, starts: FloatArray, multiplier: float, effort: Effort
) -> GameBound:
    """The least bound of level games of increasing work; 1 if even the smallest needs too much.

    `starts` (n, 2) are the initial positions, and the multiplier is as of `StageCosts`.
    """
    nearly = replace(task, radius=task.radius * (1 + 1e-9))
    reachable = nearly.reachable(starts, task.steps)
    fine = PotentialFamily(task, starts, effort.max_nodes, multiplier)
    if not reachable.any() or fine.size > effort.max_nodes:
        return GameBound(1.0, limited=False)
    coarse = PotentialFamily(task, starts, min(_COARSE_NODES, effort.max_nodes), multiplier)
    values, reason = refined(_values(fine, coarse, reachable, effort), _LATE)
    return GameBound(min(values, default=1.0), reason == _LATE)


def _values(
    fine: PotentialFamily, coarse: PotentialFamily, reachable: np.ndarray, effort: Effort
) -> Generator[float, None, str]:
    """Values of games of increasing work; why there is no other one."""
    task, groups = fine.task, _groups(np.flatnonzero(reachable))
    slope = _slope(coarse, reachable)
    levels = _start_levels(coarse, slope, reachable)
    clock, best, used = Clock(effort.deadline), 1.0, 0.0
    works = (_FIRST_WORK * _STAGE**stage for stage in itertools.count())
    smaller = itertools.takewhile(lambda work: work < effort.max_work, works)
    for work in (*smaller, effort.max_work):
        choice = _choose(task, len(fine.starts), len(groups[0]), levels, work)
        if choice is None:
            continue
        clock.begin(work / used if used else 0.0)
        value = _product(fine.potential(slope, choice.largest), groups, choice.cells)
        yield value
        improved, best, used = best - value, min(best, value), work
        if value < 1.0 and improved < effort.accuracy * (1.0 - value):
            return "the bound on failure hardly rises"
    return "the largest work is reached"


def _groups(members: np.ndarray) -> list[np.ndarray]:
    """Members in as few groups as possible, of equal size but for one."""
    return [group for group in np.array_split(members, -(-len(members) // _GROUP)) if len(group)]


def _product(potential: Potential, groups: list[np.ndarray], cells: int) -> float:
    """1 - product of the probabilities that no member of a group arrives, each with all others."""
    failure = 1.0
    for group in groups:
        failure *= 1.0 - LevelGame(potential, cells, tuple(group.tolist())).value()
    return 1.0 - failure * (1 - 1e-12)


def _slope(family: PotentialFamily, reachable: np.ndarray) -> float:
    """A small slope with nearly the levels of a large one."""
    task, starts = family.task, family.starts[reachable]
    distance = float(np.hypot(*(starts - task.center).T).mean())
    level = float(np.mean(family.potential().start_levels[reachable]))
    mean = max(level, 1e-3) / max(distance, task.radius)
    for factor in _SLOPES:
        limited = family.potential(factor * mean).start_levels[reachable]
        if limited.mean() >= (1 - _LOST_LEVEL) * level:
            break
    return factor * mean


def _start_levels(
    family: PotentialFamily, slope: float, reachable: np.ndarray
) -> list[tuple[float, FloatArray]]:
    """Largest drops that may be chosen, and the levels at the start with each."""
    level = float(np.mean(family.potential(slope).start_levels[reachable]))
    drops = [float(drop) for drop in max(level, 1e-3) * _LARGEST]
    return [(drop, family.potential(slope, drop).start_levels[reachable]) for drop in drops]


def _choose(
    task: Relaxation,
    members: int,
    players: int,
    levels: list[tuple[float, FloatArray]],
    work: float,
) -> Choice | None:
    """The largest drop and grid of levels that promise the least bound; None if there is none."""
    choices: list[tuple[float, Choice]] = []
    for largest, starts in levels:
        for cells in _CELLS:
            size = max(2, math.ceil(float(starts.max()) / largest * cells) + 1)
            if look_ups(players, size, cells) <= work:
                effective = largest * (1 + 1.2 / cells**2)  # interpolation acts like larger drops
                value = _together(task, min(members, _COMPARED), float(starts.mean()), effective)
                choices.append((value, Choice(largest, cells)))
    return min(choices)[1] if choices else None


def _together(task: Relaxation, members: int, level: float, largest: float) -> float:
    """Success of members that always have the same level and drop by `largest` in every step."""
    steps = math.floor(level / largest)
    rest = max(level - steps * largest, 0.0)
    value = np.append(0.0, np.ones(members))
    for drop, repeated in ((largest, steps), (rest, 1)):
        transition = np.zeros((members + 1, members + 1))
        transition[0, 0] = 1.0
        for alive in range(1, members + 1):
            density, rate = np.array([alive - 1.0]), np.array([drop / task.dt])
            least = task.hazard.least_rates(alive, density, rate)
            assert least is not None
            survival = math.exp(-task.dt * float(least[0, 0]))
            for left in range(alive + 1):
                weight = math.comb(alive, left) * survival**left
                transition[alive, left] = weight * (1.0 - survival) ** (alive - left)
        for _ in range(repeated):
            value = transition @ value
    return float(value[-1])
