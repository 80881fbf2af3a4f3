"""The head of a law exactly, and the rest sampled: for swarms whose law cannot be closed.

`propagate` leaves states that wait, of total mass M. These are cut into R parts of equal mass, and
one run is sampled from every part, independently. The number of successes S then is a sum of R
independent trials with unequal probabilities, whose variance is no greater and whose tails are no
heavier than the binomial's of the same mean (Hoeffding, Ann. Math. Statist. 27, 1956, theorem 4),
so that Wilson's interval for S of R covers its mean about as often as that of plain runs covers
theirs, and M times it covers what the rest adds to the success.

Why that is no worse than plain sampling, up to a few percent: a state of probability w is visited
by R plain runs with probability 1 - (1 - w)^R, 0.86 at w = `VISITS` / R, so that what the
head solves, they would solve too. Below the head R / M plain runs solve as much as R of
these; their variance is
p (1 - p) M / R, the hybrid's M^2 q (1 - q) / R with q the success below the head, and
p (1 - p) >= M q (1 - q), by the law of total variance.

Outcomes that were too light to be kept count as a bracket, [0, their mass]; a state in which they
would weigh more than `MOST_LIGHT` of it is not split but sampled as it is.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..statistics import LEVEL, wilson
from .evaluate import Head
from .law import Law
from .random import uniforms
from .simulate import Chain
from .states import States

MOST_LIGHT = 1e-5

VISITS = 2.0
"""Visits that R plain runs pay on average to the lightest state that the head solves."""

_STEP_OF_CHOICE = 1 << 30  # where the random numbers that choose states come from: no real step


@dataclass(frozen=True)
class Estimate:
    """A success probability of which one part is proven and the other statistical.

    Parameters
    ----------
    head : Law
        What is proven: its bracket holds with certainty (see `Law`).
    sampled : float
        Mass that was sampled.
    light : float
        Mass that was neither followed nor sampled; the interval is wider by it.
    runs, successes : int
        Of the sample.
    seed : int
    states : int
        Distinct states solved, head and sample together.
    level : float
        Confidence of the interval.
    """

    head: Law
    sampled: float
    light: float
    runs: int
    successes: int
    seed: int
    states: int
    level: float = LEVEL

    @property
    def success(self) -> tuple[float, float]:
        """Interval of the success probability, of confidence `level`."""
        low = self.head.success[0]
        if not self.runs:
            return self.head.success
        bottom, top = wilson(self.successes, self.runs, self.level)
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


def sample_rest(head: Head, chain: Chain, runs: int, level: float = LEVEL) -> Estimate:
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
        return Estimate(law, 0.0, light, 0, 0, chain.seed, head.states, level)
    states = States.joined([part for _, part in parts])
    steps = np.concatenate([np.full(len(part), step) for step, part in parts])
    ends = np.cumsum(states.weights)
    jitter = uniforms(chain.seed, _STEP_OF_CHOICE, 0, runs, 1)[:, 0]
    places = (np.arange(runs) + jitter) / runs * ends[-1]
    chosen = np.minimum(np.searchsorted(ends, places, side="right"), len(states) - 1)
    found = chain.finish(head.policy, states[chosen], steps[chosen])
    successes = int((found.arrival >= 0).sum())
    return Estimate(
        law,
        float(ends[-1]),
        light,
        runs,
        successes,
        chain.seed,
        head.states + found.states,
        level,
    )
