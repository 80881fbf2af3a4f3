"""Exact evaluation of the controlled Markov chain: outcome distributions without sampling.

Distinct states (positions, previous velocities, living members) carry probabilities. A step solves
every state once and splits it by which members survive. States are expanded most probable first, in
rounds of decreasing thresholds, until the residual mass is within tolerance (``docs/chain.md``).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from ..policies.base import Policy
from ..typing import BoolArray, FloatArray, Progress
from .distribution import OutcomeDistribution
from .outcome_kernels import Outcomes, Totals
from .states import Frontier, States, outcomes
from .transition import Lattice, transition

if TYPE_CHECKING:
    from ..scenario import Scenario

MAX_MEMBERS = 12
"""Largest number of members for which all 2^n outcomes of a step may be enumerated."""

FIRST_THRESHOLD = 1e-3  # the first threshold, in tolerances
MAX_FACTOR = 8.0  # between the thresholds of successive rounds
PRUNING_FACTOR = 1e-3  # outcomes less probable than this, in thresholds, are pruned
BATCH = 1 << 16  # members solved at once: bounds memory
MAX_BYTES = 1 << 28  # of the states of the frontier


@dataclass(frozen=True)
class ExpansionOptions:
    """What an expansion may spend, and how precise it should be.

    Parameters
    ----------
    tolerance : float
        Residual mass at which the expansion stops.
    max_states : int
        Maximum number of states to solve.
    lattice : Lattice, optional
        Lattice of the positions, on which nearly equal states become equal.
    max_pruned_fraction : float
        Largest fraction of a state's probability that may be pruned when it is split; a state that
        would lose more is not split.
    min_probability : float
        States less probable than this are not solved.
    """

    tolerance: float
    max_states: int
    lattice: Lattice | None = None
    max_pruned_fraction: float = math.inf
    min_probability: float = 0.0


class StateSpaceExpansion:
    """A partially enumerated distribution.

    Parameters
    ----------
    scenario : Scenario
    policy : Policy
    initial_velocities : (n, 2)
        V(-1).
    options : ExpansionOptions

    Attributes
    ----------
    frontier : Frontier
        States that can be expanded; those at the horizon are absorbed at once.
    unsplit : Frontier
        Solved states that were not split, because too much of them would have been pruned.
    pruned : (N+1,)
        Mass of the outcomes of every step that were too improbable to be stored.
    arrival : (N+1,)
        Mass of the runs that were absorbed by an arrival at step t.
    survivors, members : (n+1,), (n,)
        Mass of the absorbed runs with k survivors, and of those that a member survives.
    population, ended : (N+1, n+1)
        Mass of the states with k alive that were reached at step t, and of the absorbed ones.
    solved : int
        Number of states solved.
    infeasible, failures : float
        Expected numbers of infeasible member-steps and of solver failures.
    """

    def __init__(
        self,
        scenario: Scenario,
        policy: Policy,
        initial_velocities: FloatArray,
        options: ExpansionOptions,
    ) -> None:
        self.scenario, self.policy, self.options = scenario, policy, options
        n, steps = scenario.n, scenario.n_steps
        self.frontier, self.unsplit = Frontier(steps), Frontier(steps)
        self.pruned: FloatArray = np.zeros(steps + 1)
        self.arrival, self.survivors = np.zeros(steps + 1), np.zeros(n + 1)
        self.members = np.zeros(n)
        self.population, self.ended = np.zeros((2, steps + 1, n + 1))
        self.population[0, n] = 1.0
        self.solved, self.infeasible, self.failures = 0, 0.0, 0.0
        self.frontier.add(0, States.initial(scenario, initial_velocities))

    @property
    def done(self) -> bool:
        """Whether the bounds are narrow enough, or cannot be narrowed."""
        mass, pruned = self.frontier.mass, float(self.pruned.sum())
        tolerance = self.options.tolerance
        return (
            mass <= tolerance - pruned
            or mass == 0.0
            or self.solved >= self.options.max_states
            or (pruned > tolerance and mass <= pruned)
        )

    def expand(self, progress: Progress | None = None) -> None:
        """Expand the most probable states until the residual mass is within tolerance.

        Parameters
        ----------
        progress : Progress, optional
            Receives the policy's name and the enumerated probability mass, of a total of 1.
        """
        tolerance, max_states = self.options.tolerance, self.options.max_states
        least = self.options.min_probability
        threshold = max(FIRST_THRESHOLD * tolerance, 1.0 / max_states) if tolerance > 0 else 0.0
        threshold = max(threshold, least)
        history: list[tuple[float, float, int]] = []
        while not self.done:
            self._expand_round(threshold, progress)
            if self.done or threshold <= least:
                break
            history.append((threshold, self.frontier.mass, self.solved))
            threshold = max(_next_threshold(history, tolerance, max_states), least)

    def _expand_round(self, threshold: float, progress: Progress | None) -> None:
        """Expand the states of probability at least `threshold`, step after step."""
        for step in range(self.scenario.n_steps):
            if not self.frontier.batches[step]:
                continue
            pool, _ = States.concatenate(self.frontier.pop(step)).aggregated()
            selected = self._selected(pool.weights, threshold)
            self.frontier.add(step, pool[~selected])
            rows = np.flatnonzero(selected)
            size = max(1, BATCH // self.scenario.n)
            for start in range(0, len(rows), size):
                self._expand_states(step, pool[rows[start : start + size]], threshold)
            if step + 1 == self.scenario.n_steps:
                for batch in self.frontier.pop(step + 1):
                    self.survivors += np.bincount(
                        batch.alive.sum(axis=1), batch.weights, len(self.survivors)
                    )
                    self.members += batch.weights @ batch.alive
            self.pruned += self.frontier.prune(self._max_stored)
            if rows.size and progress is not None:
                residual = self.frontier.mass + float(self.pruned.sum())
                progress(self.policy.name, 1.0 - residual, 1.0)
            if self.done:
                return

    def _selected(self, weights: FloatArray, threshold: float) -> BoolArray:
        """States to solve: those at least as probable as the threshold, within the budget."""
        selected = np.asarray(weights >= threshold)
        budget = self.options.max_states - self.solved
        if selected.sum() > budget:
            selected = np.zeros(len(weights), bool)
            selected[np.argsort(-weights, kind="stable")[:budget]] = True
        return selected

    def _expand_states(self, step: int, states: States, threshold: float) -> None:
        """Solve states of a step, and add their outcomes to the frontier or the statistics."""
        move = transition(self.scenario, self.policy, step, states, self.options.lattice)
        self.solved += len(states)
        self.infeasible += float(states.weights @ move.counts["infeasible"])
        self.failures += float(states.weights @ move.counts["solver_failures"])
        totals = Totals.zeros(*states.alive.shape)._replace(
            population=self.population[step + 1], members=self.members
        )
        added, limits = 0, (self._cutoff(threshold), self.options.max_pruned_fraction)
        for batch in outcomes(move.step(states), totals, *limits):
            self.arrival[step + 1] += totals.arrival[0]
            self.survivors += totals.survivors
            self.ended[step + 1] += totals.survivors
            copies = Outcomes._make(array.copy() for array in batch)
            self.frontier.add(step + 1, move.following(*copies).aggregated()[0])
            added += len(batch.masses)
            if added > self._max_stored:
                self.pruned += self.frontier.prune(self._max_stored)
                added = 0
        pruned = totals.pruned
        if (pruned < 0).any():
            self.unsplit.add(step, states[pruned < 0])
        self.pruned[step] += pruned[pruned > 0].sum()

    def _cutoff(self, threshold: float) -> float:
        """Mass below which an outcome is pruned."""
        enumerable = self.scenario.n <= MAX_MEMBERS
        limited = self.options.max_pruned_fraction < math.inf
        if enumerable and (limited or self.pruned.sum() > self.options.tolerance / 4):
            return 0.0
        return PRUNING_FACTOR * threshold if enumerable else PRUNING_FACTOR**2 * threshold

    @property
    def _max_stored(self) -> int:
        """Largest number of states in the frontier."""
        return max(1024, MAX_BYTES // (33 * self.scenario.n + 8))

    def distribution(self) -> OutcomeDistribution:
        """Bounds of the distribution, from what is enumerated so far."""
        residual = self.frontier.masses + self.unsplit.masses + self.pruned
        lattice = self.options.lattice
        ended = self.ended.cumsum(axis=0)
        ended = np.vstack([np.zeros_like(ended[:1]), ended[:-1]])
        return OutcomeDistribution(
            policy=self.policy.name,
            arrival=self.arrival,
            survivors=self.survivors,
            members=self.members,
            population=self.population + ended,
            residual_mass_before=np.concatenate([[0.0], np.cumsum(residual)[:-1]]),
            residual_mass=float(residual.sum()),
            states=self.solved,
            infeasible=self.infeasible,
            failures=self.failures,
            tolerance=self.options.tolerance,
            aggregation_tol=0.0 if lattice is None else lattice.spacing,
        )


def _next_threshold(
    history: list[tuple[float, float, int]], tolerance: float, max_states: int
) -> float:
    """The next threshold, from (threshold, frontier mass, states solved) of the rounds so far.

    Mass and states are modelled as powers of the threshold: the next one should leave nine tenths
    of the tolerance, and need no more states than are available.
    """
    threshold, mass, states = history[-1]
    mass_exponent, states_exponent = 0.9, 0.8
    if len(history) > 1 and history[-2][0] > threshold > 0.0:
        down = math.log(history[-2][0] / threshold)
        mass_exponent = min(1.0, max(0.2, math.log(max(history[-2][1] / mass, 1.0)) / down))
        states_exponent = min(1.2, max(0.3, math.log(states / history[-2][2]) / down))
    factor = (mass / (0.9 * tolerance)) ** (1.0 / mass_exponent) if tolerance > 0 else math.inf
    budget = (max_states / max(1, states)) ** (1.0 / states_exponent)
    return threshold / max(1.2, float(min(factor, budget, MAX_FACTOR)))
