"""Compiled steps of the dynamic program of two members, on nodes (i1, j1, i2, j2).

Equations (T1) to (T7) and their proof are in ``docs/two-members.md``.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from ..compiled.kernels import kernel
from ..typing import BoolArray, FloatArray

_ROUNDED_UP = 1 + 2.0**-48  # by more than the rounding of a node's value


class MemberNodes(NamedTuple):
    """Functions on the nodes (n, m) of one member."""

    risk: FloatArray  # beta: below a single agent's risk of a step that ends there, interpolated
    slopes: FloatArray  # (2, n, m), largest change of it along each axis in the cells around
    spread: FloatArray  # largest logarithm of a ratio of its values in one of these cells
    alone: FloatArray  # A: above the probability that a single agent there arrives
    floor: FloatArray  # A': another such bound; values of two living members are not below it


class PairNodes(NamedTuple):
    """Functions on the nodes (n, m) of the difference of both members' positions."""

    share: FloatArray  # c: below the factor by which the other reduces the risk, interpolated
    slopes: FloatArray  # as of `MemberNodes`
    spread: FloatArray
    collision: FloatArray  # kappa: below the risk of a collision, interpolated
    collision_low: FloatArray  # its least value in the cells around
    collision_range: FloatArray  # its largest difference there


@kernel
def _member(member: MemberNodes, i: int, j: int, pair: PairNodes, k: int, m: int):  # type: ignore[no-untyped-def]
    """Survival, an upper bound of the loss, and the risk of a member of a pair at a node.

    With beta in `risk`, c in `share`, kappa in `collision`, and Delta in `slopes`, equation (T5),

        delta = beta c - C + kappa,    C = 1/4 sum over axes of Delta beta Delta c,

    and the other risk is delta + C. Returned are exp(-delta); a number above the factor
    (1 - exp(-delta - C)) exp(theta^2 / 8) of (T4), as exp(-C) >= 1 - C; and delta. theta is the sum
    of the `spread` of beta and of c, and larger with collisions.
    """
    single = member.risk[i, j] * pair.share[k, m]
    covariance = 0.25 * (
        member.slopes[0, i, j] * pair.slopes[0, k, m]
        + member.slopes[1, i, j] * pair.slopes[1, k, m]
    )
    risk = single - covariance + pair.collision[k, m]
    survival = math.exp(-risk)
    loss = 1.0 - survival * (1.0 - covariance)
    spread = member.spread[i, j] + pair.spread[k, m]
    if pair.collision_range[k, m] > 0.0:
        least = single * math.exp(-spread) + pair.collision_low[k, m]
        spread = math.log(math.exp(spread) + pair.collision_range[k, m] / least)
    gap = 0.125 * spread * spread  # exp(gap) <= 1 + gap + gap^2 up to 1.7
    return survival, loss * (1.0 + gap + gap * gap if gap < 1.7 else math.exp(gap)), risk


@kernel
def step_back(
    first: MemberNodes,
    second: MemberNodes,
    pair: PairNodes,
    offset: tuple[int, int],
    values: FloatArray,
) -> None:
    """Replace the values of states of two living members by those before losses are drawn.

    Equation (T4): with p_i and l_i the survival and the loss of `_member`, A and A' in `alone` and
    `floor`,

        Q = p_1 p_2 max(G, A'(y_1), A'(y_2)) + p_1 l_2 A(y_1) + p_2 l_1 A(y_2).

    `values` (n1, m1, n2, m2) are G, upper bounds of the success probability from there on, and Q
    afterwards; `offset` is the index in `pair` of the difference of the members' first nodes.
    """
    n1, m1, n2, m2 = values.shape
    for i in range(n1):
        for j in range(m1):
            one, floor = first.alone[i, j], first.floor[i, j]
            for k in range(n2):
                for m in range(m2):
                    row, column = offset[0] + i - k, offset[1] + j - m
                    p1, l1, _ = _member(first, i, j, pair, row, column)
                    p2, l2, _ = _member(second, k, m, pair, row, column)
                    two = second.alone[k, m]
                    both = max(values[i, j, k, m], floor, second.floor[k, m])
                    values[i, j, k, m] = _ROUNDED_UP * (
                        p1 * p2 * both + p1 * l2 * one + p2 * l1 * two
                    )


@kernel
def step_forward(
    first: MemberNodes,
    second: MemberNodes,
    pair: PairNodes,
    offset: tuple[int, int],
    needed: FloatArray,
) -> None:
    """Replace least values that a step must reach by those that states after it must have.

    Equation (T7): with the symbols of `step_back`, T is replaced by
    (T - p_1 l_2 A(y_1) - p_2 l_1 A(y_2)) exp(delta_1 + delta_2), and by 0 where that is not
    positive, T < p_1 A(y_1) or T < p_2 A(y_2).

    `needed` (n1, m1, n2, m2) is -T, negative, and 0 afterwards where every value suffices.
    """
    n1, m1, n2, m2 = needed.shape
    for i in range(n1):
        for j in range(m1):
            one = first.alone[i, j]
            for k in range(n2):
                for m in range(m2):
                    least = -needed[i, j, k, m] / _ROUNDED_UP
                    if least == 0.0 or least == math.inf:
                        continue
                    row, column = offset[0] + i - k, offset[1] + j - m
                    p1, l1, d1 = _member(first, i, j, pair, row, column)
                    p2, l2, d2 = _member(second, k, m, pair, row, column)
                    two = second.alone[k, m]
                    rest = least - (p1 * l2 * one + p2 * l1 * two) * _ROUNDED_UP
                    if rest <= 0.0 or least < p1 * one or least < p2 * two:
                        needed[i, j, k, m] = 0.0
                    else:
                        needed[i, j, k, m] = -rest * math.exp(d1 + d2) / _ROUNDED_UP


@kernel
def discard(needed: FloatArray, values: FloatArray) -> None:
    """Set negative least values to -infinity at the nodes (count,) where they are not reached.

    Left are the nodes with T <= Q: no better policy is in a cell without one.
    """
    for node in range(len(needed)):
        if -needed[node] > values[node]:
            needed[node] = -np.inf


@kernel
def project(
    needed: FloatArray,
    ij: BoolArray,
    ik: BoolArray,
    im: BoolArray,
    jk: BoolArray,
    jm: BoolArray,
    km: BoolArray,
) -> None:
    """Mark the pairs of indices (i, j, k, m) of nodes that are above -infinity."""
    n1, m1, n2, m2 = needed.shape
    for i in range(n1):
        for j in range(m1):
            for k in range(n2):
                for m in range(m2):
                    if needed[i, j, k, m] > -np.inf:
                        ij[i, j] = ik[i, k] = im[i, m] = True
                        jk[j, k] = jm[j, m] = km[k, m] = True
