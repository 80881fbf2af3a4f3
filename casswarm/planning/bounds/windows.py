"""Least values over windows of a grid: the set within reach of a step is a box, so axis by axis."""

from __future__ import annotations

import numpy as np

from ...typing import FloatArray


def box_minimum(
    values: FloatArray, first: tuple[int, int], shape: tuple[int, int], k: int
) -> FloatArray:
    """Least value within k nodes along either axis, infinite where there is none.

    Parameters
    ----------
    values : (n, m)
        At the nodes (0, 0) to (n-1, m-1).
    first, shape : pairs of int
        Out of the nodes from `first` on, `shape` many; they may lie outside `values`.
    k : int

    Returns
    -------
    ndarray of shape `shape`
        Node p holds the least of the values at nodes q with |p - q| <= k in both axes.
    """
    rows = window_minimum(values, first[0], shape[0], k)
    return window_minimum(rows.T, first[1], shape[1], k).T


def window_minimum(values: FloatArray, first: int, count: int, k: int) -> FloatArray:
    """Least of ``values[p-k : p+k+1]`` along the first axis for p = first .. first + count - 1."""
    n = len(values)
    out = np.full((count, *values.shape[1:]), np.inf)
    begin, end = max(first, -k), min(first + count, n + k)  # where a window meets the values
    if begin >= end:
        return out
    low, high = begin - k, end - 1 + k  # of the first window, and of the last
    inside = out[begin - first : end - first]
    if n <= 2 * k + 1:  # every window holds an end of the values
        at = np.arange(begin, end)
        from_start = np.minimum.accumulate(values, axis=0)[np.minimum(at + k, n - 1)]
        to_end = np.minimum.accumulate(values[::-1], axis=0)[::-1][np.maximum(at - k, 0)]
        inside[:] = np.where((at - k <= 0)[:, None], from_start, to_end)
        return out
    padded = np.full((high - low + 1, *values.shape[1:]), np.inf)
    kept = slice(max(low, 0), min(high + 1, n))
    padded[kept.start - low : kept.stop - low] = values[kept]
    width, reached = 2 * k + 1, 1
    while 2 * reached <= width:  # windows of 2, 4, 8, ... and then two that overlap
        padded = np.minimum(padded[:-reached], padded[reached:])
        reached *= 2
    rest = width - reached
    np.minimum(padded[: end - begin], padded[rest : rest + end - begin], out=inside)
    return out
