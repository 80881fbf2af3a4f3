"""Bounds of the variables and slacks, and the logarithmic barrier."""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np

from ....typing import BoolArray, FloatArray, IntArray
from ...problem import Instances

INFINITE = 1e19
"""Size from which a bound is none."""

_EQUAL, _NEAR = 1e-9, 1e-12  # width of bounds that count as equal, absolute and relative


def are_equal(lower: FloatArray, upper: FloatArray) -> BoolArray:
    """Whether bounds are equal up to an error that is allowed."""
    finite = np.isfinite(lower) & np.isfinite(upper)
    width = np.subtract(upper, lower, out=np.full_like(lower, np.inf), where=finite)
    return np.asarray(width <= np.maximum(_EQUAL, _NEAR * abs(lower)), bool) & finite


def middle(lower: FloatArray, upper: FloatArray, where: BoolArray) -> FloatArray:
    """Midpoints of some intervals, and zeros elsewhere."""
    width = np.subtract(upper, lower, out=np.zeros_like(lower), where=where)
    return np.add(lower, 0.5 * width, out=np.zeros_like(lower), where=where)


def wrong_bounds(instances: Instances) -> dict[int, str]:
    """What is wrong with the bounds of an instance, by its row: no number is between them."""
    wrong: dict[int, str] = {}
    for low, high in (("lbx", "ubx"), ("lbg", "ubg")):
        lower, upper = getattr(instances, low), getattr(instances, high)
        crossed = ~(lower <= upper) | (lower == np.inf) | (upper == -np.inf)
        for row, k in zip(*np.nonzero(crossed), strict=True):
            text = f"nothing is between {low}[{k}] = {lower[row, k]:g} and {high}[{k}] = "
            wrong.setdefault(int(row), f"{text}{upper[row, k]:g}")
    return wrong


@dataclass(frozen=True, eq=False)
class Bounds:
    """Bounds of b vectors y = (x, s), with k entries each.

    Parameters
    ----------
    lower, upper : (k, b)
        Infinite where there are none, and where the entry is fixed.
    fixed : (k, b) bool
        Whether both bounds are equal, or nearly so: the entry stays between them.
    """

    lower: FloatArray
    upper: FloatArray
    fixed: BoolArray

    @classmethod
    def of(cls, lower: FloatArray, upper: FloatArray) -> Bounds:
        """Bounds from arrays in which those of a fixed entry are nearly equal.

        Those of 1e19 and more are infinite, as for Ipopt.
        """
        lower = np.where(lower <= -INFINITE, -np.inf, lower)
        upper = np.where(upper >= INFINITE, np.inf, upper)
        fixed = are_equal(lower, upper)
        return cls(np.where(fixed, -np.inf, lower), np.where(fixed, np.inf, upper), fixed)

    def take(self, places: IntArray, axis: int = -1) -> Bounds:
        """Bounds of some vectors, like `numpy.ndarray.take`."""
        return Bounds(*(getattr(self, part.name).take(places, axis) for part in fields(self)))

    def part(self, entries: slice) -> Bounds:
        """Bounds of some of the entries of all vectors."""
        return Bounds(self.lower[entries], self.upper[entries], self.fixed[entries])

    def joined(self, other: Bounds) -> Bounds:
        """These bounds, then those of another batch."""
        pairs = ((getattr(self, part.name), getattr(other, part.name)) for part in fields(self))
        return Bounds(*map(np.hstack, pairs))

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
        """Distances to both bounds, (2, k, b); infinite where there is none."""
        return np.stack([y - self.lower, self.upper - y])

    def log_barrier(self, y: FloatArray) -> FloatArray:
        """Minus the sum of the logarithms of all gaps, (b,); NaN at and beyond the bounds."""
        from .search_kernels import log_barrier

        barrier = np.empty(y.shape[1])
        log_barrier(y, self.lower, self.upper, np.empty((2, y.shape[1])), barrier)
        return barrier

    def longest_step(self, y: FloatArray, step: FloatArray, keep: FloatArray) -> FloatArray:
        """Largest lengths (b,) up to 1 after which every gap keeps a fraction `keep` (b,)."""
        from .search_kernels import longest_steps

        length = np.empty(len(keep))
        longest_steps((y, step), (self.lower, self.upper), keep, length)
        return length
