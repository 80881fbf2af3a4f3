"""Least interpolated values within a disc: a step of `disc_bound`, compiled."""

from __future__ import annotations

import numpy as np

from ..compiled.kernels import kernel
from ..typing import FloatArray, IntArray

_UNUSED = 1e300  # more than any change of values that count


@kernel
def least_in_disc(
    rows: tuple[int, int],
    values: FloatArray,
    nodes: IntArray,
    points: tuple[IntArray, IntArray, FloatArray],
    pieces: tuple[IntArray, FloatArray],
    scratch: FloatArray,
    out: FloatArray,
) -> None:
    """Write rows of the least interpolated value (a, b) of moves to a polygon around each node.

    Parameters
    ----------
    rows : pair of int
        First row of `out`, and the row after the last one.
    values : (a + 2 k, b + 2 k)
        Node values, infinite where there is no node; k is more than the largest move.
    nodes : (J, 2)
        Moves to nodes in the polygon, all plus k.
    points : (counts (P,), places (P, 4, 2), weights (P, 4))
        Points around the boundary, the first one also the last: their positive weights of nodes.
    pieces : (cells (P, 2), products (P,))
        For the piece of the boundary that ends at a point: its cell, and the product of its
        lengths along the axes. Interpolated values along it differ from a line by the product
        times the mixed difference of the cell, times s (1 - s).
    scratch : (a, 2, b)
        Memory.
    out : (a, b)
    """
    counts, places, weights = points
    cells, products = pieces
    columns = out.shape[1]
    for i in range(rows[0], rows[1]):
        least = out[i]
        for j in range(columns):
            least[j] = np.inf
        for k in range(len(nodes)):
            line, first = values[i + nodes[k, 0]], nodes[k, 1]
            for j in range(columns):
                least[j] = min(least[j], line[first + j])
        for k in range(len(counts)):
            now, before = scratch[i, k % 2], scratch[i, 1 - k % 2]
            for j in range(columns):
                now[j] = 0.0
            for n in range(counts[k]):
                line, first = values[i + places[k, n, 0]], places[k, n, 1]
                for j in range(columns):
                    now[j] += weights[k, n] * line[first + j]
            if k == 0:
                continue
            south, north = values[i + cells[k, 0]], values[i + cells[k, 0] + 1]
            first = cells[k, 1]
            for j in range(columns):
                mixed = (north[first + j + 1] - north[first + j]) - (
                    south[first + j + 1] - south[first + j]
                )
                # the least value of a parabola is at most a quarter of this below its ends
                excess = products[k] * mixed - abs(now[j] - before[j])
                below = 0.25 * excess if 0.0 < excess < _UNUSED else 0.0
                least[j] = min(least[j], min(now[j], before[j]) - below)
