"""The head of a law exactly, and the rest sampled: for swarms whose law cannot be closed.

`propagate` leaves states that wait, of total mass M. These are cut into R parts of equal mass, and
one run is sampled from every part, independently. States are ordered by who is left and by step, so
that neighbouring parts are alike; how much that saves is seen from pairs of neighbours
(`effective_runs`), and Wilson's interval with the effective number of runs covers the mean of the
rest's successes about as often as that of plain runs covers theirs. M times it is what the rest
adds to the success.

Why that is narrower than plain sampling with as many solves: a state of probability w is visited
by R plain runs with probability 1 - (1 - w)^R, 0.86 at w = `VISITS` / R, so that what the
head solves, they would solve too. Below the head R / M plain runs solve as much as R of
these; their variance is
p (1 - p) M / R, the hybrid's at most M^2 q (1 - q) / R with q the success below the head, and
p (1 - p) >= M q (1 - q), by the law of total variance. Where no state but the first is heavy
enough, M is 1 and the two are the same.

Outcomes that were too light to be kept count as a bracket, [0, their mass]; a state in which they
would weigh more than `MAX_LIGHT` of it is not split but sampled as it is.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .confidence import LEVEL, effective_runs, wilson
from .distribution import OutcomeDistribution
from .exact import StateSpaceExpansion
from .monte_carlo import Chain
from .random_streams import uniforms
from .states import States

MAX_LIGHT = 1e-5

VISITS = 2.0
"""Visits that R plain runs pay on average to the lightest state that the head solves."""

_STEP_OF_CHOICE = 1 << 30  # where the random numbers that choose states come from: no real step


@dataclass(frozen=True)
class Estimate:
    """A success probability of which one part is proven and the other statistical.

    Parameters
    ----------
    head : Law
        What is proven: its bracket holds with certainty (see `OutcomeDistribution`).
    sampled : float
        Mass that was sampled.
    light : float
        Mass that was neither followed nor sampled; the interval is wider by it.
    runs, successes : int
        Of the sample.
    effective : float
        Independent runs that are as good as these, at least `runs`.
    seed : int
    states : int
        Distinct states solved, head and sample together.
    level : float
        Confidence of the interval.
    """

    head: OutcomeDistribution
    sampled: float
    light: float
    runs: int
    successes: int
    effective: float
    seed: int
    states: int
    level: float = LEVEL

    @property
    def success(self) -> tuple[float, float]:
        """Interval of the success probability, of confidence `level`."""
        low = self.head.success[0]
        if not self.runs:
            return self.head.success
        mean = self.successes / self.runs
        bottom, top = wilson(mean * self.effective, self.effective, self.level)
        return low + self.sampled * bottom, min(1.0, low + self.sampled * top + self.light)

    @property
    def policy(self) -> str:
        """Name of the policy."""
        return self.head.policy

    def __str__(self) -> str:
        low, high = self.success
        first, last = self.head.success
        return (
            f"{self.policy}: success between {low:.6f} and {high:.6f} with {self.level:.0%} "
            f"confidence; {'proven' if self.head.proven else 'followed, states merged'}: "
            f"{first:.6f} to {last:.6f}; a mass of {self.sampled:.4g} sampled "
            f"by {self.runs} runs, {self.states} distinct states solved"
        )


def sample_rest(
    head: StateSpaceExpansion, chain: Chain, runs: int, level: float = LEVEL
) -> Estimate:
    """Sample what a head left.

    Parameters
    ----------
    head : Head
    chain : Chain
        Of the same scenario; its seed decides.
    runs : int
    level : float
    """
    light, law = float(head.light.sum()), head.law()
    parts = [
        (step, part)
        for waiting in (head.waiting, head.whole)
        for step, parts in enumerate(waiting)
        for part in parts
    ]
    if not parts:
        return Estimate(law, 0.0, light, 0, 0, 0.0, chain.seed, head.states, level)
    states = States.joined([part for _, part in parts])
    steps = np.concatenate([np.full(len(part), step) for step, part in parts])
    order = np.lexsort((steps, states.alive.sum(axis=1)))
    states, steps = states[order], steps[order]
    ends = np.cumsum(states.weights)
    jitter = uniforms(chain.seed, _STEP_OF_CHOICE, 0, runs, 1)[:, 0]
    places = (np.arange(runs) + jitter) / runs * ends[-1]
    chosen = np.minimum(np.searchsorted(ends, places, side="right"), len(states) - 1)
    found = chain.finish(head.policy, states[chosen], steps[chosen])
    outcomes = found.arrival >= 0
    return Estimate(
        law,
        float(ends[-1]),
        light,
        runs,
        int(outcomes.sum()),
        effective_runs(outcomes) if len(states) > 1 else float(runs),
        chain.seed,
        head.states + found.states,
        level,
    )
