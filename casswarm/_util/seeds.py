"""Seeds of random numbers."""

from __future__ import annotations

from numbers import Integral

MAX_SEED = 2**64 - 1
"""Largest seed: a word of the generator's key."""


def require_seed(seed: object) -> int:
    """`seed` as an int.

    Raises
    ------
    ValueError
        It is not a whole number from 0 to `MAX_SEED`.
    """
    if not isinstance(seed, Integral) or not 0 <= int(seed) <= MAX_SEED:
        raise ValueError(f"seed = {seed!r}; allowed: whole numbers from 0 to {MAX_SEED} (2^64 - 1)")
    return int(seed)
