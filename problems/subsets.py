"""The subsets of a swarm: who is alive, and the expectation over who survives a step.

A set of living members is a bit mask d = sum over the living of 2^i. Of the pairs (d, d') with d'
a subset of d there are 3^n: every member is outside d, in d and destroyed, or in d and alive. From
a function f of d', with members of d destroyed independently with probabilities q_i(d),

    E(d) = sum over d' of d of f(d') prod_{i in d'} (1 - q_i(d)) prod_{i in d - d'} q_i(d)

follows member by member: each contraction halves or keeps what belongs to a member, so that all E
together take about 2 * 3^n operations instead of the 4^n of a matrix.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np

from ..typing import BoolArray, FloatArray, IntArray


@dataclass(frozen=True)
class Subsets:
    """The 2^n subsets of n members, and the order in which their pairs are contracted.

    Pairs are first a row, the fate of member 0 slowest. Stage i takes the matrix (2^i, 3^(n-i)),
    whose rows are the masks of members 0..i-1 in d, splits its columns in three by the fate of
    member i, and gives (2^(i+1), 3^(n-i-1)).
    """

    n: int

    @cached_property
    def members(self) -> BoolArray:
        """Who is in each set, (2^n, n)."""
        return np.asarray((np.arange(2**self.n)[:, None] >> np.arange(self.n)) & 1, bool)

    @cached_property
    def survivors(self) -> IntArray:
        """The mask d' of every pair, (3^n,)."""
        fates = _fates(self.n)
        return np.asarray(sum((fate == 2) << i for i, fate in enumerate(fates)), np.int64)

    @cached_property
    def before(self) -> tuple[IntArray, ...]:
        """For every stage i, the masks d, (2^i, 3^(n-i-1)), whose q_i it takes."""
        found = []
        for i in range(self.n):
            later = _fates(self.n - i - 1)
            high = sum((fate > 0) << (i + 1 + k) for k, fate in enumerate(later))
            found.append(np.asarray(np.arange(2**i)[:, None] + (1 << i) + high, np.int64))
        return tuple(found)

    def expectations(self, values: FloatArray, lost: FloatArray) -> FloatArray:
        """E(d), (2^n,), of values f (2^n,) with probabilities of loss q (2^n, n).

        Sums of products of numbers that are not negative: as exact as they are, relatively.
        """
        pairs = values[self.survivors][None, :]
        for i, masks in enumerate(self.before):
            outside, dead, alive = np.hsplit(pairs, 3)
            q = lost[masks, i]
            pairs = np.vstack([outside, (1.0 - q) * alive + q * dead])
        return np.asarray(pairs[:, 0])

    def advanced(self, masses: FloatArray, lost: FloatArray) -> FloatArray:
        """Masses (2^n,) of the sets d' after a step, from those of the sets d before it."""
        pairs = masses[:, None]
        for i in reversed(range(self.n)):
            outside, inside = np.vsplit(pairs, 2)
            q = lost[self.before[i], i]
            pairs = np.hstack([outside, q * inside, (1.0 - q) * inside])
        found = np.bincount(self.survivors, weights=pairs[0], minlength=2**self.n)
        return np.asarray(found, float)


@lru_cache(maxsize=32)
def subsets(n: int) -> Subsets:
    """The subsets of n members; their tables are made once."""
    return Subsets(n)


def _fates(n: int) -> IntArray:
    """Fates (n, 3^n) of n members, that of the first slowest: 0 outside d, 1 dead, 2 alive."""
    return np.indices((3,) * n).reshape(n, -1) if n else np.zeros((0, 1), np.int64)
