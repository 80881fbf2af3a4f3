"""Proven upper bounds of the success of every policy of two members, and their value function."""

from __future__ import annotations

import math
import time
from collections.abc import Generator
from dataclasses import dataclass, field, replace

import numpy as np

from ..errors import PlanningError
from ..grid.nodes import NodeBlock, Relaxation, multilinear
from ..scenario import Scenario
from ..scenario.scenario_files import require_scenario
from ..scenario.variations import require_default
from ..typing import FloatArray
from .pair_program import Arrays, PairProgram, Tube, best_multiplier, gathered
from .refinement import Clock, refined

MAX_NODES = 100_000_000  # default maximum of joint nodes of a grid, over all steps: 8 bytes each
TOLERANCE = 1e-3
TIME_LIMIT = 60.0
_FIRST_NODES = 5_000_000
_REACHES = (1, 2, 3, 4, 5, 6, 7, 8, 10, 12, 14, 16, 20, 24, 28, 32, 40, 48, 56, 64)
_SLOWER = 2.5  # a larger grid, back and forth, than a forward recursion, per node
_FEW_NODES = 2_000_000  # of a grid on which multipliers of arrival are compared
_FACTORS = (0.3, 2.0)
_NO_OTHER = "no other policy exceeds the known one"
_PROTECTION = 0.5  # by a member at the margin beyond reach of the target, relative


@dataclass(frozen=True)
class PairLevel:
    """Grid of pairs: nodes per step of a coordinate, joint nodes, bound, and seconds so far."""

    reach: int
    nodes: int
    bound: float
    seconds: float


@dataclass(frozen=True)
class PairBound:
    """A proven upper bound of the success probability of every policy of two members.

    Parameters
    ----------
    value : float
        No policy exceeds it: of any acceleration, or, if `initial_velocities` were given, within
        the scenario's a_max.
    known : float
        The success probability that was given: policies that do not exceed it were not considered.
    reason : str
        Why the refinement ended.
    levels : tuple of PairLevel
        The grids of the refinement, from the coarsest.
    """

    value: float
    known: float
    reason: str
    levels: tuple[PairLevel, ...] = field(default=(), repr=False)

    @property
    def gap(self) -> float:
        """value - known."""
        return self.value - self.known


def pair_bound(
    scenario: Scenario,
    known: float = 0.0,
    *,
    initial_velocities: FloatArray | None = None,
    tolerance: float = TOLERANCE,
    max_nodes: int = MAX_NODES,
    time_limit: float = TIME_LIMIT,
) -> PairBound:
    """Proven upper bound of the optimal success probability of two members.

    It is optimal among all policies: with feedback, memory and randomisation. Limits of
    acceleration are used only if `initial_velocities` is given, and then only through the positions
    that members can reach.

    Parameters
    ----------
    scenario : Scenario
        Of two members.
    known : float
        Success probability of a policy. The better it is, the fewer states must be considered.
        It need not respect a_max.
    initial_velocities : (2, 2), optional
        V(-1), in units of length per unit time; without it the bound holds for any acceleration.
    tolerance : float
        Difference of the bound and `known` at which to stop.
    max_nodes : int
        Maximum number of joint nodes of a grid; they take 8 bytes each, and half as much again for
        the largest steps.
    time_limit : float
        Seconds.

    Returns
    -------
    PairBound
        Its value is at least `known`.

    Raises
    ------
    PlanningError
        The scenario has another number of members, a hazard without bounds, or more steps than
        the coarsest grid of `max_nodes` nodes can hold.
    """
    require_scenario("pair_bound", scenario)
    clock = Clock(time.monotonic() + time_limit)
    program = first_program(scenario, max_nodes, initial_velocities)
    late = f"the time limit of {time_limit:g} s is reached"
    levels, reason = refined(_levels(program, known, tolerance, max_nodes, clock), late)
    value = known if reason == _NO_OTHER else levels[-1].bound if levels else 1.0
    return PairBound(value, known, reason, levels)


