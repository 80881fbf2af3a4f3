"""Upper bounds on the mean survival over cases of every path, on nodes and beliefs.

``docs/mixtures.md`` proves them. With weights q of K cases and what a visit leaves of each,
the value of a path is convex and not increasing in its K risks, so a path that is rounded to nodes
with one random offset has at least its value in the mean. The value after a visit, (A3),

    G_t(n, q) = max over n' within reach of n of H_(t+1)(n', q),
    H_t(n, q) = max(sum_k q_k exp(-lambda_k(n) - phi(n)), G_t(n, q exp(-lambda(n)))),

is convex in q and homogeneous, so it is below its interpolation on a triangulated simplex.
"""

from __future__ import annotations

import math
import time
from collections.abc import Generator, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, lru_cache
from itertools import product
from typing import Any, NamedTuple

import numpy as np

from ..compiled.parallel import execute
from ..grid.belief_kernels import Simplex, write_values, write_visits
from ..grid.dynamic_programming import START, Node, StageCosts, costs_to_come, rounding
from ..grid.nodes import UNIT, Grid, NodeBlock, Relaxation, corners, extremum_in_windows
from ..typing import BoolArray, FloatArray
from .refinement import Clock, refined

MAX_CASES = 4
"""Largest number of cases of a bound by beliefs."""

DIVISIONS = {1: 1, 2: 32, 3: 12, 4: 8}
"""Divisions of a side of the first simplex by the number of cases, of which they are multiples."""

FIRST_VALUES = 2_000_000  # nodes times beliefs of the first grid, if its reach can be chosen so
MAX_VALUES = 150_000_000  # of any grid
_STALLED = 0.1  # part of the gap that a refinement closes at least, or another kind is tried
_ROWS = 64  # of nodes that are worth a thread


@lru_cache(maxsize=8)
def simplex(cases: int, divisions: int) -> Simplex:
    """The points of the simplex with coordinates that are multiples of 1 / `divisions`."""
    m = divisions
    tails = [t for t in product(range(m + 1), repeat=cases - 1) if list(t) == sorted(t)[::-1]]
    points = -np.diff(np.array([(m, *t, 0) for t in tails], float), axis=1) / m
    numbers = np.full((m + 1) ** (cases - 1), -1)
    strides = [(m + 1) ** power for power in reversed(range(cases - 1))]
    numbers[[sum(t * s for t, s in zip(tail, strides, strict=True)) for tail in tails]] = range(
        len(tails)
    )
    return Simplex(np.ascontiguousarray(points), numbers, m)


@dataclass(frozen=True)
class MixtureLevel:
    """Grid of a refinement.

    Parameters
    ----------
    reach : int
        Nodes by which a coordinate changes in a step.
    spacing : float
        Side of a cell, in units of length.
    nodes, beliefs : int
        Number of nodes over all steps, and of weights at each.
    bound : float
        Upper bound on the value of any path, from the grids so far.
    seconds : float
        Since the start of the refinement.
    """

    reach: int
    spacing: float
    nodes: int
    beliefs: int
    bound: float
    seconds: float


@dataclass(frozen=True)
class MixtureBound:
    """Upper bound on sum_k q_k exp(-R_k) of every path, for a prior q.

    Parameters
    ----------
    value : float
        No path within the limits of speed that is in the target by the last step has more.
    prior : tuple of float
    reason : str
        Why the refinement ended.
    levels : tuple of MixtureLevel
    seconds : float
    """

    value: float
    prior: tuple[float, ...]
    reason: str
    levels: tuple[MixtureLevel, ...] = field(default=(), repr=False)
    seconds: float = 0.0


