"""Enumeration of the controlled Markov chain: outcome distributions without sampling.

Distinct states (positions, previous velocities, living members) carry probabilities. A step solves
every state once and splits it by which members survive. `StateSpaceExpansion.expand` takes the most
probable states first, in rounds of decreasing thresholds, until the residual mass is within
tolerance; `sample_residual` samples the states that it leaves (``docs/chain.md``).
`StateSpaceExpansion.layers` goes through the steps once and keeps the edges between the states, for
derivatives (``docs/policy-gradient-law.md``).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from ..policies.base import Policy
from ..typing import BoolArray, FloatArray, IntArray, Progress
from .confidence import effective_runs
from .distribution import Estimate, OutcomeDistribution
from .monte_carlo import Chain, Purpose, uniforms
from .states import Frontier, Outcomes, States, Step, Totals, outcomes
from .transition import Lattice, Transition, transition

if TYPE_CHECKING:
    from ..scenario import Scenario

MAX_MEMBERS = 12
"""Largest number of members for which all 2^n outcomes of a step may be enumerated."""

FIRST_THRESHOLD = 1e-3  # the first threshold, in tolerances
MAX_FACTOR = 8.0  # between the thresholds of successive rounds
PRUNING_FACTOR = 1e-3  # outcomes less probable than this, in thresholds, are pruned
BATCH = 1 << 16  # members solved at once: bounds memory
MAX_BYTES = 1 << 29  # of the states of the frontier, and of copies of them

_BINS = 4400  # of masses
_BEFORE_MERGING = 0.1  # of the mass that may be left out: before equal outcomes are identified
_PER_STATE = 32  # largest number of outcomes before that, per state that may be followed


@dataclass(frozen=True)
class ExpansionOptions:
    """Limits and tolerances of an expansion.

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
    max_bytes : int
        Memory of the states that wait to be solved; the least probable beyond it are pruned.
    """

    tolerance: float
    max_states: int
    lattice: Lattice | None = None
    max_pruned_fraction: float = math.inf
    min_probability: float = 0.0
    max_bytes: int = MAX_BYTES


class Edges(NamedTuple):
    """K outcomes of S states in which the run goes on, in the order of their states."""

    starts: IntArray  # (S+1,) range of every state's outcomes
    survived: BoolArray  # (K, n)
    children: IntArray  # (K,) state after the step that an outcome leads to; -1 if left out


@dataclass(frozen=True, eq=False)
class Layer:
    """States of a step that are followed, and where they lead."""

    states: States
    move: Transition
    step: Step
    edges: Edges


class StateSpaceExpansion:
    """A partially enumerated distribution.

    Parameters
    ----------
    scenario : Scenario
    policy : Policy
    initial_velocities : (n, 2)
        V(-1).
    options : ExpansionOptions
    case : int
        The true case of a hazard that is not known.

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
        case: int = 0,
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
        states = States.initial(scenario, initial_velocities, weighs=policy.weighs_cases)
        self.frontier.add(0, replace(states[case : case + 1], weights=np.ones(1)))

    @property
    def done(self) -> bool:
        """True if the bounds are narrow enough, or cannot be narrowed."""
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
            self.pruned += self.frontier.prune(self.max_stored)
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

    def _solve(self, step: int, states: States) -> Transition:
        """Solve states of a step, and count them."""
        move = transition(self.scenario, self.policy, step, states, self.options.lattice)
        self.solved += len(states)
        self.infeasible += float(states.weights @ move.counts["infeasible"])
        self.failures += float(states.weights @ move.counts["solver_failures"])
        return move

    def _expand_states(self, step: int, states: States, threshold: float) -> None:
        """Solve states of a step, and add their outcomes to the frontier or the statistics."""
        move = self._solve(step, states)
        totals = Totals.zeros(*states.alive.shape)._replace(
            population=self.population[step + 1], members=self.members
        )
        options, added = self.options, 0
        limits = self._cutoff(threshold), options.max_pruned_fraction, options.max_bytes // 8
        for batch in outcomes(move.step(states), totals, *limits):
            self.arrival[step + 1] += totals.arrival[0]
            self.survivors += totals.survivors
            self.ended[step + 1] += totals.survivors
            copies = Outcomes._make(array.copy() for array in batch)
            self.frontier.add(step + 1, move.following(*copies).aggregated()[0])
            added += len(batch.masses)
            if added > self.max_stored:
                self.pruned += self.frontier.prune(self.max_stored)
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
    def max_stored(self) -> int:
        """Largest number of states in the frontier."""
        return max(1024, self.options.max_bytes // self.bytes_per_state)

    @property
    def bytes_per_state(self) -> int:
        """Memory of a state of the frontier: two positions, velocities, flags and weights."""
        return 2 * (33 * self.scenario.n + 8)

    def layers(self, absorption: Callable[[Transition], FloatArray]) -> tuple[list[Layer], float]:
        """Expand every step once, and keep the edges; if not all states fit, the most probable.

        Parameters
        ----------
        absorption : callable
            A transition to the probabilities (S, n) that surviving members are absorbed.

        Returns
        -------
        layers : list of Layer
        residual_mass : float
            Mass that was left out.
        """
        layers: list[Layer] = []
        residual, steps = 0.0, self.scenario.n_steps
        (states,) = self.frontier.pop(0)
        for t in range(steps):
            move = self._solve(t, states)
            later = steps - 1 - t
            share = (self.options.tolerance - residual) / later if later else 1.0
            left = max(0, self.options.max_states - self.solved)
            limit = max(left // later, min(left, 1)) if later else 0
            step = move.step(states, absorption(move))
            probable, pruned = _probable_outcomes(step, _BEFORE_MERGING * share, _PER_STATE * limit)
            following, children = move.following(*probable).aggregated()
            masses = _Masses()
            bins = masses.add(following.weights)
            last, dropped = masses.last(share - pruned, limit)
            kept = bins <= last
            children = np.where(kept, np.cumsum(kept) - 1, -1)[children]
            starts = np.searchsorted(probable.parents, np.arange(len(states) + 1))
            layers.append(Layer(states, move, step, Edges(starts, probable.survived, children)))
            residual += pruned + dropped if later else 0.0  # after the last step nobody arrives
            states = following[kept]
            if not len(states):
                break
        return layers, residual

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


def _bins(masses: FloatArray) -> IntArray:
    """Bins of masses: bin b has those from 2^(-(b + 1) / 4), exclusively, to 2^(-b / 4)."""
    bins = np.floor(-4.0 * np.log2(masses)).astype(np.int64)
    return np.minimum(np.maximum(bins, 0), _BINS - 1)


class _Masses:
    """Numbers and sums of positive masses by bins.

    Whole bins are left out, so that what is followed does not depend on the order of equal states.
    """

    def __init__(self) -> None:
        self.counts, self.sums = np.zeros(_BINS, np.int64), np.zeros(_BINS)

    def add(self, masses: FloatArray) -> IntArray:
        """Add masses, one after the other, and return their bins: see `_bins`."""
        bins = _bins(masses)
        self.counts += np.bincount(bins, minlength=_BINS)
        np.add.at(self.sums, bins, masses)
        return bins

    def last(self, share: float, limit: int) -> tuple[int, float]:
        """Last bin that is followed, and the mass in all bins after it.

        At most `share` is left out unless more than `limit` masses would be followed.
        """
        after = np.append(self.sums[::-1].cumsum()[::-1], 0.0)[1:]  # in the bins after each
        allowed = int((self.counts.cumsum() <= limit).sum()) - 1
        last = min(int((after <= max(share, 0.0)).argmax()), allowed)  # of the last bin it is 0
        return last, float(after[last]) if last >= 0 else float(self.sums.sum())


def _probable_outcomes(step: Step, share: float, limit: int) -> tuple[Outcomes, float]:
    """Outcomes in which the run goes on, by `_Masses.last`, and the mass of the others."""
    found, number, totals = _Masses(), 0, Totals.zeros(*step.alive.shape)
    for batch in outcomes(step, totals):
        found.add(batch.masses)
        number += 1
    last, left_out = found.last(share, limit)
    # more than a batch would take too much memory: they are enumerated once more
    least = (1.0 - 1e-12) * 2.0 ** (-(last + 1) / 4)  # below bin `last` by no more than rounding
    chosen = []
    for again in [batch] if number == 1 else outcomes(step, totals, least):
        rows = np.flatnonzero(_bins(again.masses) <= last)
        chosen.append([array.take(rows, axis=0) for array in again])
    return Outcomes._make(map(np.concatenate, zip(*chosen, strict=True))), left_out


def sample_residual(
    expansion: StateSpaceExpansion, chain: Chain, runs: int, progress: Progress | None = None
) -> Estimate:
    """Sample the states that an expansion left.

    States of total mass M are left in the frontier. They are divided into R strata of equal mass,
    ordered by living members and step so that neighbouring strata are alike, and one run is sampled
    from every stratum. M times the `stratified_interval` is the contribution of the residual mass;
    outcomes too improbable to be stored contribute [0, their mass]. Why that interval is valid and
    narrower: ``docs/chain.md``.

    Parameters
    ----------
    expansion : StateSpaceExpansion
    chain : Chain
        Chain of the same scenario; its seed determines the sample.
    runs : int
        R.
    progress : Progress, optional
        Receives "sampling", the number of runs that have ended and R, after every step.
    """
    distribution, pruned = expansion.distribution(), float(expansion.pruned.sum())
    batches = [
        (step, batch)
        for frontier in (expansion.frontier, expansion.unsplit)
        for step, batches in enumerate(frontier.batches)
        for batch in batches
    ]
    if not batches:
        return Estimate(distribution, 0.0, pruned, 0, 0, 0.0, chain.seed, expansion.solved)
    states = States.concatenate([batch for _, batch in batches])
    steps = np.concatenate([np.full(len(batch), step) for step, batch in batches])
    order = np.lexsort((steps, states.alive.sum(axis=1)))
    states, steps = states[order], steps[order]
    ends = np.cumsum(states.weights)
    jitter = uniforms(chain.seed, 0, 0, runs, 1, Purpose.STRATA)[:, 0]
    masses = (np.arange(runs) + jitter) / runs * ends[-1]
    selected = np.minimum(np.searchsorted(ends, masses, side="right"), len(states) - 1)
    report = progress and (lambda _, ended, total: progress("sampling", ended, total))
    sample = chain.finish(expansion.policy, states[selected], steps[selected], report)
    arrived = sample.arrival >= 0
    return Estimate(
        distribution,
        float(ends[-1]),
        pruned,
        runs,
        int(arrived.sum()),
        effective_runs(arrived) if len(states) > 1 else float(runs),
        chain.seed,
        expansion.solved + sample.states,
    )
