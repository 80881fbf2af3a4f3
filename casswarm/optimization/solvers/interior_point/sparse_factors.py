"""Factors of condensed matrices with one sparse pattern, for many instances at once."""

from __future__ import annotations

from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np

from ....typing import FloatArray, IntArray
from .elimination import MAX_UPDATES, Pattern, eliminate
from .factors import shifts_to_try
from .lane_kernels import LANES


class SparseSystem(NamedTuple):
    """Where the entries of H + diag(w) + A' diag(v) A are in its factor.

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
        if (lengths * (lengths + 1) // 2).sum() > MAX_UPDATES:
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
        from .system_kernels import factorise

        self.system, batch = system, len(last)
        pattern, entries = system.pattern, len(system.pattern.rows)
        self._factors = np.zeros((-(-batch // LANES), entries, LANES))
        self.shifts, left = np.full(batch, np.nan), np.arange(batch)
        read: Any = tuple(map(np.ascontiguousarray, values))
        lanes: Any = tuple(np.zeros((len(part), LANES)) for part in values)
        work = lanes, np.empty((entries, LANES)), np.empty(LANES, bool)
        done = np.zeros(batch, bool)
        results = self._factors, done
        lists = pattern.starts, pattern.update_starts, pattern.updates
        for shift in np.ascontiguousarray(shifts_to_try(last).T):
            factorise(read, shift, left, system.places, lists, work, results)
            self.shifts[left[done[left]]] = shift[left[done[left]]]
            left = left[~done[left]]
            if not left.size:
                break

    def solve(self, right: FloatArray) -> FloatArray:
        """See `Factors`."""
        from .system_kernels import solve

        pattern, solution = self.system.pattern, np.array(right)
        work = np.zeros((len(pattern.order), LANES))
        solve(pattern.starts, pattern.rows, pattern.order, self._factors, work, solution)
        return solution