def _levels(
    program: PairProgram, known: float, tolerance: float, max_nodes: int, clock: Clock
) -> Generator[PairLevel, None, str]:
    """Grids of a refinement, each with the bound so far; why there is no other one."""
    value = 1.0
    finer: PairProgram | None = program
    while finer is not None:
        program, bound, kept = _best_multiplier(finer, clock.deadline)
        value = max(known, min(value, bound))
        nodes = program.tube.nodes(program.spacing)
        yield PairLevel(program.reach, nodes, value, clock.seconds)
        if value - known <= tolerance:
            return f"the difference of {tolerance:g} is reached"
        clock.begin()
        tube = program.forward(kept, known, clock.deadline)
        del kept
        if not len(tube.boxes[1]) and not tube.leaving[0].any():
            return _NO_OTHER
        now = time.monotonic()
        affordable = nodes * (clock.deadline - now) / max(_SLOWER * (now - clock.begun), 0.05)
        finer = _finer(program, tube, min(max_nodes, max(affordable, _FEW_NODES)))
    return f"the next grid has more than {max_nodes:,} nodes, or would exceed the time limit"


def _best_multiplier(
    program: PairProgram, deadline: float
) -> tuple[PairProgram, float, list[Arrays]]:
    """The program, its bound and its values, with the best multiplier of pairs on small grids."""
    best = program, *program.backward(deadline)
    if program.multipliers is None or program.tube.nodes(program.spacing) > _FEW_NODES:
        return best
    single, pair = program.multipliers
    for factor in _FACTORS:
        other = replace(best[0], multipliers=(single, pair * factor))
        found = other, *other.backward(deadline)
        if found[1] < best[1]:
            return found
    return best


def first_program(
    scenario: Scenario,
    max_nodes: int,
    initial_velocities: FloatArray | None = None,
    certified: bool = True,
) -> PairProgram:
    """The dynamic program on the finest full grid of at most 5 million nodes, or the coarsest."""
    require_pair(scenario)
    starts = np.asarray(scenario.positions, float)
    task = Relaxation.from_scenario(scenario, starts[0])
    velocities, change = np.zeros((2, 2)), math.inf
    if initial_velocities is not None:
        velocities, change = initial_velocities, math.sqrt(scenario.swarm.a_max)
    margins = [_margin(task, reach) for reach in _REACHES[:4]]
    candidates = []
    for reach, margin in zip(_REACHES, margins, strict=False):
        near = gathered(task, starts, margin, max(margins))
        nearer = Relaxation.from_scenario(scenario, near[0])
        tube = Tube.full(nearer, near, margin, velocities, change)
        if certified and (near != starts).any():  # who leaves the rectangle in the first step
            nowhere = [np.zeros((0, 2, 4))] * task.steps
            tube = replace(tube, boxes=(tube.boxes[0], *nowhere))
        candidates.append(PairProgram(nearer, near, tube, reach, margin, None))
    sizes = [program.size for program in candidates]
    if sizes[0] > max_nodes:
        raise PlanningError(
            f"the value of two members needs {sizes[0]:,} nodes, more than max_nodes = "
            f"{max_nodes:,}; a larger time.dt or a smaller t_f makes it smaller",
            nodes=sizes[0],
        )
    fitting = [k for k, size in enumerate(sizes) if size <= min(_FIRST_NODES, max_nodes)]
    program = candidates[max(fitting, default=0)]
    multipliers = (best_multiplier(program.task),) * 2 if certified else None
    return replace(program, multipliers=multipliers)


def require_pair(scenario: Scenario) -> None:
    """Raise PlanningError unless a scenario has two members and rates with bounds for pairs."""
    for key in (
        "success.arrivals",
        "time.substeps",
        "target.other",
        "swarm.speed",
        "swarm.kind",
    ):
        require_default(scenario, key, "the optimal value of two members")
    if scenario.n != 2:
        reason = (
            f"the optimal value is computed for two members; {scenario.name!r} has {scenario.n}"
        )
        raise PlanningError(reason, members=scenario.n)
    if scenario.hazard.pair_bounds((1, 1), 1.0) is None:
        kind = type(scenario.hazard.after(1)).__name__
        raise PlanningError(
            f"{kind} does not provide `pair_bounds`, bounds of the rates of two members; "
            "Saturation and SaturationCollision do"
        )


