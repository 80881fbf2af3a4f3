"""Random numbers that belong to (seed, run, step, member), in whatever order they are drawn."""

from __future__ import annotations

import numpy as np

from ..arrays import Floats

_WORDS = 4  # numbers a Philox counter yields


def uniforms(seed: int, first: int, runs: int, steps: int, members: int) -> Floats:
    """Uniform numbers in [0, 1) of the runs `first`, ..., `first` + `runs` - 1.

    A counter-based generator (Philox-4x64: Salmon, Moraes, Dror, Shaw, SC11, 2011) keyed by the
    seed, with a fixed block of counters for every run: a run's numbers depend on nothing but the
    seed, its index and the numbers of steps and members. They are the same under every policy
    (common random numbers), in every batch, and on every worker.

    Parameters
    ----------
    seed : int
        Any integer >= 0.
    first, runs : int
    steps, members : int

    Returns
    -------
    ndarray, shape (runs, steps, members)
    """
    blocks = -(-steps * members // _WORDS)
    key = np.random.SeedSequence(seed).generate_state(2, np.uint64)
    generator = np.random.Generator(np.random.Philox(key=key, counter=first * blocks))
    numbers = generator.random((runs, blocks * _WORDS))
    return numbers[:, : steps * members].reshape(runs, steps, members)
