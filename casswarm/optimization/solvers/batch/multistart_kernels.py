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
from ....typing import BoolArray, FloatArray, IntArray

HITS = 8  # times that the least minimum is found where starts disagree
MAX_STARTS = 64  # where starts disagree
MAX_PAIRS = 1600  # pairs of members in all starts of a state: from 20 members on, the first suffice
AGREEMENT = 1e-3  # relative difference up to which two ends count as the same minimum


class Starts(NamedTuple):
    """Starts of B states of n members.

    A start is the initial guess and a displacement of every member, in axes and an order of the
    members that the guesses define. So it turns, mirrors and permutes with its state, and does not
    depend on the other states of a batch.

    Parameters
    ----------
    initial : int
        Starts that are always solved; with 1 there are no others.
    directions : (S, 2n)
        Displacements, a pair of coordinates for every rank; the first start has none.
    spread : (B, n)
        Lengths that the displacements of every member are multiplied by.
    axes : (B, 2, 2)
        First and second axis of every state, as rows.
    ranks : (B, n) int
        Ranks of the members.
    """

    initial: int
    directions: FloatArray
    spread: FloatArray
    axes: FloatArray
    ranks: IntArray

    @classmethod
    def single(cls) -> Starts:
        """The initial guesses alone."""
        none = np.zeros((1, 1))
        return cls(1, none, none, none[None], np.zeros((1, 1), np.int64))

    @classmethod
    def around(
        cls, initial: int, spread: FloatArray, guesses: FloatArray, places: FloatArray
    ) -> Starts:
        """Starts around guesses (B, n, 2), for `spread` (B, n), 0 for members that are not free.

        The sums of guesses and `places` (B, n, 2), of where the members' sets lie, define the axes.
        Members whose guess is 0, as that of the destroyed is, have no part in them.
        """
        members = spread.shape[1]
        limit = min(MAX_STARTS, MAX_PAIRS // members**2)
        moving = (guesses != 0.0).any(axis=-1)
        points = np.where(moving[..., None], guesses + places, 0.0)
        axes_and_ranks = _axes_and_ranks(points, moving, spread > 0.0)
        return cls(initial, _directions(max(initial, limit), members), spread, *axes_and_ranks)


def _axes_and_ranks(
    points: FloatArray, counted: BoolArray, free: BoolArray
) -> tuple[FloatArray, IntArray]:
    """Axes (B, 2, 2), the first along the mean of the points, and ranks (B, n) along it.

    The second axis is perpendicular, on the side for which the points' covariance is positive.
    """
    mean = points.sum(axis=1) / np.maximum(1, counted.sum(axis=1))[:, None]
    length = np.hypot(mean[:, 0], mean[:, 1])[:, None]
    first = np.where(length > 0.0, mean / np.where(length > 0.0, length, 1.0), [1.0, 0.0])
    second = np.stack([-first[:, 1], first[:, 0]], axis=1)
    offsets = points - mean[:, None]
    along = np.einsum("bnc,bc->bn", offsets, first)
    across = np.einsum("bnc,bc->bn", offsets, second)
    second[(along * across * counted).sum(axis=1) < 0.0] *= -1.0
    order = np.where(free, along, np.inf).argsort(axis=1, kind="stable")
    return np.stack([first, second], axis=1), order.argsort(axis=1, kind="stable")


@lru_cache(maxsize=16)
def _directions(number: int, members: int) -> FloatArray:
    directions = np.zeros((number, 2 * members))
    directions[1:] = np.random.default_rng(1).normal(size=(number - 1, 2 * members))
    return directions


@kernel
def write_start(index: int, guess: FloatArray, starts: Starts, row: int, start: FloatArray) -> None:
    """Write a start of a state from its guess, both (2n,)."""
    axes = starts.axes[row]
    for i in range(start.size // 2):
        spread, rank = starts.spread[row, i], starts.ranks[row, i]
        along = spread * starts.directions[index, 2 * rank]
        across = spread * starts.directions[index, 2 * rank + 1]
        for c in range(2):
            start[2 * i + c] = guess[2 * i + c] + along * axes[0, c] + across * axes[1, c]


@kernel
def count_hits(value: float, least: float, hits: int) -> int:
    """How often the least minimum has been found, after an end with this value."""
    margin = AGREEMENT * abs(least)
    if value < least - margin:
        return 1
    return hits + 1 if value <= least + margin else hits


@kernel
def needs_start(solved: int, hits: int, starts: Starts) -> bool:
    """Whether to solve another start coarsely, after `solved`, `hits` of which ended lowest."""
    if starts.initial == 1 or solved < starts.initial:
        return starts.initial > 1
    return solved < len(starts.directions) and hits < min(solved, HITS)
