"""Compiled steps of the bound with limits of acceleration.

Equations (G2) to (G10) and their proof are in ``docs/global-guide.md``.

Step t of a path, t = 1 .. T, has a window of nodes: row t - 1 of `windows` holds the indices of its
first node and its number of nodes along each axis. Values at the nodes of all windows are in one
vector; those of a window begin at its entry of `offsets`, in C order.
"""

from __future__ import annotations

import numpy as np

from ..compiled.kernels import allocating_kernel, announce, kernel
from ..grid.extremum_kernels import LANES, running_extremum
from ..typing import FloatArray, IntArray


def compile_kernels() -> None:
    """Compile the kernels of this module, or load them: some seconds the first time."""
    announce(tilted_costs_to_go)
    windows, offsets, values = np.ones((1, 4), np.int64), np.array([0, 1]), np.zeros(1)
    tilted_costs_to_go(values, windows, offsets, np.zeros((1, 2)), values, 1, np.zeros(1))
    tilted_costs_to_come(values, windows, offsets, np.zeros((1, 2)), 1, np.zeros(1))
    best_path(values, windows, offsets, 1, np.zeros((1, 2), np.int64))
    least_step(np.ones((1, 1)), values, 1.0, 1.0)


@allocating_kernel
def _window_minimum(
    values: FloatArray, source: IntArray, window: IntArray, reach: int, out: FloatArray
) -> None:
    """Write the least of a source's values within reach of the nodes of a window: twice (G4)."""
    rows, columns = source[2], source[3]
    along = np.empty(rows * window[3])
    scratch = np.empty((2, max(rows, columns), LANES))
    first = window[1] - source[1]
    running_extremum(values, (rows, columns, 1), first, reach, False, along, scratch)
    first = window[0] - source[0]
    running_extremum(along, (1, rows, window[3]), first, reach, False, out, scratch)


@kernel
def _visit(values: FloatArray, costs: FloatArray, window: IntArray, tilt: FloatArray) -> None:
    """Add to the values of a window the costs of a visit, equation (G9).

    `costs` are those of lambda, and `tilt` . (i, j) is q(t) . (n - X(0)) at the node with indices
    i, j: h q(t) is in `tilt`.
    """
    for i in range(window[2]):
        east = tilt[0] * (window[0] + i)
        for j in range(window[3]):
            at = i * window[3] + j
            values[at] += costs[at] + (east + tilt[1] * (window[1] + j))


@allocating_kernel
def tilted_costs_to_go(
    costs: FloatArray,
    windows: IntArray,
    offsets: IntArray,
    tilts: FloatArray,
    terminal: FloatArray,
    reach: int,
    to_go: FloatArray,
) -> None:
    """Least cost of a visit to every node and of all that follows: W_t of (G2), with (G9).

    W_t(n) = lambda(n) + q(t) . (n - X(0)) + min over n' within reach of n of W_(t+1)(n'), and at
    the last step phi(n) instead of the minimum. lambda are the `costs` (M,), infinite where there
    is no node; h q(t) the `tilts` (T, 2), per node index along each axis; phi the values `terminal`
    (m,) at the nodes of the last window; and `to_go` (M,) the output.
    """
    last = len(windows) - 1
    for t in range(last, -1, -1):
        values = to_go[offsets[t] : offsets[t + 1]]
        if t == last:
            for i in range(len(values)):
                values[i] = terminal[i]
        else:
            following = to_go[offsets[t + 1] : offsets[t + 2]]
            _window_minimum(following, windows[t + 1], windows[t], reach, values)
        _visit(values, costs[offsets[t] : offsets[t + 1]], windows[t], tilts[t])


@allocating_kernel
def tilted_costs_to_come(
    costs: FloatArray,
    windows: IntArray,
    offsets: IntArray,
    tilts: FloatArray,
    reach: int,
    to_come: FloatArray,
) -> None:
    """Least cost of reaching every node from (0, 0), without its own: F_t of (G3), with (G9)."""
    start = np.ones(4, np.int64)
    start[0] = start[1] = 0
    previous = np.zeros(1)
    for t in range(len(windows)):
        values = to_come[offsets[t] : offsets[t + 1]]
        _window_minimum(previous, start if t == 0 else windows[t - 1], windows[t], reach, values)
        previous = np.empty(len(values))
        for i in range(len(values)):
            previous[i] = values[i]
        _visit(previous, costs[offsets[t] : offsets[t + 1]], windows[t], tilts[t])


@kernel
def best_path(
    to_go: FloatArray, windows: IntArray, offsets: IntArray, reach: int, path: IntArray
) -> float:
    """Least cost of a path from (0, 0), and the nodes (T, 2) of one that attains it.

    It is the minimum over paths on the nodes in theta, equation (G8).
    """
    east = north = 0
    least = np.inf
    for t in range(len(windows)):
        row, column, rows, columns = windows[t]
        cost, best_i, best_j = np.inf, 0, 0
        for i in range(max(0, east - reach - row), min(rows, east + reach - row + 1)):
            for j in range(
                max(0, north - reach - column), min(columns, north + reach - column + 1)
            ):
                value = to_go[offsets[t] + i * columns + j]
                if value < cost:
                    cost, best_i, best_j = value, i, j
        if t == 0:
            least = cost
        if cost == np.inf:
            return np.inf
        east, north = row + best_i, column + best_j
        path[t, 0], path[t, 1] = east, north
    return least


@allocating_kernel
def least_step(
    gram: FloatArray, needed: FloatArray, tolerance: float, largest: float
) -> tuple[bool, FloatArray]:
    """Weights w >= 0 for which the step sum of w_i g_i is the shortest d with g_i . d >= needed_i.

    Coordinate ascent on the dual program, equation (G10): r . w - 1/2 w . gram w at its largest,
    with r in `needed` (m,) and the products g_i . g_j in `gram` (m, m), up to violations of at most
    `tolerance`. The first result is False if there may be no step of a square up to `largest`.
    """
    count = len(needed)
    weights, slack = np.zeros(count), np.empty(count)
    for i in range(count):
        slack[i] = -needed[i]
    for _ in range(200):
        for i in range(count):
            if gram[i, i] > 0.0:
                change = max(-slack[i] / gram[i, i], -weights[i])
                if change != 0.0:
                    weights[i] += change
                    for j in range(count):
                        slack[j] += gram[i, j] * change
        missing = unneeded = length = 0.0
        for i in range(count):
            missing = max(missing, -slack[i])
            length += weights[i] * needed[i]
            if weights[i] > 0.0:
                unneeded = max(unneeded, slack[i])
        if max(missing, unneeded) <= tolerance or length > largest:
            break
    return missing <= tolerance, weights
