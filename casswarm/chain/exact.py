"""The controlled Markov chain, exactly: the law of a policy without sampling.

Policies are deterministic, so between two destructions nothing is random. The law is a set of
distinct states (positions, previous velocities, who is alive) with probabilities. A step solves a
state once and splits it by who survives; equal states are merged. What is not followed to its end
may succeed or not, so every probability is a bracket [low, low + set aside] and no estimate.

States are followed in rounds, heaviest first: a round goes through the steps and solves every
state whose probability is at least a threshold, and the threshold falls from round to round until
what is left is within tolerance. So there is a bracket at any time, and it shrinks as it goes.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from ..policies.base import Policy
from ..typing import FloatArray
from .distribution import OutcomeDistribution
from .states import AbsorptionStatistics, States, split
from .transition import transition

if TYPE_CHECKING:
    from ..scenario import Scenario

MAX_MEMBERS = 12
"""Members up to which every one of the 2^n outcomes of a step may be enumerated."""

FIRST = 1e-3  # the first threshold, in tolerances
LIGHT = 1e-3  # outcomes lighter by this factor than the threshold are set aside for good
BATCH = 1 << 16  # members solved at once: bounds memory
HELD = 1 << 28  # bytes of states that may wait

Progress = Callable[[int, float], None]


def propagate(
    scenario: Scenario,
    policy: Policy,
    before: FloatArray,
    tolerance: float,
    max_states: int,
    aggregation_tol: float = 0.0,
    progress: Progress | None = None,
    most_light: float = math.inf,
    least: float = 0.0,
) -> StateSpaceExpansion:
    """Follow the heaviest states until what is left is within tolerance, or the states run out.

    Parameters
    ----------
    scenario : Scenario
    policy : Policy
    before : (n, 2)
        V(-1).
    tolerance : float
        Mass that may be left.
    max_states : int
        States solved at the most.
    aggregation_tol : float
        Width of the grid, in units of positions and of velocities, in a cell of which states count
        as equal; 0 merges what is equal to the last bit, and nothing else.
    progress : callable, optional
        Called with the number of states solved so far and the mass that is left.
    most_light : float
        Part of a state that may be set aside for good as too light when it is split; a state of
        which that would be more is left as it is.
    least : float
        Probability below which no state is solved.
    """
    head = StateSpaceExpansion(scenario, policy, tolerance, max_states, aggregation_tol, most_light)
    head.waiting[0] = [States.start(scenario, before)]
    threshold = max(FIRST * tolerance, 1.0 / max_states) if tolerance > 0 else 0.0
    threshold = max(threshold, least)
    past: list[tuple[float, float, int]] = []
    while not head.done:
        head.round(threshold, progress)
        if head.done or threshold <= least:
            break
        past.append((threshold, head.waiting_mass, head.states))
        threshold = max(_lowered(past, tolerance, max_states), least)
    return head


@dataclass
class StateSpaceExpansion:
    """The part of a law that has been followed so far, and the states that wait.

    Parameters
    ----------
    waiting : N+1 lists of States
        By step; those at the horizon are counted at once and do not wait.
    whole : N+1 lists of States
        States that cannot be split, by step.
    light : (N+1,)
        Mass of the outcomes of a step that were too light to be kept.
    """

    scenario: Scenario
    policy: Policy
    tolerance: float
    max_states: int
    aggregation_tol: float
    most_light: float = math.inf
    waiting: list[list[States]] = field(init=False)
    whole: list[list[States]] = field(init=False)
    light: FloatArray = field(init=False)
    endings: AbsorptionStatistics = field(init=False)
    states: int = 0
    infeasible: float = 0.0
    failures: float = 0.0

    def __post_init__(self) -> None:
        self.waiting = [[] for _ in range(self.scenario.n_steps + 1)]
        self.whole = [[] for _ in range(self.scenario.n_steps + 1)]
        self.light = np.zeros(self.scenario.n_steps + 1)
        self.endings = AbsorptionStatistics.none(self.scenario)

    @property
    def waiting_by_step(self) -> FloatArray:
        """Mass (N+1,) of the states that wait at every step."""
        return _masses(self.waiting)

    @property
    def waiting_mass(self) -> float:
        """Mass of all states that wait."""
        return float(self.waiting_by_step.sum())

    @property
    def done(self) -> bool:
        """Whether the bracket is narrow enough, or nothing can be done about it."""
        waiting, light = self.waiting_mass, float(self.light.sum())
        return (
            waiting <= self.tolerance - light
            or waiting == 0.0
            or self.states >= self.max_states
            or (light > self.tolerance and waiting <= light)
        )

    def round(self, threshold: float, progress: Progress | None = None) -> None:
        """Solve the states that weigh at least `threshold`, step after step."""
        for step in range(self.scenario.n_steps):
            if not self.waiting[step]:
                continue
            pool = States.joined(self.waiting[step]).merged(self.aggregation_tol)
            heavy = self._affordable(pool.weights, threshold)
            self.waiting[step] = [] if heavy.all() else [pool[~heavy]]
            rows = np.flatnonzero(heavy)
            size = max(1, BATCH // self.scenario.n)
            for start in range(0, len(rows), size):
                self._advance(step, pool[rows[start : start + size]], threshold)
            if step + 1 == self.scenario.n_steps:
                self._end_at_horizon()
            self._bound_memory()
            if rows.size and progress is not None:
                progress(self.states, self.waiting_mass + float(self.light.sum()))
            if self.done:
                return

    def _affordable(self, weights: FloatArray, threshold: float) -> np.ndarray:
        """Which states are solved: those at least as heavy as the threshold, as many as allowed."""
        heavy = np.asarray(weights >= threshold)
        left = self.max_states - self.states
        if heavy.sum() > left:
            heavy = np.zeros(len(weights), bool)
            heavy[np.argsort(-weights, kind="stable")[:left]] = True
        return heavy

    def _advance(self, step: int, states: States, threshold: float) -> None:
        move = transition(
            self.scenario,
            self.policy,
            step,
            states.positions,
            states.previous_velocities,
            states.alive,
        )
        self.states += len(states)
        self.infeasible += float(states.weights @ move.infeasible)
        self.failures += float(states.weights @ move.failures)
        light, added = np.zeros(len(states)), 0
        cutoff = self._cutoff(threshold)
        for part in split(move, states, step, cutoff, self.most_light, self.endings, light):
            if len(part):
                self.waiting[step + 1].append(part.merged(self.aggregation_tol))
                added += len(part)
            if added > self._most_held:
                self._bound_memory()
                added = 0
        if (light < 0).any():
            self.whole[step].append(states[light < 0])
        self.light[step] += light[light > 0].sum()

    def _cutoff(self, threshold: float) -> float:
        """Mass below which an outcome is set aside for good."""
        enumerable = self.scenario.n <= MAX_MEMBERS
        if enumerable and (self.most_light < math.inf or self.light.sum() > self.tolerance / 4):
            return 0.0
        return LIGHT * threshold if enumerable else LIGHT**2 * threshold

    def _end_at_horizon(self) -> None:
        for part in self.waiting[-1]:
            self.endings.end(part)
        self.waiting[-1] = []

    @property
    def _most_held(self) -> int:
        """States that may wait."""
        return max(1024, HELD // (33 * self.scenario.n + 8))

    def _bound_memory(self) -> None:
        """Set the lightest states aside for good where too many wait."""
        most = self._most_held
        weights = [part.weights for parts in self.waiting for part in parts]
        count = sum(map(len, weights))
        if count <= most:
            return
        least = float(np.partition(np.concatenate(weights), count - most // 2)[count - most // 2])
        for step, parts in enumerate(self.waiting):
            self.light[step] += sum(part.weights[part.weights < least].sum() for part in parts)
            kept = [part[part.weights >= least] for part in parts]
            self.waiting[step] = [part for part in kept if len(part)]

    def law(self) -> OutcomeDistribution:
        """What is known of the law."""
        aside = self.waiting_by_step + _masses(self.whole) + self.light
        before = np.concatenate([[0.0], np.cumsum(aside)[:-1]])
        ended = self.endings.ended.cumsum(axis=0)
        ended = np.vstack([np.zeros_like(ended[:1]), ended[:-1]])
        return OutcomeDistribution(
            policy=self.policy.name,
            arrival=self.endings.arrival,
            survivors=self.endings.survivors,
            members=self.endings.members,
            population=self.endings.population + ended,
            unknown=before,
            unresolved=float(aside.sum()),
            states=self.states,
            infeasible=self.infeasible,
            failures=self.failures,
            tolerance=self.tolerance,
            aggregation_tol=self.aggregation_tol,
        )


def _masses(states: list[list[States]]) -> FloatArray:
    return np.array([sum(part.mass for part in parts) for parts in states])


def _lowered(past: list[tuple[float, float, int]], tolerance: float, max_states: int) -> float:
    """The next threshold, from the (threshold, mass left, states solved) of the rounds so far.

    Mass and states are taken for powers of the threshold: the next one should leave four fifths of
    the tolerance, and need no more states than there are.
    """
    threshold, mass, states = past[-1]
    shrinks, grows = 0.5, 0.8
    if len(past) > 1 and past[-2][0] > threshold > 0.0:
        down = math.log(past[-2][0] / threshold)
        shrinks = min(1.0, max(0.2, math.log(max(past[-2][1] / mass, 1.0)) / down))
        grows = min(1.2, max(0.3, math.log(states / past[-2][2]) / down))
    factor = (mass / (0.8 * tolerance)) ** (1.0 / shrinks) if tolerance > 0 else 32.0
    most = (max_states / max(1, states)) ** (1.0 / grows)
    return threshold / max(1.2, float(min(factor, most, 32.0)))
