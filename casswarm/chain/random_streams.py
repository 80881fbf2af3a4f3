"""Random numbers determined by (seed, purpose, step, run, member), whatever the drawing order."""

from __future__ import annotations

from enum import IntEnum

import numpy as np

from ..typing import FloatArray

_WORDS = 4  # numbers a Philox counter yields
_STEP_BITS = 56  # of the word of the key that holds purpose and step


class Purpose(IntEnum):
    """What random numbers are for: every purpose has streams of its own."""

    RUNS = 0
    PILOT = 1
    STRATA = 2


def uniforms(
    seed: int, step: int, first: int, runs: int, members: int, purpose: Purpose = Purpose.RUNS
) -> FloatArray:
    """Uniform numbers in [0, 1) of a step, for the runs `first`, ..., `first` + `runs` - 1.

    A counter-based generator (Philox-4x64: Salmon, Moraes, Dror, Shaw, SC11, 2011) whose key is
    the seed in one word, and the purpose and the step in the other, with a fixed block of counters
    for every run. Different (seed, purpose, step) are different keys, so no two streams are the
    same. A number depends only on the seed, the purpose, the step, the run, the member and the
    number of members: it is the same under every policy (common random numbers), for every
    horizon, in every batch, on every worker.

    Parameters
    ----------
    seed : int
        From 0 to 2^64 - 1.
    step : int
        From 0 to 2^56 - 1.
    first, runs : int
    members : int
    purpose : Purpose

    Returns
    -------
    ndarray, shape (runs, members)
    """
    blocks = -(-members // _WORDS)
    key = np.array([seed, purpose << _STEP_BITS | step], np.uint64)
    generator = np.random.Generator(np.random.Philox(key=key, counter=first * blocks))
    return generator.random((runs, blocks * _WORDS))[:, :members]
