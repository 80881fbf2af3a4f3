"""Parts of the compiled batch solvers: outcomes, results, starts, and preconditioners.

**Preconditioner.** In a large swarm the curvatures of members differ by orders of magnitude: on a
circle of radius r with multiplier m there is m / r more, and the objective's grows with a member's
neighbours. With the blocks of all members as a preconditioner, conjugate gradients need few
iterations.

**Multistart.** A state is solved coarsely from its initial guess and from points around it. Where
the first starts agree they suffice. Where they do not, further ones follow until the least minimum
has been found `HITS` times: the number of starts grows with that of the local minima, as in the
stopping rules of Boender and Rinnooy Kan (Math. Program. 37, 1987), and most states need no more
than the first.
"""

from __future__ import annotations

import math
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from ..compiled.kernels import allocating_kernel, contiguous, kernel
from ..typing import FloatArray, IntArray

LARGE_SWARM = 16
"""Members from which on compiled solvers use the diagonal blocks of an objective's Hessian."""


MEMORY = 10  # objective values that the nonmonotone search looks back on
SUFFICIENT = 1e-4  # sufficient decrease, as a fraction of what the gradient predicts
SHORTEST, LONGEST = 1e-10, 1e10  # spectral step sizes, in units of x and f

CONVERGED, EXHAUSTED, STALLED, NOT_FINITE, NO_INTERIOR = range(5)


HITS = 8  # times that the least minimum is found where starts disagree
MAX_STARTS = 64  # where starts disagree
MAX_PAIRS = 1600  # pairs of members in all starts of a state: from 20 members on, the first suffice
AGREEMENT = 1e-3  # relative difference up to which two ends count as the same minimum


class Starts(NamedTuple):
    """Starts of B states of n members.

    A start is the initial guess and a displacement of every member, in axes and an order of the
    members that the guesses define. So it turns, mirrors and permutes with its state, and does not
    depend on the other states of a batch.
    """

    initial: int  # starts that are always solved; with 1 there are no others
    directions: FloatArray  # (S, 2n), displacements, a pair for every rank; none of the first start
    spread: FloatArray  # (B, n), lengths that the displacements of every member are multiplied by
    axes: FloatArray  # (B, 2, 2), first and second axis of every state, as rows
    ranks: IntArray  # (B, n), ranks of the members

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


class Results(NamedTuple):
    """Output arrays of a kernel for B instances."""

    x: FloatArray  # (B, ...)
    verified: FloatArray  # (B, 3), objective, violation and stationarity, from the problem alone
    outcome: IntArray  # (B,)
    counts: IntArray  # (B, 2), iterations and evaluations

    @classmethod
    def empty(cls, shape: tuple[int, ...]) -> Results:
        """Arrays to be written, for x of this shape."""
        batch = shape[0]
        outcome, counts = np.empty(batch, np.int64), np.zeros((batch, 2), np.int64)
        return cls(np.empty(shape), np.empty((batch, 3)), outcome, counts)


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
    """Count how often the least minimum has been found, after an end with this value."""
    margin = AGREEMENT * abs(least)
    if value < least - margin:
        return 1
    return hits + 1 if value <= least + margin else hits


@kernel
def needs_start(solved: int, hits: int, starts: Starts) -> bool:
    """Return True to solve another start coarsely after `solved`, `hits` of which ended lowest."""
    if starts.initial == 1 or solved < starts.initial:
        return starts.initial > 1
    return solved < len(starts.directions) and hits < min(solved, HITS)


LEAST = 0.05  # smallest curvature of the preconditioner, relative to the mean of all members


@kernel
def invert_blocks(blocks: FloatArray, face: FloatArray) -> None:
    """Replace blocks (3n,) of the Hessian by those of the preconditioner's inverse on the face.

    Curvatures count by their magnitude, so that the preconditioner is positive definite.
    """
    total, count = 0.0, 0
    for i in range(face.shape[0]):
        low, high, _, _ = curvatures(blocks, face, i)
        if face[i, 0] > 0.0:
            total += high if face[i, 0] == 1.0 else 0.5 * (low + high)
            count += 1
    least = LEAST * total / count if total > 0.0 else 1.0
    for i in range(face.shape[0]):
        low, high, tx, ty = curvatures(blocks, face, i)
        low = 1.0 / max(low, least) if face[i, 0] == 2.0 else 0.0
        high = 1.0 / max(high, least) if face[i, 0] > 0.0 else 0.0
        blocks[3 * i] = high * tx * tx + low * ty * ty
        blocks[3 * i + 1] = (high - low) * tx * ty
        blocks[3 * i + 2] = high * ty * ty + low * tx * tx


@kernel
def write_identity(face: FloatArray, inverse: FloatArray) -> None:
    """Write the blocks (3n,) of the projection on the face."""
    for i in range(face.shape[0]):
        tx, ty = face[i, 1], face[i, 2]  # both zero but on a single boundary
        free = 1.0 if face[i, 0] == 2.0 else 0.0
        inverse[3 * i], inverse[3 * i + 1], inverse[3 * i + 2] = (
            free + tx * tx,
            tx * ty,
            free + ty * ty,
        )


@kernel
def curvatures(blocks: FloatArray, face: FloatArray, i: int) -> tuple[float, float, float, float]:
    """Magnitudes of member i's curvatures across and along a unit vector, and that vector.

    On a boundary the vector is its tangent, elsewhere the principal direction of larger curvature.
    """
    a, b, c = blocks[3 * i], blocks[3 * i + 1], blocks[3 * i + 2]
    if face[i, 0] == 1.0:
        tx, ty = face[i, 1], face[i, 2]
        along = a * tx * tx + 2.0 * b * tx * ty + c * ty * ty + face[i, 3]
        return 0.0, abs(along), tx, ty
    mean, half = 0.5 * (a + c), 0.5 * (a - c)
    radius = math.sqrt(half * half + b * b)
    high = mean + radius if mean >= 0.0 else mean - radius
    low = mean - radius if mean >= 0.0 else mean + radius
    tx, ty = (b, high - a) if abs(high - a) > abs(high - c) else (high - c, b)
    length = math.sqrt(tx * tx + ty * ty)
    if length > 0.0:
        return abs(low), abs(high), tx / length, ty / length
    return abs(low), abs(high), 1.0, 0.0


@kernel
def precondition(vector: FloatArray, inverse: FloatArray, out: FloatArray) -> float:
    """Write the preconditioned vector; return its product with the vector."""
    total = 0.0
    for i in range(vector.size // 2):
        vx, vy = vector[2 * i], vector[2 * i + 1]
        px = inverse[3 * i] * vx + inverse[3 * i + 1] * vy
        py = inverse[3 * i + 1] * vx + inverse[3 * i + 2] * vy
        out[2 * i], out[2 * i + 1] = px, py
        total += vx * px + vy * py
    return total
