"""Multistart of the batch solvers: where the starts lie, and when there are enough.

A state is solved coarsely from its initial guess and from points around it. Where the first starts
agree they suffice. Where they do not, further ones follow until the least minimum has been found
`HITS` times: the number of starts grows with that of the local minima, as in the stopping rules of
Boender and Rinnooy Kan (Math. Program. 37, 1987), and most states need no more than the first.
"""

from __future__ import annotations

from functools import lru_cache
from typing import NamedTuple

import numpy as np

from ...._util.jit import kernel
from ....typing import FloatArray

HITS = 8  # times that the least minimum is found where starts disagree
MAX_STARTS = 64  # where starts disagree
MAX_PAIRS = 1600  # pairs of members in all starts of a state: from 20 members on, the first suffice
AGREEMENT = 1e-3  # relative difference up to which two ends count as the same minimum


class Starts(NamedTuple):
    """Starts of B states of n members.

    Parameters
    ----------
    initial : int
        Starts that are always solved; with 1 there are no others.
    directions : (S, 2n)
        Displacements of the starts from the initial guess; the first is 0. They are the same for
        all states, so that a state's answer does not depend on its batch.
    spread : (B, n)
        Lengths that the directions of every member are multiplied by.
    """

    initial: int
    directions: FloatArray
    spread: FloatArray

    @classmethod
    def around(cls, initial: int, spread: FloatArray) -> Starts:
        """Starts with normal directions, for `spread` (B, n)."""
        members = spread.shape[1]
        limit = 1 if initial == 1 else min(MAX_STARTS, MAX_PAIRS // members**2)
        return cls(initial, _directions(max(initial, limit), members), spread)


@lru_cache(maxsize=16)
def _directions(number: int, members: int) -> FloatArray:
    directions = np.zeros((number, 2 * members))
    directions[1:] = np.random.default_rng(1).normal(size=(number - 1, 2 * members))
    return directions


@kernel
def write_start(index: int, guess: FloatArray, starts: Starts, row: int, start: FloatArray) -> None:
    """Write a start of a state from its guess, both (2n,)."""
    for c in range(start.size):
        start[c] = guess[c] + starts.spread[row, c // 2] * starts.directions[index, c]


@kernel
def count_hits(value: float, least: float, hits: int) -> int:
    """How often the least minimum has been found, after an end with this value."""
    margin = AGREEMENT * abs(least)
    if value < least - margin:
        return 1
    return hits + 1 if value <= least + margin else hits


@kernel
def needs_start(solved: int, hits: int, starts: Starts) -> bool:
    """Whether to solve another start, after `solved` of which `hits` found the least minimum."""
    if solved < starts.initial:
        return True
    return solved < len(starts.directions) and hits < min(solved, HITS)
