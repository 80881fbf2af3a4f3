"""Values of weights on K cases, interpolated between those of a triangulated simplex, compiled."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..compiled.kernels import allocating_kernel, kernel
from ..typing import FloatArray, IntArray


class Simplex(NamedTuple):
    """Points v of the simplex of K cases with coordinates that are multiples of 1 / m.

    With tails y_i = m sum_{j >= i} v_j, i = 1, ..., K - 1, they are the whole points of the cone
    m >= y_1 >= ... >= y_(K-1) >= 0, and Freudenthal's triangulation of it is one of the simplex.
    """

    points: FloatArray  # (B, K)
    numbers: IntArray  # ((m+1)^(K-1),) index of the point with the tails y, in C order
    divisions: int  # m


@kernel
def interpolated(
    values: FloatArray, weights: FloatArray, simplex: Simplex, tails: FloatArray, order: IntArray
) -> float:
    """Value of weights (K,), homogeneous of degree one, from the values (B,) of the points.

    Linear on every simplex of the triangulation, so not below any convex function with these
    values. `tails` and `order` (K-1,) are overwritten.
    """
    count, m = weights.size - 1, simplex.divisions
    mass = 0.0
    for i in range(count, -1, -1):
        mass += weights[i]
        if i > 0:
            tails[i - 1] = mass
    if mass <= 0.0:
        return 0.0
    number = 0
    for i in range(count):
        tail = min(m * (tails[i] / mass), float(m))
        whole = int(tail)
        tails[i] = tail - whole
        number = number * (m + 1) + whole
        at = i  # by falling fractions, of equal ones the first index first: stays in the cone
        while at > 0 and tails[order[at - 1]] < tails[i]:
            order[at] = order[at - 1]
            at -= 1
        order[at] = i
    before, total = 1.0, 0.0
    for k in range(count + 1):
        fraction = tails[order[k]] if k < count else 0.0
        weight = before - fraction
        if weight > 0.0:
            total += weight * values[simplex.numbers[number]]
        if k < count:
            stride = 1
            for _ in range(count - 1 - order[k]):
                stride *= m + 1
            number += stride
        before = fraction
        if fraction == 0.0:
            break
    return mass * total


@allocating_kernel
def write_visits(
    lanes: tuple[int, int],
    to_go: FloatArray,
    stop: FloatArray,
    factors: FloatArray,
    prior: FloatArray,
    simplex: Simplex,
    out: FloatArray,
) -> None:
    """Write the values (P, B) of arriving at nodes with each point v of the simplex.

    The weights of the K cases are prior_k v_k. `to_go` (P, B) are the values after the visits,
    `stop` (P,) what is left of a weight where a path ends, and `factors` (P, K) what a visit leaves
    of each.
    """
    cases = prior.size
    left, tails = np.empty(cases), np.empty(cases - 1)
    order = np.empty(cases - 1, np.int64)
    for p in range(lanes[0], lanes[1]):
        for b in range(simplex.points.shape[0]):
            mass = 0.0
            for k in range(cases):
                left[k] = simplex.points[b, k] * factors[p, k]
                mass += prior[k] * left[k]
            best = mass * stop[p]
            if mass > 0.0:
                best = max(best, interpolated(to_go[p], left, simplex, tails, order))
            out[p, b] = best


@allocating_kernel
def write_values(
    to_go: FloatArray,
    stop: FloatArray,
    left: FloatArray,
    prior: FloatArray,
    simplex: Simplex,
    out: FloatArray,
) -> None:
    """Write the values (P,) after visits that leave v (P, K), as `write_visits`."""
    tails, order = np.empty(prior.size - 1), np.empty(prior.size - 1, np.int64)
    for p in range(out.size):
        mass = 0.0
        for k in range(prior.size):
            mass += prior[k] * left[p, k]
        best = mass * stop[p]
        if mass > 0.0:
            best = max(best, interpolated(to_go[p], left[p], simplex, tails, order))
        out[p] = best
