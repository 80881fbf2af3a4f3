"""What members believe about a hazard that is not known, from who has survived so far.

The posterior of case k after a step is proportional to its weight before it times the probability
of exactly this set of survivors in case k. Members remember it in multiples of 1 / `UNITS`, at
least one: it is a finite memory, part of the state of the chain, whose law is exact for members
with this memory.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..typing import BoolArray, FloatArray, IntArray

UNITS = 256


def rounded(weights: FloatArray) -> IntArray:
    """Weights (R, K) of the cases, up to a factor, in units of the memory."""
    shares = weights / weights.sum(axis=1, keepdims=True)
    return np.asarray(np.maximum(1, np.rint(UNITS * shares).astype(np.int64)))


class Observation(NamedTuple):
    """What S states believe before a step, and what is then observed.

    Parameters
    ----------
    belief : (S, K) int
    alive : (S, n) bool
        Before the step.
    survival : (K, S, n)
        Probability of surviving the step in every case.
    """

    belief: IntArray
    alive: BoolArray
    survival: FloatArray

    def posterior(self, parents: IntArray, survived: BoolArray) -> IntArray:
        """Beliefs (R, K) after the step: of which state, and who survived it."""
        survival = self.survival[:, parents]
        outcome = np.where(survived, survival, 1.0 - survival)
        likelihood = np.where(self.alive[parents], outcome, 1.0).prod(axis=-1).T
        weights = self.belief[parents] * likelihood
        known = weights.sum(axis=1) > 0  # not an underflow of all
        return rounded(np.where(known[:, None], weights, self.belief[parents]))
