"""The running extremum along an axis: a step of dynamic programming on a grid, compiled."""

from __future__ import annotations

import numpy as np

from ..compiled.kernels import kernel
from ..typing import FloatArray

LANES = 64
"""Lines at once: columns of the scratch memory."""


@kernel
def _extremum(one: float, other: float, largest: bool) -> float:
    if largest:
        return max(one, other)
    return min(one, other)


@kernel
def running_extremum(
    values: FloatArray,
    shape: tuple[int, int, int],
    first: int,
    reach: int,
    largest: bool,
    out: FloatArray,
    scratch: FloatArray,
) -> None:
    """Write to `out` (a, m, b) the least or `largest` values of an array (a, n, b), in C order.

    m(p) = min of v(q) over |q - p| <= k, equation (G4) of ``docs/global-guide.md``, with k in
    `reach`, for p = `first`, `first` + 1, ...; or the maximum, as in (T3) of
    ``docs/two-members.md``. It is infinite where there is no such q.

    By the algorithm of van Herk, and of Gil and Werman, a window of 2 k + 1 values is the end of
    one block of as many and the begin of the next: the time does not depend on k. `scratch`
    (2, n, LANES) holds extrema from the begin and to the end of blocks.
    """
    outer, n, inner = shape
    if outer * n * inner == 0:
        out[:] = -np.inf if largest else np.inf
        return
    before, after = scratch[0], scratch[1]
    length, count = 2 * reach + 1, len(out) // (outer * inner)
    # lines of a group are side by side; those along the last axis are one group
    lines, groups = (outer, 1) if inner == 1 else (inner, outer)
    apart, apart_out = (n, count) if inner == 1 else (1, 1)
    for group in range(groups):
        for begin in range(0, lines, LANES):
            lanes = min(LANES, lines - begin)
            start = group * n * inner + begin * apart
            for p in range(n):
                for lane in range(lanes):
                    before[p, lane] = after[p, lane] = values[start + p * inner + lane * apart]
            for p in range(n):
                if p % length > 0:
                    for lane in range(lanes):
                        before[p, lane] = _extremum(before[p - 1, lane], before[p, lane], largest)
            for p in range(n - 2, -1, -1):
                if p % length < length - 1:
                    for lane in range(lanes):
                        after[p, lane] = _extremum(after[p + 1, lane], after[p, lane], largest)
            start = group * count * inner + begin * apart_out
            for q in range(count):
                low, high = max(0, first + q - reach), min(n - 1, first + q + reach)
                at = start + q * inner
                if low > high:
                    for lane in range(lanes):
                        out[at + lane * apart_out] = -np.inf if largest else np.inf
                    continue
                left, right = after[low], before[high]
                if low // length == high // length:  # the window is a part of one block
                    left, right = (right, right) if low % length == 0 else (left, left)
                for lane in range(lanes):
                    out[at + lane * apart_out] = _extremum(left[lane], right[lane], largest)