def _margin(task: Relaxation, reach: int) -> float:
    """Distance beyond reach of the target, in whole nodes, where a member hardly protects."""
    spacing = task.step / reach
    bounds = task.hazard.pair_bounds((2 * reach + 1, 1), spacing)
    assert bounds is not None
    protection = 1.0 - bounds.share[2 * reach :, 0]
    weak = protection <= _PROTECTION * protection[0]
    return spacing * (max(1, int(weak.argmax())) if weak.any() else 2 * reach)


def _finer(program: PairProgram, tube: Tube, max_nodes: float) -> PairProgram | None:
    """The program on a tube with the finest grid, at most twice as fine, that is affordable."""
    step = program.task.step
    for reach in reversed(_REACHES):
        if program.reach < reach <= 2 * program.reach and tube.nodes(step / reach) <= max_nodes:
            finer = replace(program, tube=tube, reach=reach)
            if finer.size <= max_nodes:
                return finer
    return None


_MAX_NODES = 5_000_000


@dataclass(frozen=True, eq=False)
class PairValueFunction:
    """Largest success probability of two members along the nodes of a grid, without a_max.

    The values are those of a policy on the nodes, up to interpolation of a survivor's. They are not
    bounds; `casswarm.bounds.pair_bound` proves one.

    Parameters
    ----------
    origin : (2,)
        Position of node (0, 0).
    shifts : (2, 2)
        By which positions are beyond those on the grid; 0 unless a member can never arrive.
    spacing : float
        Distance of neighbouring nodes along an axis, in units of length.
    step : float
        Largest change of a coordinate in a time step, in units of length.
    blocks : tuple of NodeBlock
        Nodes of both members, along four axes, for steps 1 to N.
    values : tuple of ndarray
        Success probability at the nodes of each block, before losses of that step are drawn.
    """

    origin: FloatArray
    shifts: FloatArray
    spacing: float
    step: float
    blocks: tuple[NodeBlock, ...] = field(repr=False)
    values: tuple[FloatArray, ...] = field(repr=False)

    @classmethod
    def from_scenario(cls, scenario: Scenario, max_nodes: int = _MAX_NODES) -> PairValueFunction:
        """Value function of a scenario of two members, on a grid of about `max_nodes` nodes.

        Raises
        ------
        PlanningError
            As `casswarm.bounds.pair_bound`.
        """
        require_scenario("PairValueFunction.from_scenario", scenario)
        program = first_program(scenario, max_nodes, certified=False)
        _, kept = program.backward()
        return cls(
            program.task.start,
            scenario.positions - program.starts,
            program.spacing,
            program.task.step,
            tuple(blocks[0] for blocks in program.blocks[1:]),
            tuple(values[0] for values in kept),
        )

    def after(self, step: int, positions: FloatArray) -> FloatArray:
        """Interpolated success probability (B,) of being at positions (B, 2, 2) at a step, from 1.

        It includes the losses of that step; 0 outside the grid.
        """
        if not 1 <= step <= len(self.values):
            return np.zeros(len(positions))
        block, values = self.blocks[step - 1], self.values[step - 1]
        at = ((positions - self.shifts - self.origin) / self.spacing).reshape(-1, 4) - block.first
        last = np.array(values.shape) - 1
        inside = ((at >= 0) & (at <= last)).all(axis=1)
        cells = np.clip(np.floor(at).astype(int), 0, last - 1)
        return np.where(inside, multilinear(values, cells, at - cells), 0.0)

    def path(self, starts: FloatArray) -> FloatArray:
        """Positions (N+1, 2, 2) along the best nodes from the starts, while both are alive."""
        position = (starts - self.shifts - self.origin).ravel() / self.spacing
        reach = self.step / self.spacing * (1 + 1e-9)
        path = [position]
        for block, values in zip(self.blocks, self.values, strict=True):
            near = NodeBlock.between(np.ceil(position - reach), np.floor(position + reach))
            near = near.common(block)
            window = values[near.within(block)]
            best = np.unravel_index(int(window.argmax()), window.shape)
            position = np.add(near.first, best, dtype=float)
            path.append(position)
        return self.origin + self.shifts + self.spacing * np.array(path).reshape(-1, 2, 2)
