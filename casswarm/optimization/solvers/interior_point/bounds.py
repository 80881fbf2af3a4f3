"""Bounds of the variables and slacks, and the logarithmic barrier."""

from __future__ import annotations

from dataclasses import dataclass, fields

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

    def joined(self, other: Bounds) -> Bounds:
        """These bounds, then those of another batch."""
        pairs = ((getattr(self, part.name), getattr(other, part.name)) for part in fields(self))
        return Bounds(*map(np.concatenate, pairs))

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
        gaps = np.empty((len(y), 2, y.shape[1]))
        np.subtract(y, self.lower, out=gaps[:, 0])
        np.subtract(self.upper, y, out=gaps[:, 1])
        return gaps

    def log_barrier(self, y: FloatArray) -> FloatArray:
        """Minus the sum of the logarithms of all gaps, (b,)."""
        from .bounds_kernels import log_barrier

        barrier = np.empty(len(y))
        log_barrier(y, self.lower, self.upper, barrier)
        return barrier

    def longest_step(self, y: FloatArray, step: FloatArray, keep: FloatArray) -> FloatArray:
        """Largest lengths (b,) up to 1 after which every gap keeps a fraction `keep` (b,)."""
        from .bounds_kernels import longest

        lengths, change = np.empty(len(y)), np.hstack([step, -step])
        longest(self.gaps(y).reshape(change.shape), change, keep, lengths)
        return lengths
