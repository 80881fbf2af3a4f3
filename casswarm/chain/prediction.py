"""Prediction of the states that an enumeration will solve, from sampled runs.

A run visits a state s with probability p(s), so the number of states with p >= theta is the mean,
over runs, of the sum of 1 / p over such states on the way: the estimator of Horvitz and Thompson
(J. Am. Stat. Assoc. 47, 1952), as in Knuth's of the size of a tree (Math. Comp. 29, 1975). Of p(s)
only the part of the histories that were sampled is known, so predictions are too large rather than
too small, by less with more runs.

An enumeration leaves out what falls below theta. The fraction of runs that do so is estimated, too,
and extrapolated as a power of theta where the runs are too few.
"""

from __future__ import annotations

import math
import time
from dataclasses import dataclass

import numpy as np
from typing_extensions import override

from ..typing import BoolArray, FloatArray, IntArray
from .exact import FIRST_THRESHOLD, StateSpaceExpansion
from .monte_carlo import Chain, Purpose, RunBatch
from .states import States

RUNS = (250, 1000, 4000, 16_000)
ENOUGH = 10_000  # states that are solved for a prediction, about
_TAIL = 20  # runs from which a fraction is estimated
_USED = 0.9  # part of the tolerance that an enumeration uses


@dataclass(frozen=True)
class StatePrediction:
    """What an exact evaluation is expected to need.

    Parameters
    ----------
    states : int
        Number of states that it solves: mostly too many, by up to a factor of about ten.
    megabytes : float
        Memory that the states take.
    limited : bool
        Whether the largest number of states, or the memory, is reached before the tolerance: the
        bounds are then wider.
    """

    states: int
    megabytes: float
    limited: bool

    def __str__(self) -> str:
        memory = f"{self.megabytes:.0f} MB" if self.megabytes >= 0.5 else "less than 1 MB"
        text = f"about {float(f'{self.states:.1g}'):,.0f} states, {memory}"
        return f"{text}; limits come before the tolerance" if self.limited else text


class _Visits(RunBatch):
    """Sampled runs, whose states have the probabilities of the histories that led to them."""

    def __init__(self, initial: States, runs: int) -> None:
        super().__init__(initial, np.zeros((2, runs), np.int64))
        self.probabilities: list[FloatArray] = []  # of the states of every step
        self.visited: list[FloatArray] = []  # fractions of the runs
        self.lowest = np.ones(runs)  # least probability on every run

    @override
    def begin(self, step: int) -> None:
        super().begin(step)
        rows, probabilities = self.row[self.running], self.table.weights
        self.probabilities.append(probabilities)
        self.visited.append(np.bincount(rows, minlength=len(probabilities)) / len(self.row))
        self.lowest[self.running] = np.minimum(self.lowest[self.running], probabilities[rows])

    @override
    def weights(self, parents: IntArray, alive: BoolArray, survival: FloatArray) -> FloatArray:
        outcomes = np.where(alive, survival[parents], 1.0 - survival[parents]).prod(axis=1)
        return np.asarray(self.table.weights[parents] * outcomes)

    def states(self, threshold: float) -> float:
        """Number of states that are at least as probable; extrapolated below 1 / (4 R)."""
        least = max(threshold, 0.25 / len(self.lowest))
        found, fewer = self._counted(least), self._counted(16.0 * least)
        if threshold >= least:
            return found
        exponent = np.clip(math.log(found / max(fewer, 1.0)) / math.log(16.0), 0.0, 1.0)
        return float(found * (least / threshold) ** exponent)

    def _counted(self, threshold: float) -> float:
        probabilities = np.concatenate(self.probabilities)
        rows = probabilities >= threshold
        return float((np.concatenate(self.visited)[rows] / probabilities[rows]).sum())

    def threshold(self, mass: float) -> float:
        """Probability below which this fraction of the runs falls."""
        lowest, number = np.sort(self.lowest), mass * len(self.lowest)
        if number >= _TAIL:
            return float(lowest[int(number)])
        low, high = lowest[_TAIL], lowest[10 * _TAIL]
        exponent = max(0.3, math.log10(high / low)) if high > low else 1.0
        return float(low * (number / _TAIL) ** exponent)


def predicted(expansion: StateSpaceExpansion, time_limit: float = math.inf) -> StatePrediction:
    """What an expansion that has not begun will need.

    No larger sample follows one that took more than `time_limit` seconds, but for the first, which
    may have compiled code.
    """
    scenario, policy, options = expansion.scenario, expansion.policy, expansion.options
    (initial,) = expansion.frontier.batches[0]
    chain = Chain(scenario, initial.previous_velocities[0], 0, Purpose.PREDICTION, options.lattice)
    for runs in RUNS:
        visits = _Visits(initial, runs)
        visits.finish(chain, policy)
        slow = runs > RUNS[0] and time.perf_counter() - visits.started > time_limit
        if slow or visits.solved > ENOUGH:
            break
    least = min(FIRST_THRESHOLD * options.tolerance, visits.threshold(_USED * options.tolerance))
    states = visits.states(max(least, 1e-300))
    number = min(states, float(options.max_states))
    stored = min(number, float(expansion.max_stored))
    limited = states > options.max_states or states > 4.0 * expansion.max_stored
    return StatePrediction(math.ceil(number), stored * expansion.bytes_per_state / 1e6, limited)
