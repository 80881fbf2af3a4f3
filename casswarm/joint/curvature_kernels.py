"""Second derivatives of the steps of the joint plan's recursion over sets, compiled.

What a set d adds to the second derivative of its expectation E is a product of gradients of its
members' probabilities, and a form in the gradients of S_i, D_i and C_i. These are sums over *terms*
of i that are the same for all sets: S_i, and a density and a collision for every other member. So
the factors of terms and of pairs of terms are added up over the sets first. Term 0 of n members is
S_i, and those with member j are 1 + j and 1 + n + j.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..compiled.kernels import allocating_kernel, kernel
from ..hazard.rate_kernels import LANES
from ..typing import FloatArray, IntArray


class Curvature(NamedTuple):
    """Gradients of terms, and sums over all sets; m = 2n + 1 is the number of terms."""

    lower: FloatArray  # (2n, 2n, LANES), second derivatives; the lower triangle is used
    slopes: FloatArray  # (n, m, 2, LANES), gradients of terms of i in its position
    first: FloatArray  # (n, m, LANES), factors of the second derivatives of terms
    second: FloatArray  # (n, m, m, LANES), of products of their gradients; the lower triangle
    column: FloatArray  # (2n, LANES), overwritten


@allocating_kernel
def curvature(n: int) -> Curvature:
    """Arrays for n members."""
    terms = 2 * n + 1
    return Curvature(
        np.empty((2 * n, 2 * n, LANES)),
        np.zeros((n, terms, 2, LANES)),
        np.empty((n, terms, LANES)),
        np.empty((n, terms, terms, LANES)),
        np.empty((2 * n, LANES)),
    )


@kernel
def write_slopes(
    points: FloatArray, radars: FloatArray, pairs: FloatArray, slopes: FloatArray
) -> None:
    """Write the gradients of all terms."""
    n = len(points)
    for i in range(n):
        for a in range(2):
            for lane in range(LANES):
                slopes[i, 0, a, lane] = radars[i, a, lane]
            for j in range(n):
                for lane in range(LANES):
                    difference = 2.0 * (points[i, a, lane] - points[j, a, lane])
                    slopes[i, 1 + j, a, lane] = pairs[0, i, j, lane] * difference
                    slopes[i, 1 + n + j, a, lane] = pairs[2, i, j, lane] * difference


@kernel
def add_products(
    data: tuple[IntArray, FloatArray, FloatArray, FloatArray, FloatArray],
    rate: FloatArray,
    row: FloatArray,
    lower: FloatArray,
) -> None:
    """Add the products of gradients of probabilities, for a set.

    `data` are its members, probabilities, mass, and the first and second derivatives of E.
    """
    members, lost, mass, first, second = data
    for u in range(len(members)):
        q = lost[members[u]]
        for c in range(2 * len(members)):
            for lane in range(LANES):
                alive = 1.0 - q[lane]
                row[c, lane] = -first[u, lane] / alive * rate[u, c, lane] if alive > 0.0 else 0.0
            for v in range(len(members)):
                if v != u:
                    for lane in range(LANES):
                        row[c, lane] += second[u, v, lane] * rate[v, c, lane]
            for lane in range(LANES):
                row[c, lane] *= mass[lane]
        for r in range(2 * len(members)):
            place = 2 * members[r >> 1] + (r & 1)
            for c in range(r + 1):
                target = lower[place, 2 * members[c >> 1] + (c & 1)]
                for lane in range(LANES):
                    target[lane] += rate[u, r, lane] * row[c, lane]


@kernel
def add_curvature(
    data: tuple[IntArray, FloatArray, FloatArray, FloatArray, FloatArray],
    clock: FloatArray,
    rates: FloatArray,
    kinds: int,
    row: FloatArray,
    sums: Curvature,
) -> None:
    """Add the factors of second derivatives of terms, and of their gradients' products.

    `rates` (10, n, LANES) are those of the set, `row` (2, LANES) is overwritten. There are `kinds`
    of terms: 3, or 2 without collisions.
    """
    members, lost, mass, first, _ = data
    weight, factor, n, count = row[0], row[1], len(sums.first), len(members)
    for u in range(count):
        i = members[u]
        for lane in range(LANES):
            weight[lane] = mass[lane] * first[u, lane] * clock[lane] * (1.0 - lost[i, lane])
        for a in range(kinds):
            for b in range(a + 1):
                bend = rates[4 + b * (5 - b) // 2 + a, i]
                for lane in range(LANES):
                    factor[lane] = weight[lane] * bend[lane]
                for v in range(count if a else 1):
                    if a == 0 or v != u:
                        p = 1 + (a - 1) * n + members[v] if a else 0
                        if b == 0:
                            add(weight, rates[1 + a, i], sums.first[i, p])
                        for w in range(count if b else 1):
                            q = 1 + (b - 1) * n + members[w] if b else 0
                            if q <= p and (b == 0 or w != u):
                                target = sums.second[i, p, q]
                                for lane in range(LANES):
                                    target[lane] += factor[lane]


@kernel
def add(factor: FloatArray, values: FloatArray, target: FloatArray) -> None:
    """Add a product of lanes."""
    for lane in range(LANES):
        target[lane] += factor[lane] * values[lane]


@kernel
def subtract(factor: FloatArray, values: FloatArray, target: FloatArray) -> None:
    """Subtract a product of lanes."""
    for lane in range(LANES):
        target[lane] -= factor[lane] * values[lane]


@kernel
def add_second_derivatives(
    points: FloatArray, radars: FloatArray, pairs: FloatArray, kinds: int, sums: Curvature
) -> None:
    """Add all that the sums over sets are factors of."""
    n, lower = len(points), sums.lower
    for i in range(n):
        for a in range(2):
            for b in range(a + 1):
                add(sums.first[i, 0], radars[i, 2 + a + b], lower[2 * i + a, 2 * i + b])
        for j in range(n):
            if j != i:
                add_pair_curvature(i, j, points, pairs, sums)
        for p in range(1 + (kinds - 1) * n):
            j = (p - 1) % n
            if p == 0 or j != i:
                write_column(i, p, 1 + (kinds - 1) * n, sums)
                for a in range(2):
                    slope = sums.slopes[i, p, a]
                    for c in range(2 * i + a + 1):
                        add(slope, sums.column[c], lower[2 * i + a, c])
                    for c in range(2 * j + a + 1 if p else 0):
                        subtract(slope, sums.column[c], lower[2 * j + a, c])


@kernel
def write_column(i: int, p: int, terms: int, sums: Curvature) -> None:
    """Write the sum of the gradients of i's terms, in all positions, times factors with term p."""
    column, n = sums.column, len(sums.first)
    column[:] = 0.0
    for q in range(terms):
        j, factor = (q - 1) % n, sums.second[i, max(p, q), min(p, q)]
        if q == 0 or j != i:
            for a in range(2):
                add(factor, sums.slopes[i, q, a], column[2 * i + a])
                if q:
                    subtract(factor, sums.slopes[i, q, a], column[2 * j + a])


@kernel
def add_pair_curvature(
    i: int, j: int, points: FloatArray, pairs: FloatArray, sums: Curvature
) -> None:
    """Add the second derivatives of density and collision of a pair that i sees."""
    lower, n = sums.lower, len(points)
    for a in range(2):
        for b in range(2):
            for lane in range(LANES):
                density, collision = sums.first[i, 1 + j, lane], sums.first[i, 1 + n + j, lane]
                bend = density * pairs[1, i, j, lane] + collision * pairs[3, i, j, lane]
                entry = 4.0 * bend * (points[i, a, lane] - points[j, a, lane])
                entry *= points[i, b, lane] - points[j, b, lane]
                if a == b:
                    entry += 2.0 * density * pairs[0, i, j, lane]
                    entry += 2.0 * collision * pairs[2, i, j, lane]
                if a >= b:
                    lower[2 * i + a, 2 * i + b, lane] += entry
                    lower[2 * j + a, 2 * j + b, lane] += entry
                if i > j:
                    lower[2 * i + a, 2 * j + b, lane] -= entry
                else:
                    lower[2 * j + a, 2 * i + b, lane] -= entry
