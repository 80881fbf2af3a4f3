"""Rates of a batch of states by a compiled function, several states at once."""

from __future__ import annotations

import math
from typing import Any

from .._util.jit import kernel
from ..typing import BoolArray, FloatArray


@kernel
def write_rates(
    evaluate: Any,
    constants: FloatArray,
    alive: BoolArray,
    positions: FloatArray,
    rates: FloatArray,
    work: FloatArray,
) -> bool:
    """Write the rates (B, n) of all swarms by `compiled_rates`; False if one is no rate.

    `work` (6 n L,) is overwritten, for L states at once.
    """
    batch, n = alive.shape
    lanes, valid = work.size // (6 * n), True
    size = n * lanes
    x, living, values, scratch = (
        work[: 2 * size],
        work[2 * size : 3 * size],
        work[3 * size : 4 * size],
        work[4 * size :],
    )
    for first in range(0, batch, lanes):
        count = min(lanes, batch - first)
        for k in range(lanes):
            b = first + min(k, count - 1)  # the last block is filled
            for i in range(n):
                x[2 * i * lanes + k] = positions[b, i, 0]
                x[(2 * i + 1) * lanes + k] = positions[b, i, 1]
                living[i * lanes + k] = 1.0 if alive[b, i] else 0.0
        evaluate(x, living, constants, values, scratch)
        for k in range(count):
            for i in range(n):
                rate = values[i * lanes + k] if alive[first + k, i] else 0.0
                valid = valid and 0.0 <= rate < math.inf
                rates[first + k, i] = rate
    return valid