@dataclass(frozen=True, eq=False)
class BeliefProgram:
    """Dynamic program on the nodes of a grid and beliefs about K cases.

    Parameters
    ----------
    tasks : sequence of Relaxation
        Of the cases, which differ by their rates.
    grid : Grid
    prior : (K,)
        Positive; beliefs are in units of it, so that it is a point of the simplex.
    divisions : int
        Of a side of the simplex.
    multiplier : float
        Of the arrival, for all cases: see `StageCosts`.
    certified : bool
        Whether values are upper bounds, or those of paths on nodes up to interpolation.
    """

    tasks: Sequence[Relaxation]
    grid: Grid
    prior: FloatArray
    divisions: int
    multiplier: float = 0.0
    certified: bool = True

    @cached_property
    def costs(self) -> list[StageCosts]:
        """Costs of visits and stops of every case."""
        grids = [replace(self.grid, task=task) for task in self.tasks]
        return [
            StageCosts(grid, self.certified, self.multiplier, inside=not self.certified)
            for grid in grids
        ]

    @cached_property
    def simplex(self) -> Simplex:
        """Beliefs at every node."""
        return simplex(len(self.tasks), self.divisions)

    @property
    def size(self) -> int:
        """Number of values."""
        return self.grid.size * len(self.simplex.points)

    def factors(self, sample: int, block: int, part: Any = ...) -> FloatArray:
        """What a visit to every node of a block, or of a part, leaves of each weight, (P, K)."""
        return np.stack([np.exp(-c.nodes[sample][block][part]).ravel() for c in self.costs], axis=1)

    def stop(self, nodes: NodeBlock) -> FloatArray:
        """What stopping at the nodes of a block leaves of every weight, (P,)."""
        return np.exp(-self.costs[0].terminal(nodes)).ravel()

    def backwards(self) -> Generator[BeliefSample, None, None]:
        """Samples from the last one."""
        visits: list[FloatArray] = []
        for sample in reversed(range(len(self.grid.nodes))):
            nodes = self.grid.nodes[sample]
            factors = [self.factors(sample, number) for number in range(len(nodes))]
            after = [self.after(sample, visits, block) for block in nodes]
            visits = list(map(self._visited, nodes, factors, after))
            yield BeliefSample(sample, factors, after, visits)

    def _visited(self, nodes: NodeBlock, factors: FloatArray, after: FloatArray) -> FloatArray:
        """H (P, B) at the nodes of a block, from G."""
        out = np.empty_like(after)
        arguments = after, self.stop(nodes), factors, self.prior, self.simplex, out
        execute(write_visits, len(out), arguments, _ROWS)
        return out

    def after(self, sample: int, visits: list[FloatArray], nodes: NodeBlock) -> FloatArray:
        """G (P, B) at nodes of a sample, from H of the next one; 0 where none is within reach.

        The start is sample -1.
        """
        beliefs = len(self.simplex.points)
        blocks = self.grid.nodes[sample + 1] if visits else ()
        shapes = [_with(block, beliefs) for block in blocks]
        values = [v.reshape(s.shape) for v, s in zip(visits, shapes, strict=True)]
        windows = [(*window, 0) for window in self.grid.windows]
        found = extremum_in_windows(values, shapes, _with(nodes, beliefs), windows, largest=True)
        return np.maximum(found, 0.0).reshape(-1, beliefs)

    def at(self, to_go: FloatArray, stop: FloatArray, left: FloatArray) -> FloatArray:
        """Values (P,) after visits that leave the parts (P, K) of the prior, with G in `to_go`."""
        out = np.empty(len(left))
        write_values(to_go, stop, left, self.prior, self.simplex, out)
        return out

    def from_start(self, visits: list[FloatArray]) -> float:
        """Value at the start, from H of the first sample."""
        stop = self.stop(START) if self.grid.stride > 1 else np.zeros(1)
        to_go = self.after(-1, visits, START)
        return float(self.at(to_go, stop, np.ones((1, len(self.prior))))[0])


class BeliefSample(NamedTuple):
    """Values at the nodes of every block of a sample, (P, B) each."""

    sample: int
    factors: list[FloatArray]  # (P, K), what a visit leaves of each weight
    after: list[FloatArray]  # G, after a visit
    visits: list[FloatArray]  # H, before it


def _with(nodes: NodeBlock, beliefs: int) -> NodeBlock:
    """A block of nodes with an axis of beliefs."""
    return NodeBlock((*nodes.first, 0), (*nodes.shape, beliefs))


