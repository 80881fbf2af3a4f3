"""Bounds of the variables and slacks, and the logarithmic barrier."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ....typing import BoolArray, FloatArray, IntArray


@dataclass(frozen=True, eq=False)
class Bounds:
    """Bounds of b vectors y = (x, s), with k entries each.

    Parameters
    ----------
    lower, upper : (b, k)
        Infinite where there are none, and where the entry is fixed.
    fixed : (b, k) bool
        Whether both bounds are equal: the entry stays there.
    """

    lower: FloatArray
    upper: FloatArray
    fixed: BoolArray

    @classmethod
    def of(cls, lower: FloatArray, upper: FloatArray) -> Bounds:
        """Bounds from arrays in which those of a fixed entry are equal."""
        fixed = lower == upper
        return cls(np.where(fixed, -np.inf, lower), np.where(fixed, np.inf, upper), fixed)

    def __getitem__(self, rows: BoolArray | IntArray) -> Bounds:
        return Bounds(self.lower[rows], self.upper[rows], self.fixed[rows])

    def inside(self, y: FloatArray, push: float) -> FloatArray:
        """Points moved inside, by `push` relative to a bound, or to the width where it is less."""
        with np.errstate(invalid="ignore"):
            width = push * (self.upper - self.lower)
        below, above = (
            np.where(np.isinf(bound), 0.0, np.fmin(push * np.maximum(1.0, abs(bound)), width))
            for bound in (self.lower, self.upper)
        )
        return np.clip(y, self.lower + below, self.upper - above)

    def gaps(self, y: FloatArray) -> FloatArray:
        """Distances to both bounds, (b, 2, k); infinite where there is none."""
        return np.stack([y - self.lower, self.upper - y], axis=1)

    def log_barrier(self, y: FloatArray) -> FloatArray:
        """Minus the sum of the logarithms of all gaps, (b,)."""
        gaps = self.gaps(y)
        with np.errstate(divide="ignore"):  # a point on its bound has an infinite barrier
            logarithms = np.log(gaps, out=np.zeros_like(gaps), where=np.isfinite(gaps))
        return -np.asarray(logarithms.sum(axis=(1, 2)))

    def longest_step(self, y: FloatArray, step: FloatArray, keep: FloatArray) -> FloatArray:
        """Largest lengths (b,) up to 1 after which every gap keeps a fraction `keep` (b,)."""
        return longest(self.gaps(y), np.stack([step, -step], axis=1), keep)


def longest(positive: FloatArray, change: FloatArray, keep: FloatArray) -> FloatArray:
    """Largest lengths (b,) up to 1 of a change that leaves a fraction `keep` of all numbers."""
    allowed = (keep[:, None, None] - 1.0) * positive
    lengths = np.divide(allowed, change, out=np.full(change.shape, np.inf), where=change < 0.0)
    return np.asarray(np.minimum(1.0, lengths.min(axis=(1, 2), initial=np.inf)))
