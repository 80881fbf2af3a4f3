"""Random numbers determined by (seed, run, step, member), independent of the drawing order."""

from __future__ import annotations

import numpy as np

from ..typing import FloatArray

_WORDS = 4  # numbers a Philox counter yields


def uniforms(seed: int, step: int, first: int, runs: int, members: int) -> FloatArray:
    """Uniform numbers in [0, 1) of a step, for the runs `first`, ..., `first` + `runs` - 1.

    A counter-based generator (Philox-4x64: Salmon, Moraes, Dror, Shaw, SC11, 2011) keyed by the
    seed and the step, with a fixed block of counters for every run: a number depends only on
    the seed, the step, the run, the member and the number of members. The numbers are the same
    under every policy (common random numbers), for every horizon, in every batch, on every worker.

    Parameters
    ----------
    seed, step : int
        At least 0.
    first, runs : int
    members : int

    Returns
    -------
    ndarray, shape (runs, members)
    """
    blocks = -(-members // _WORDS)
    key = np.random.SeedSequence((seed, step)).generate_state(2, np.uint64)
    generator = np.random.Generator(np.random.Philox(key=key, counter=first * blocks))
    return generator.random((runs, blocks * _WORDS))[:, :members]
