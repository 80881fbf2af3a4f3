"""Sparse Cholesky factors of matrices with one pattern: what does not depend on the entries."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ....typing import IntArray

MAX_UPDATES = 400_000
"""Multiplications of a factorisation, or of an assembly, above which dense ones are faster."""


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
    update_starts : (n + 1,)
        First update after every column.
    updates : (u, 3)
        Places of entries t, a, b: t is reduced by a b.
    """

    order: IntArray
    starts: IntArray
    rows: IntArray
    update_starts: IntArray
    updates: IntArray

    def places(self, one: IntArray, two: IntArray) -> IntArray:
        """Places in L of the entries of M in rows `one` and columns `two`, in either order."""
        rank = np.argsort(self.order)
        low, high = np.minimum(rank[one], rank[two]), np.maximum(rank[one], rank[two])
        size = len(self.order)
        columns = np.repeat(np.arange(size), np.diff(self.starts))
        return np.searchsorted(columns * size + self.rows, low * size + high)


def eliminate(size: int, one: IntArray, two: IntArray) -> Pattern | None:
    """Pattern of the factors of matrices with entries at (one, two), and on the diagonal.

    Variables with few neighbours are eliminated first (minimum degree). None if there are more than
    `MAX_UPDATES`.
    """
    neighbours: list[set[int]] = [set() for _ in range(size)]
    for i, j in zip(one.tolist(), two.tolist(), strict=True):
        if i != j:
            neighbours[i].add(j)
            neighbours[j].add(i)
    left, order, below, number = set(range(size)), list[int](), list[list[int]](), 0
    while left:
        pivot = min(left, key=lambda i: (len(neighbours[i]), i))
        left.remove(pivot)
        near = neighbours[pivot]
        number += len(near) * (len(near) + 1) // 2
        if number > MAX_UPDATES:
            return None
        for i in near:
            neighbours[i] |= near
            neighbours[i] -= {i, pivot}
        order.append(pivot)
        below.append(sorted(near))
    return _numbered(np.array(order, np.int64), below)


def _numbered(order: IntArray, below: list[list[int]]) -> Pattern:
    """Pattern from the variables below the diagonal of every column."""
    size, rank = len(order), np.argsort(order)
    columns = [np.concatenate([[j], np.sort(rank[below[j]])]).astype(np.int64) for j in range(size)]
    starts = np.cumsum([0, *map(len, columns)])
    rows = np.concatenate(columns) if columns else np.empty(0, np.int64)
    keys = np.repeat(np.arange(size), np.diff(starts)) * size + rows
    updates, update_starts = [np.empty((0, 3), np.int64)], [0]
    for column, start in zip(columns, starts, strict=False):
        later, earlier = np.tril_indices(len(column) - 1)
        targets = np.searchsorted(keys, column[1:][earlier] * size + column[1:][later])
        updates.append(np.stack([targets, start + 1 + later, start + 1 + earlier], axis=1))
        update_starts.append(update_starts[-1] + len(later))
    return Pattern(order, starts, rows, np.array(update_starts), np.concatenate(updates))
