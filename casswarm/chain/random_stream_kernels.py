"""The numbers of `casswarm.chain.monte_carlo` one run at a time, for runs at different steps.

Philox-4x64-10 as in Salmon, Moraes, Dror, Shaw, "Parallel random numbers: as easy as 1, 2, 3",
SC11, 2011, section 3.3, with the counter and the conversion to doubles of NumPy's ``Philox``.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from ..compiled.kernels import kernel
from ..typing import FloatArray

_MULTIPLIERS = np.uint64(0xD2E7470EE14C6C93), np.uint64(0xCA5A826395121157)
_WEYL = np.uint64(0x9E3779B97F4A7C15), np.uint64(0xBB67AE8584CAA73B)
_LOW, _HALF, _DISCARDED = np.uint64(0xFFFFFFFF), np.uint64(32), np.uint64(11)
_ROUNDS = 10
_UNIT = 2.0**-53


@kernel
def high_product(a: Any, b: Any) -> Any:
    """The upper 64 bits of the product of two unsigned 64-bit integers."""
    a_low, a_high, b_low, b_high = a & _LOW, a >> _HALF, b & _LOW, b >> _HALF
    middle = a_high * b_low + (a_low * b_low >> _HALF)
    other = a_low * b_high + (middle & _LOW)
    return a_high * b_high + (middle >> _HALF) + (other >> _HALF)


@kernel
def write_uniforms(seed: Any, purpose_and_step: Any, run: Any, draws: FloatArray) -> None:
    """Write the uniform numbers (n,) of a run's members, equal to those of `uniforms`.

    All integers are unsigned; `purpose_and_step` is the second word of the generator's key.
    """
    blocks = np.uint64((draws.size + 3) // 4)
    for block in range(blocks):
        # the generator counts up before it draws
        c0, c1 = run * blocks + np.uint64(block) + np.uint64(1), np.uint64(0)
        c2, c3, k0, k1 = np.uint64(0), np.uint64(0), seed, purpose_and_step
        for _ in range(_ROUNDS):
            h0, h1 = high_product(_MULTIPLIERS[0], c0), high_product(_MULTIPLIERS[1], c2)
            low0, low1 = _MULTIPLIERS[0] * c0, _MULTIPLIERS[1] * c2
            c0, c1, c2, c3 = h1 ^ c1 ^ k0, low1, h0 ^ c3 ^ k1, low0
            k0, k1 = k0 + _WEYL[0], k1 + _WEYL[1]
        first = 4 * block
        for word in range(min(4, draws.size - first)):
            bits = c0
            if word == 1:
                bits = c1
            elif word == 2:
                bits = c2
            elif word == 3:
                bits = c3
            draws[first + word] = (bits >> _DISCARDED) * _UNIT
