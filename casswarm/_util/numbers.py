"""Small numbers that rooms share: tolerances, seeds, rounding for display."""

from __future__ import annotations

import math
from numbers import Integral

from .text import shown

SPEED_TOL = 1e-12
"""Excess over v_max or a_max, relative to v_max, up to which the chain does not project a velocity;
the bounds on all policies allow for it."""

CORE_RADIUS = 0.01
"""Default distance below which rates are regularised, of hazards that are made in Python."""

CORE_FRACTION = 1 / 50
"""The same of a scenario, as a fraction of the target's radius."""

MAX_SEED = 2**64 - 1
"""Largest seed: a word of the generator's key."""


def require_seed(seed: object) -> int:
    """`seed` as an int; of a generator of NumPy, the next 64 bits.

    Raises
    ------
    ValueError
        It is not a whole number from 0 to `MAX_SEED`.
    """
    draw = getattr(seed, "integers", None)
    if draw is not None:
        seed = int(draw(0, MAX_SEED, dtype="uint64", endpoint=True))
    if not isinstance(seed, Integral) or not 0 <= int(seed) <= MAX_SEED:
        raise ValueError(
            f"seed = {shown(seed)}; allowed: whole numbers from 0 to {MAX_SEED} (2^64 - 1)"
        )
    return int(seed)


def rounded_up(value: float, digits: int = 4) -> float:
    """Round an upper bound upward for display."""
    scale: float = 10.0**digits
    return math.ceil(value * scale) / scale
