"""Second derivatives of the steps of the joint plan's recursion over sets, compiled.

What a set d adds to the second derivative of its expectation E is a product of gradients of its
members' probabilities, and a form in the gradients of S_i, D_i and C_i. Gradients of sums over
other members are sums over pairs, the same for all sets: so the factors of pairs of pairs are added
up over the sets first.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..compiled.kernels import allocating_kernel, kernel
from ..hazard.array_rates import LANES
from ..typing import FloatArray, IntArray


class Slopes(NamedTuple):
    """Gradients (n, n, 2, LANES) of the density and collision of pairs in the first's position."""

    density: FloatArray
    collision: FloatArray


class Curvature(NamedTuple):
    """Sums over all sets."""

    lower: FloatArray  # (2n, 2n, LANES), second derivatives; the lower triangle is used
    first: FloatArray  # (3, n, n, LANES), factors of those of S_i ([i, i]), and of pairs' terms
    source: FloatArray  # (3, n, n, LANES), of products of the gradient of S_i, also with pairs'
    pairs: FloatArray  # (3, n, n, n, LANES), of products of the gradients of pairs (i, j), (i, k)


@allocating_kernel
def curvature(n: int) -> Curvature:
    """Arrays for n members."""
    return Curvature(
        np.empty((2 * n, 2 * n, LANES)),
        np.empty((3, n, n, LANES)),
        np.empty((3, n, n, LANES)),
        np.empty((3, n, n, n, LANES)),
    )


@kernel
def pair_slopes(points: FloatArray, pairs: FloatArray, slopes: Slopes) -> None:
    """Write the gradients of density and collision of all pairs of different members."""
    n = len(points)
    for i in range(n):
        for j in range(n):
            if j != i:
                for a in range(2):
                    for lane in range(LANES):
                        difference = 2.0 * (points[i, a, lane] - points[j, a, lane])
                        slopes.density[i, j, a, lane] = pairs[0, i, j, lane] * difference
                        slopes.collision[i, j, a, lane] = pairs[2, i, j, lane] * difference


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
    collides: bool,
    row: FloatArray,
    sums: Curvature,
) -> None:
    """Add the factors of second derivatives of S, D and C, and of their gradients' products.

    `rates` (10, n, LANES) are those of the set, `row` (2, LANES) is overwritten.
    """
    members, lost, mass, first, _ = data
    weight, factor = row[0], row[1]
    for u in range(len(members)):
        i = members[u]
        for lane in range(LANES):
            weight[lane] = mass[lane] * first[u, lane] * clock[lane] * (1.0 - lost[i, lane])
        add(weight, rates[1, i], sums.first[0, i, i])
        add(weight, rates[4, i], sums.source[0, i, i])
        for v in range(len(members)):
            j = members[v]
            if v != u:
                for k in range(1, 3 if collides else 2):
                    add(weight, rates[1 + k, i], sums.first[k, i, j])
                    add(weight, rates[4 + k, i], sums.source[k, i, j])
        for kind in range(3 if collides else 1):
            for lane in range(LANES):
                factor[lane] = weight[lane] * rates[7 + kind, i, lane]
            for v in range(len(members)):
                for w in range(len(members) if kind == 1 else v + 1):
                    if v != u and w != u:
                        target = sums.pairs[kind, i, members[v], members[w]]
                        for lane in range(LANES):
                            target[lane] += factor[lane]


@kernel
def add(factor: FloatArray, values: FloatArray, target: FloatArray) -> None:
    """Add a product of lanes."""
    for lane in range(LANES):
        target[lane] += factor[lane] * values[lane]


@kernel
def add_outer(
    places: tuple[int, int, float],
    factor: FloatArray,
    left: FloatArray,
    right: FloatArray,
    lower: FloatArray,
) -> None:
    """Add the block of two members, and a sign times factor left right', to the lower triangle."""
    i, j, sign = places
    for a in range(2):
        for b in range(2):
            if 2 * i + a >= 2 * j + b:
                target = lower[2 * i + a, 2 * j + b]
                for lane in range(LANES):
                    target[lane] += sign * factor[lane] * left[a, lane] * right[b, lane]


@kernel
def add_pair_product(
    members: tuple[int, int, int],
    factor: FloatArray,
    left: FloatArray,
    right: FloatArray,
    lower: FloatArray,
) -> None:
    """Add factor (e_i - e_j) left ((e_i - e_k) right)'."""
    i, j, k = members
    add_outer((i, i, 1.0), factor, left, right, lower)
    add_outer((i, k, -1.0), factor, left, right, lower)
    add_outer((j, i, -1.0), factor, left, right, lower)
    add_outer((j, k, 1.0), factor, left, right, lower)


@kernel
def add_source_product(
    i: int, j: int, factor: FloatArray, source: FloatArray, slope: FloatArray, lower: FloatArray
) -> None:
    """Add factor (e_i source ((e_i - e_j) slope)') and its transpose."""
    add_outer((i, i, 1.0), factor, source, slope, lower)
    add_outer((i, i, 1.0), factor, slope, source, lower)
    add_outer((i, j, -1.0), factor, source, slope, lower)
    add_outer((j, i, -1.0), factor, slope, source, lower)


@kernel
def add_second_derivatives(
    points: FloatArray,
    radars: FloatArray,
    pairs: FloatArray,
    slopes: Slopes,
    collides: bool,
    sums: Curvature,
) -> None:
    """Add all that the sums over sets are factors of."""
    n, lower = len(points), sums.lower
    for i in range(n):
        for a in range(2):
            for b in range(a + 1):
                add(sums.first[0, i, i], radars[i, 2 + a + b], lower[2 * i + a, 2 * i + b])
        add_outer((i, i, 1.0), sums.source[0, i, i], radars[i], radars[i], lower)
        for j in range(n):
            if j != i:
                add_source_product(
                    i, j, sums.source[1, i, j], radars[i], slopes.density[i, j], lower
                )
                add_pair_curvature(i, j, points, pairs, sums)
                if collides:
                    add_source_product(
                        i, j, sums.source[2, i, j], radars[i], slopes.collision[i, j], lower
                    )
                for k in range(n):
                    if k != i:
                        add_pair_products((i, j, k), slopes, collides, sums)


@kernel
def add_pair_products(
    members: tuple[int, int, int], slopes: Slopes, collides: bool, sums: Curvature
) -> None:
    """Add the products of the gradients of pairs (i, j) and (i, k), in this order."""
    i, j, k = members
    high, low = max(j, k), min(j, k)
    density, collision, lower = slopes.density[i], slopes.collision[i], sums.lower
    add_pair_product(members, sums.pairs[0, i, high, low], density[j], density[k], lower)
    if collides:
        add_pair_product(members, sums.pairs[2, i, high, low], collision[j], collision[k], lower)
        add_pair_product(members, sums.pairs[1, i, j, k], density[j], collision[k], lower)
        add_pair_product(members, sums.pairs[1, i, k, j], collision[j], density[k], lower)


@kernel
def add_pair_curvature(
    i: int, j: int, points: FloatArray, pairs: FloatArray, sums: Curvature
) -> None:
    """Add the second derivatives of density and collision of a pair that i sees."""
    lower = sums.lower
    for a in range(2):
        for b in range(2):
            for lane in range(LANES):
                density, collision = sums.first[1, i, j, lane], sums.first[2, i, j, lane]
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
