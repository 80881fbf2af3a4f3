"""Factors of condensed matrices of many instances: dense by LAPACK, or with one sparse pattern."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from heapq import heapify, heappop, heappush
from itertools import pairwise
from typing import Any, NamedTuple, Protocol

import numpy as np
from scipy.linalg import lapack

from ...typing import FloatArray, IntArray
from .iterate_kernels import LANES
from .system_kernels import factorise, solve

_SHIFTS = 40  # attempts to make a matrix positive definite
_AT_ONCE = 8  # attempts for an instance at the same time, at most


class Factors(Protocol):
    """Cholesky factors of b matrices, to each of whose diagonals a shift was added."""

    shifts: FloatArray
    """(b,), NaN where none was enough."""

    def solve(self, right: FloatArray) -> FloatArray:
        """Solutions (n, b) of the systems with these right-hand sides."""


class DenseFactors:
    """Factors of matrices (b, n, n), of which the lower triangles are read.

    `shifts` (b, m) are tried in order.
    """

    def __init__(self, matrices: FloatArray, shifts: FloatArray) -> None:
        diagonal = np.arange(matrices.shape[1])
        self._factors: list[FloatArray] = []
        self.shifts = np.full(len(matrices), np.nan)
        for row, (matrix, tried) in enumerate(zip(matrices, shifts, strict=True)):
            factor = matrix
            for shift in tried:
                shifted = matrix.copy()
                shifted[diagonal, diagonal] += shift
                factor, info = lapack.dpotrf(shifted.T, lower=0, overwrite_a=1)
                if info == 0:
                    self.shifts[row] = shift
                    break
            self._factors.append(factor)

    def solve(self, right: FloatArray) -> FloatArray:
        """See `Factors`."""
        solutions = np.empty_like(right)
        for row, factor in enumerate(self._factors):
            solutions[:, row] = lapack.dpotrs(factor, right[:, row], lower=0)[0]
        return solutions


def tries_at_once(lanes: int, count: int) -> int:
    """Number of attempts for each of some instances that fit in lanes which are free otherwise."""
    return min(max(1, lanes // max(1, count)), _AT_ONCE)


def shifts_to_try(last: FloatArray) -> FloatArray:
    """Shifts (b, m) of diagonals, none first, from the last ones (b,) that were needed."""
    known = last > 0.0
    first = np.where(known, np.maximum(1e-20, last / 3.0), 1e-4)
    factor = np.where(known, 8.0, 100.0)
    shifts = first[:, None] * factor[:, None] ** np.arange(_SHIFTS)
    return np.hstack([np.zeros((len(last), 1)), shifts])


FEW_UPDATES, MAX_UPDATES = 400_000, 100_000_000
"""Multiplications up to which sparse factors are always taken, and above which never."""

MAX_ENTRIES = 1_000_000
"""Entries of a factor, of which every instance needs 8 bytes."""

_MAX_PRODUCTS = 2_000_000  # of two entries of a row, whose places take 32 bytes
_DENSE = 40  # a dense factorisation of n variables takes the time of n^3 / 40 multiplications


def most_updates(size: int) -> int:
    """Multiplications of a factorisation of n variables above which dense ones are faster."""
    return min(max(FEW_UPDATES, size**3 // _DENSE), MAX_UPDATES)


@dataclass(frozen=True, eq=False)
class Pattern:
    """Entries of the factor L of a permuted matrix P M P' = L L', column by column.

    Parameters
    ----------
    order : (n,)
        Variable of every row.
    starts : (n + 1,)
        First entry of every column; it is the diagonal one.
    rows : (l,)
        Rows of the entries, which increase in every column.
    """

    order: IntArray
    starts: IntArray
    rows: IntArray

    def places(self, one: IntArray, two: IntArray) -> IntArray:
        """Places in L of the entries of M in rows `one` and columns `two`, in either order."""
        rank = np.argsort(self.order)
        low, high = np.minimum(rank[one], rank[two]), np.maximum(rank[one], rank[two])
        size = len(self.order)
        columns = np.repeat(np.arange(size), np.diff(self.starts))
        return np.searchsorted(columns * size + self.rows, low * size + high)


def eliminate(size: int, one: IntArray, two: IntArray) -> Pattern | None:
    """Pattern of the factors of matrices with entries at (one, two), and on the diagonal.

    Variables with few neighbours are eliminated first (minimum degree). None if there are more
    multiplications than `most_updates`, or more than `MAX_ENTRIES` entries.
    """
    neighbours: list[set[int]] = [set() for _ in range(size)]
    for i, j in zip(one.tolist(), two.tolist(), strict=True):
        if i != j:
            neighbours[i].add(j)
            neighbours[j].add(i)
    queue = [(len(near), i) for i, near in enumerate(neighbours)]
    heapify(queue)
    below: dict[int, list[int]] = {}  # of every column, in the order of elimination
    updates, entries, most = 0, size, most_updates(size)
    while queue:
        degree, pivot = heappop(queue)
        near = neighbours[pivot]
        if pivot in below or degree != len(near):
            continue  # an older degree
        updates, entries = updates + degree * (degree + 1) // 2, entries + degree
        if updates > most or entries > MAX_ENTRIES:
            return None
        for i in near:
            neighbours[i] |= near
            neighbours[i] -= {i, pivot}
            heappush(queue, (len(neighbours[i]), i))
        below[pivot] = list(near)
    order = np.array(list(below), np.int64)
    rank, found = np.argsort(order), enumerate(below.values())
    columns = [np.concatenate([[j], np.sort(rank[near])]) for j, near in found]
    rows = np.concatenate([np.empty(0), *columns]).astype(np.int64)
    return Pattern(order, np.cumsum([0, *map(len, columns)]), rows)


class SparseSystem(NamedTuple):
    """Positions of the entries of H + diag(w) + A' diag(v) A in its factor.

    `places` are those of the entries of H and of the diagonal, and (u, 4) for the products of two
    entries a, b of A in a row: a, b, the row, the place of the product.
    """

    pattern: Pattern
    places: tuple[IntArray, IntArray, IntArray]

    @classmethod
    def of(cls, size: int, hessian: IntArray, jacobian: IntArray) -> SparseSystem | None:
        """From rows and columns (2, k) of H, in either triangle, and of A.

        None if a dense matrix is better.
        """
        pairs = [np.empty((3, 0), np.int64)]
        order = np.argsort(jacobian[0], kind="stable")  # row by row
        bins = np.arange(jacobian[0].max(initial=-1) + 2)
        starts = np.searchsorted(jacobian[0, order], bins)
        lengths = np.diff(starts)
        most = min(most_updates(size), _MAX_PRODUCTS)
        if (lengths * (lengths + 1) // 2).sum() > most:
            return None
        for row, (start, end) in enumerate(pairwise(starts)):
            later, earlier = order[start + np.array(np.tril_indices(end - start))]
            pairs.append(np.stack([later, earlier, np.full(len(later), row)]))
        one, two, rows = np.concatenate(pairs, axis=1)
        columns = jacobian[1]
        left, right = np.hstack([hessian, np.stack([columns[one], columns[two]])])
        pattern = eliminate(size, left, right)
        if pattern is None:
            return None
        diagonal = np.arange(size)
        products = np.stack([one, two, rows, pattern.places(columns[one], columns[two])], axis=1)
        places = pattern.places(*hessian), pattern.places(diagonal, diagonal), products
        return cls(pattern, places)


class SparseFactors:
    """See `Factors`.

    Parameters
    ----------
    system : SparseSystem
    values : tuple of (k, b)
        Entries of H and of A, v and w.
    last : (b,)
        Shifts that were last needed.
    """

    def __init__(
        self, system: SparseSystem, values: tuple[FloatArray, ...], last: FloatArray
    ) -> None:
        self.system, batch, entries = system, len(last), len(system.pattern.rows)
        self._factors = np.zeros((-(-batch // LANES), entries, LANES))
        self.shifts = np.full(batch, np.nan)
        lanes: Any = tuple(np.zeros((len(part), LANES)) for part in values)
        work = lanes, np.empty((entries, LANES)), np.empty(LANES, bool)
        attempt = partial(self._try, tuple(map(np.ascontiguousarray, values)), work)
        left = attempt(np.arange(batch), np.zeros((batch, 1)))
        if left.size:
            attempt(left, shifts_to_try(last[left])[:, 1:])

    def _try(self, values: Any, work: Any, left: IntArray, shifts: FloatArray) -> IntArray:
        """Try shifts (r, m) of some matrices, several where lanes are free: those without a factor.

        The shifts of a matrix are tried from the largest, so that the factor of the least is kept.
        """
        pattern, places = self.system.pattern, self.system.places
        while left.size and shifts.shape[1]:
            tries = min(shifts.shape[1], tries_at_once(LANES, left.size))
            some, tried = left.repeat(tries), shifts[:, :tries][:, ::-1].ravel()
            done = np.empty(some.size, bool)
            results, lower = (self._factors, done), (pattern.starts, pattern.rows)
            factorise(values, tried, some, places, lower, work, results)
            self.shifts[some[done]] = tried[done]
            more = np.isnan(self.shifts[left])
            left, shifts = left[more], shifts[more, tries:]
        return left

    def solve(self, right: FloatArray) -> FloatArray:
        """See `Factors`."""
        pattern, solution = self.system.pattern, np.array(right)
        work = np.zeros((len(pattern.order), LANES))
        solve(pattern.starts, pattern.rows, pattern.order, self._factors, work, solution)
        return solution
