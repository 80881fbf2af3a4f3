"""Multistart of the batch solvers: where the starts lie, and when there are enough.

A state is solved coarsely from its initial guess and from points around it. Where the first starts
agree they suffice. Where they do not, further ones follow until the least minimum has been found
`HITS` times: the number of starts grows with that of the local minima, as in the stopping rules of
Boender and Rinnooy Kan (Math. Program. 37, 1987), and most states need no more than the first.
"""

from __future__ import annotations

import math
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from ...._util.jit import allocating_kernel, contiguous, kernel
from ....typing import FloatArray, IntArray

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
        return empty_starts(1, start_displacements(1, 1), 1)

    @classmethod
    def around(
        cls, initial: int, spread: FloatArray, guesses: FloatArray, places: FloatArray
    ) -> Starts:
        """Starts around guesses (B, n, 2), for `spread` (B, n), 0 for members that are not free.

        `places` (B, n, 2) are where the members' sets lie; see `orient`.
        """
        batch, members = spread.shape
        starts = empty_starts(initial, start_displacements(initial, members), batch)
        starts.spread[:] = spread
        guesses, places = guesses.reshape(batch, -1), places.reshape(batch, -1).copy()
        orient_batch(contiguous(guesses), contiguous(places), starts)
        return starts


@allocating_kernel
def empty_starts(initial: int, directions: FloatArray, states: int) -> Starts:
    """Starts of so many states whose spread, axes and ranks are not yet written."""
    members = directions.shape[1] // 2
    return Starts(
        initial,
        directions,
        np.empty((states, members)),
        np.empty((states, 2, 2)),
        np.empty((states, members), np.int64),
    )


@kernel
def orient(guess: FloatArray, places: FloatArray, starts: Starts, row: int) -> None:
    """Write the axes and ranks of a state, from its guess and where its sets lie, both (2n,).

    The sums of guesses and places define the axes: the first is along their mean, the second
    perpendicular, on the side for which their covariance is positive. Members whose guess is 0, as
    that of the destroyed is, have no part in them. Free members are ranked along the first axis,
    before all others. `places` is overwritten.
    """
    members, counted, east, north = guess.size // 2, 0, 0.0, 0.0
    for i in range(members):
        if guess[2 * i] != 0.0 or guess[2 * i + 1] != 0.0:
            counted += 1
            places[2 * i] += guess[2 * i]
            places[2 * i + 1] += guess[2 * i + 1]
            east += places[2 * i]
            north += places[2 * i + 1]
        else:
            places[2 * i], places[2 * i + 1] = 0.0, 0.0
    if counted > 0:
        east, north = east / counted, north / counted
    length = math.sqrt(east * east + north * north)
    ux, uy = (east / length, north / length) if length > 0.0 else (1.0, 0.0)
    covariance = 0.0
    for i in range(members):
        dx, dy = places[2 * i] - east, places[2 * i + 1] - north
        along, across = dx * ux + dy * uy, dy * ux - dx * uy
        if guess[2 * i] != 0.0 or guess[2 * i + 1] != 0.0:
            covariance += along * across
        places[2 * i] = along if starts.spread[row, i] > 0.0 else math.inf
    for i in range(members):
        starts.ranks[row, i] = 0
        for j in range(members):
            a, b = places[2 * j], places[2 * i]
            starts.ranks[row, i] += a < b or (a == b and j < i)
    side = -1.0 if covariance < 0.0 else 1.0
    axes = starts.axes[row]
    axes[0, 0], axes[0, 1], axes[1, 0], axes[1, 1] = ux, uy, -side * uy, side * ux


@kernel
def orient_batch(guesses: FloatArray, places: FloatArray, starts: Starts) -> None:
    """`orient` for all states; `places` (B, 2n) are overwritten."""
    for row in range(guesses.shape[0]):
        orient(guesses[row], places[row], starts, row)


@lru_cache(maxsize=16)
def start_displacements(initial: int, members: int) -> FloatArray:
    """`Starts.directions`; none for a single start."""
    if initial == 1:
        return np.zeros((1, 2 * members))
    number = max(initial, min(MAX_STARTS, MAX_PAIRS // members**2))
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