def mixture_bound(
    tasks: Sequence[Relaxation],
    prior: FloatArray,
    known: float,
    multiplier: float = 0.0,
    *,
    gap: float,
    time_limit: float,
) -> MixtureBound:
    """Bound on the value of every path, refined until it is within `gap` of the known one.

    Parameters
    ----------
    tasks : sequence of K Relaxation
        Of the cases; their hazards provide lower bounds of rates.
    prior : (K,)
        Positive.
    known : float
        A lower bound of the greatest value, of paths or mixtures of them.
    multiplier : float
        Of the arrival; any value from 0 is valid.
    gap : float
        Value of (bound - known) / bound at which to stop.
    time_limit : float
        Seconds; no grid is begun that is expected to exceed them.
    """
    clock, divisions = Clock(time.monotonic() + time_limit), DIVISIONS[len(tasks)]
    beliefs = len(simplex(len(tasks), divisions).points)
    grid = Grid.finest(tasks[0], FIRST_VALUES // beliefs)
    program = BeliefProgram(tasks, grid, prior, divisions, multiplier)
    levels, reason = refined(
        _levels(program, known, gap, clock),
        f"the next grid would exceed the time limit of {time_limit:.3g} s",
    )
    value = levels[-1].bound if levels else 1.0
    return MixtureBound(value, tuple(prior.tolist()), reason, levels, clock.seconds)


def _levels(
    program: BeliefProgram, known: float, gap: float, clock: Clock
) -> Generator[MixtureLevel, None, str]:
    """Grids of a refinement, each with the bound so far; why there is no other one.

    Nodes are refined until that closes little of the gap, then beliefs, and so on in turn.
    """
    bound, finer_beliefs = 1.0, False
    while True:
        grid, before = program.grid, bound
        slack = _slack(program, bound)
        value, through = _swept(program)
        bound = min(bound, max(known, value) + slack)
        sizes = grid.size, len(program.simplex.points)
        yield MixtureLevel(grid.reach, grid.spacing, *sizes, bound, clock.seconds)
        if bound - known <= gap * bound:
            return f"the gap of {gap:g} is reached"
        if bound - known <= 4 * slack:
            return "the remaining gap is within rounding errors"
        active = tuple(
            tuple(
                block.cells & _any_above(block.nodes, values, known - slack, grid.stride)
                for block, values in zip(blocks, sample, strict=True)
            )
            for blocks, sample in zip(grid.blocks, through, strict=True)
        )
        if before - bound < _STALLED * (before - known) and len(program.tasks) > 1:
            finer_beliefs = not finer_beliefs
        if finer_beliefs:
            finer = replace(program, grid=grid.restricted(active), divisions=2 * program.divisions)
        else:
            finer = replace(program, grid=grid.halved(active))
        if finer.size > MAX_VALUES:
            return f"the next grid has more than {MAX_VALUES:,} values"
        clock.begin(finer.size / max(program.size, 1))
        program = finer


def _any_above(nodes: NodeBlock, values: FloatArray, limit: float, stride: int) -> BoolArray:
    """Cells with a corner whose value is above a limit; all of them with a stride above 1."""
    inside = values.reshape(nodes.shape) if stride == 1 else np.full(nodes.shape, np.inf)
    return np.asarray(np.any([corner > limit for corner in corners(inside)], axis=0))


def _swept(program: BeliefProgram) -> tuple[float, list[list[FloatArray]]]:
    """Value at the start, and bounds on that of the paths through every node, by sample.

    A path through a node arrives there with at most what the least risk in each case leaves.
    """
    grid, come = program.grid, [list(costs_to_come(costs)) for costs in program.costs]
    through: list[list[FloatArray]] = [[] for _ in grid.nodes]
    first: list[FloatArray] = []
    for found in program.backwards():
        first = found.visits
        for number, nodes in enumerate(grid.nodes[found.sample]):
            left = [np.exp(-case[found.sample][number]).ravel() for case in come]
            arriving = np.stack(left, axis=1) * found.factors[number]
            values = program.at(found.after[number], program.stop(nodes), arriving)
            through[found.sample].append(values)
    return program.from_start(first), through


def _slack(program: BeliefProgram, bound: float) -> float:
    """More than the rounding errors of a value: of risks, products, and places among beliefs.

    R exp(-R) is at most 1 / e, so an error of a risk relative to R moves a survival by less than
    as much. A place that is wrong by a part of the sum of all weights, which is at most K, moves a
    value by at most as much times the largest slope, however small the value is.
    """
    worst = max(rounding(costs, 1.0) for costs in program.costs)
    steps = len(program.grid.nodes)
    largest = math.exp(program.costs[0].max_terminal)
    places = 16 * len(program.tasks) ** 2 * (program.simplex.divisions + 1)
    return UNIT * steps * (64 * bound + places) * largest + worst * largest


def best_belief_path(program: BeliefProgram) -> list[Node]:
    """Nodes of a path from the start that follows the greatest values, its weights exact."""
    after = [found.after for found in program.backwards()][::-1]
    path, left, stopping = [(0, 0)], np.ones(len(program.prior)), 0.0
    for sample, blocks in enumerate(program.grid.nodes):
        best, following = stopping * (1 + 1e-12), None
        for (number, block), window in product(enumerate(blocks), program.grid.windows):
            near = NodeBlock(path[-1], (1, 1)).grown(window).common(block)
            if 0 in near.shape:
                continue
            part = near.within(block)
            parts = left * program.factors(sample, number, part)
            to_go = after[sample][number].reshape(*block.shape, -1)[part]
            to_go = to_go.reshape(len(parts), -1)
            values = program.at(to_go, program.stop(near), parts)
            at = int(values.argmax())
            if values[at] > best:
                i, j = divmod(at, near.shape[1])
                best, following = float(values[at]), (near.first[0] + i, near.first[1] + j)
                remaining = parts[at]
        if following is None:
            break
        path.append(following)
        left = remaining
        stopping = float(program.prior @ left * program.stop(NodeBlock(following, (1, 1)))[0])
    return path
