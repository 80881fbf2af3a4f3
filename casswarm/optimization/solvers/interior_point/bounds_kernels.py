"""Compiled loops over the bounds of the interior-point method."""

from __future__ import annotations

import math

from ...._util.jit import kernel
from ....typing import FloatArray


@kernel
def log_barrier(y: FloatArray, lower: FloatArray, upper: FloatArray, out: FloatArray) -> None:
    """Write minus the sums of the logarithms of all finite gaps of y (b, k); NaN beyond bounds."""
    for i in range(len(y)):
        total = 0.0
        for k in range(y.shape[1]):
            if lower[i, k] > -math.inf:
                total -= logarithm(y[i, k] - lower[i, k])
            if upper[i, k] < math.inf:
                total -= logarithm(upper[i, k] - y[i, k])
        out[i] = total


@kernel
def logarithm(gap: float) -> float:
    """Logarithm; minus infinity of zero, NaN of negative numbers."""
    if gap > 0.0:
        return math.log(gap)
    return -math.inf if gap == 0.0 else math.nan


@kernel
def longest(positive: FloatArray, change: FloatArray, keep: FloatArray, out: FloatArray) -> None:
    """Write the lengths up to 1 of changes (b, m) that leave a fraction `keep` (b,) of numbers."""
    for i in range(len(positive)):
        out[i] = 1.0
        for k in range(positive.shape[1]):
            if change[i, k] < 0.0:
                out[i] = min(out[i], (keep[i] - 1.0) * positive[i, k] / change[i, k])
