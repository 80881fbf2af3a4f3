"""Estimates that enumerate the most probable states exactly and sample the residual mass.

States of total mass M are left in the frontier of the expansion. They are divided into R strata of
equal mass, ordered by living members and step so that neighbouring strata are alike, and one run is
sampled from every stratum. M times the `stratified_interval` is the contribution of the residual
mass; outcomes too improbable to be stored contribute [0, their mass]. Why that interval is valid
and narrower: ``docs/chain.md``.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..typing import Interval
from .confidence import LEVEL, effective_runs, stratified_interval
from .distribution import OutcomeDistribution
from .exact import StateSpaceExpansion
from .monte_carlo import Chain, Purpose, uniforms
from .states import States

MAX_PRUNED_FRACTION = 1e-5

VISITS = 2.0
"""Expected visits by R plain runs to the least probable state that is enumerated."""


@dataclass(frozen=True)
class Estimate:
    """Success probability of which one part is proven and the other statistical.

    Parameters
    ----------
    enumerated : OutcomeDistribution
        The proven part: its bounds hold with certainty.
    sampled_mass : float
        Mass of the states that were sampled.
    pruned_mass : float
        Mass that was neither enumerated nor sampled; it widens the interval.
    runs, successes : int
        Numbers of sampled runs, and of those that succeeded.
    effective_runs : float
        Number of independent runs with the same variance, at least `runs`.
    seed : int
    states : int
        Distinct states solved, enumerated or sampled.
    level : float
        Confidence level of the interval.
    """

    enumerated: OutcomeDistribution
    sampled_mass: float
    pruned_mass: float
    runs: int
    successes: int
    effective_runs: float
    seed: int
    states: int
    level: float = LEVEL

    @property
    def success(self) -> Interval:
        """Interval of the success probability, of confidence `level`."""
        low, high = self.enumerated.success
        if not self.runs:
            return Interval(low, high)
        bottom, top = stratified_interval(
            self.successes, self.runs, self.effective_runs, self.level
        )
        top = low + self.sampled_mass * top + self.pruned_mass
        return Interval(low + self.sampled_mass * bottom, min(1.0, top))

    @property
    def policy(self) -> str:
        """Name of the policy."""
        return self.enumerated.policy

    def __str__(self) -> str:
        low, high = self.success
        first, last = self.enumerated.success
        return (
            f"{self.policy}: success between {low:.6f} and {high:.6f} with {self.level:.0%} "
            f"confidence; proven bounds: {first:.6f} to {last:.6f}; residual mass "
            f"{self.sampled_mass:.4g} sampled by {self.runs} runs, {self.states} distinct states "
            "solved"
        )


def sample_residual(expansion: StateSpaceExpansion, chain: Chain, runs: int) -> Estimate:
    """Sample the states that an expansion left.

    Parameters
    ----------
    expansion : StateSpaceExpansion
    chain : Chain
        Chain of the same scenario; its seed determines the sample.
    runs : int
    """
    distribution, solved = expansion.distribution(), expansion.solved
    pruned = float(expansion.pruned.sum())
    batches = [
        (step, batch)
        for frontier in (expansion.frontier, expansion.unsplit)
        for step, batches in enumerate(frontier.batches)
        for batch in batches
    ]
    if not batches:
        return Estimate(distribution, 0.0, pruned, 0, 0, 0.0, chain.seed, solved)
    states = States.concatenate([batch for _, batch in batches])
    steps = np.concatenate([np.full(len(batch), step) for step, batch in batches])
    order = np.lexsort((steps, states.alive.sum(axis=1)))
    states, steps = states[order], steps[order]
    ends = np.cumsum(states.weights)
    jitter = uniforms(chain.seed, 0, 0, runs, 1, Purpose.STRATA)[:, 0]
    masses = (np.arange(runs) + jitter) / runs * ends[-1]
    selected = np.minimum(np.searchsorted(ends, masses, side="right"), len(states) - 1)
    sample = chain.finish(expansion.policy, states[selected], steps[selected])
    outcomes = sample.arrival >= 0
    return Estimate(
        distribution,
        float(ends[-1]),
        pruned,
        runs,
        int(outcomes.sum()),
        effective_runs(outcomes) if len(states) > 1 else float(runs),
        chain.seed,
        solved + sample.states,
    )
