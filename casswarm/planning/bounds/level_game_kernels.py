"""Compiled loops of the level game: sets of levels, and the best joint move from each of them.

A set of k levels, each from 0 to M - 1, is a sorted row; its rank is its position among all of them
in colexicographic order: lower levels have lower ranks.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..._util.jit import kernel
from ...typing import FloatArray, IntArray


class Moves(NamedTuple):
    """What a step costs with k members alive before it.

    The density of the neighbours is in units of which S - 1 are all k - 1 of them at no distance.

    Parameters
    ----------
    survival : (S, D + 1)
        Probability of surviving a drop of d levels, by density.
    margin : (S, D + 1)
        Factor of the correction for interpolation.
    surplus : (S,)
        Factor by which interpolation can lower the weight of an outcome, at least 1.
    growth : float
        1 / r, the ratio of neighbouring levels' values beyond which the correction is needed.
    density : (M + 2,)
        Density that a neighbour adds at most, by the number of levels that it is behind.
    """

    survival: FloatArray
    margin: FloatArray
    surplus: FloatArray
    growth: float
    density: FloatArray


class Buffers(NamedTuple):
    """Working memory of `best_moves`.

    Parameters
    ----------
    drops, order : (k,)
    after : (k,)
        Levels after the move.
    alive, dead, alive_weight, dead_weight, margin : (k,)
        Probabilities of survival and loss, bounds on their weights in corrections, and the factor
        of the correction for each member.
    values : (2^k,)
        Values of all sets of survivors.
    """

    drops: IntArray
    after: IntArray
    alive: FloatArray
    alive_weight: FloatArray
    dead_weight: FloatArray
    margin: FloatArray
    values: FloatArray


@kernel
def fill_levels(levels: IntArray) -> None:
    """Write all sorted rows (count, k) by rank; the rank of 0, ..., 0 is 0."""
    count, k = levels.shape
    for rank in range(1, count):
        first = 0
        while first + 1 < k and levels[rank - 1, first] == levels[rank - 1, first + 1]:
            first += 1
        for i in range(first, k):
            levels[rank, i] = levels[rank - 1, i]
        levels[rank, first] += 1


@kernel
def best_moves(
    levels: IntArray,
    moves: Moves,
    binomials: IntArray,
    offsets: IntArray,
    corrected: bool,
    buffers: Buffers,
    tables: FloatArray,
) -> None:
    """Values of all sets of k levels, from those of lower levels and of fewer members.

    Parameters
    ----------
    levels : (count, k)
    moves : Moves
    binomials : (., k + 2)
    offsets : (k + 1,)
        Where the values of sets of 0, ..., k levels begin in `tables`.
    corrected : bool
        Whether to add the corrections for interpolation; `tables` then hold the values without.
    buffers : Buffers
    tables : (.,)
        Values of the sets of k levels are written.
    """
    count, k = levels.shape
    deepest = moves.survival.shape[1] - 1
    drops = buffers.drops
    for rank in range(count):
        if levels[rank, 0] == 0:
            tables[offsets[k] + rank] = 1.0
            continue
        best = tables[offsets[k] + rank]
        for i in range(k):  # more members are never worse
            best = max(best, _without(levels[rank], i, binomials, offsets, tables))
        drops[:] = 0
        while _next_drops(drops, levels[rank], deepest):
            best = max(
                best, _expected(levels[rank], moves, binomials, offsets, corrected, buffers, tables)
            )
        tables[offsets[k] + rank] = best


@kernel
def _next_drops(drops: IntArray, row: IntArray, deepest: int) -> bool:
    """The next joint move; of members at one level a later one does not drop by more."""
    i = 0
    while i < drops.shape[0]:
        limit = min(deepest, row[i])
        if drops[i] < limit:
            drops[i] += 1
            for j in range(i - 1, -1, -1):
                drops[j] = drops[j + 1] if row[j] == row[j + 1] else 0
            return True
        i += 1
    return False


@kernel
def _without(
    row: IntArray, left_out: int, binomials: IntArray, offsets: IntArray, tables: FloatArray
) -> float:
    """Value of a set without one of its levels."""
    rank, place = 0, 0
    for i in range(row.shape[0]):
        if i != left_out:
            rank += binomials[row[i] + place, place + 1]
            place += 1
    return tables[offsets[place] + rank]


@kernel
def _value(
    after: IntArray,
    chosen: int,
    binomials: IntArray,
    offsets: IntArray,
    tables: FloatArray,
) -> float:
    """Value of the members in a bit set `chosen`, whose levels are sorted."""
    rank, place = 0, 0
    for i in range(after.shape[0]):
        if chosen >> i & 1:
            rank += binomials[after[i] + place, place + 1]
            place += 1
    return tables[offsets[place] + rank]


@kernel
def _expected(
    row: IntArray,
    moves: Moves,
    binomials: IntArray,
    offsets: IntArray,
    corrected: bool,
    buffers: Buffers,
    tables: FloatArray,
) -> float:
    """Expected value after a joint move, with corrections."""
    k = row.shape[0]
    after, values = buffers.after, buffers.values
    _prepare(row, moves, buffers)
    for chosen in range(1 << k):
        values[chosen] = _value(after, chosen, binomials, offsets, tables)
    total = 0.0
    for chosen in range(1 << k):
        weight = 1.0
        for i in range(k):
            weight *= buffers.alive[i] if chosen >> i & 1 else 1.0 - buffers.alive[i]
        total += weight * values[chosen]
    if not corrected:
        return total
    for i in range(k):
        if buffers.margin[i] == 0.0:
            continue
        # the members may be unsorted now, by one equal level: `last` is the last of them
        last = i
        while last + 1 < k and after[last + 1] == after[i]:
            last += 1
        after[last] += 1
        for others in range(1 << k):
            if others >> i & 1:
                continue
            raised = (others & ~(1 << last)) | 1 << last
            if others >> last & 1 and last != i:  # that one takes the place of i
                raised |= 1 << i
            higher = _value(after, raised, binomials, offsets, tables)
            gain = values[others | 1 << i] - values[others]
            excess = gain - moves.growth * max(higher - values[others], 0.0)
            if excess > 0.0:
                weight = buffers.margin[i]
                for j in range(k):
                    if j != i:
                        alive = others >> j & 1
                        weight *= buffers.alive_weight[j] if alive else buffers.dead_weight[j]
                total += weight * excess
        after[last] -= 1
    return total


@kernel
def _prepare(row: IntArray, moves: Moves, buffers: Buffers) -> None:
    """Sorted levels after a joint move, and each member's probabilities."""
    k, after = row.shape[0], buffers.after
    largest = moves.survival.shape[0] - 1
    for i in range(k):  # sorted by insertion; `order` of drops follows
        level, drop = row[i] - buffers.drops[i], buffers.drops[i]
        j = i
        while j > 0 and after[j - 1] > level:
            after[j] = after[j - 1]
            buffers.margin[j] = buffers.margin[j - 1]
            j -= 1
        after[j] = level
        buffers.margin[j] = drop
    for i in range(k):
        high, low = 0.0, 0.0
        for j in range(k):
            if j != i:
                behind = max(after[j] - after[i], 0)
                high += moves.density[max(behind - 2, 0)]
                low += moves.density[behind]
        q, few = min(int(np.ceil(high - 1e-9)), largest), int(low)
        drop = int(buffers.margin[i])
        alive = moves.survival[q, drop]
        surplus = moves.surplus[few]
        buffers.alive[i] = alive
        buffers.alive_weight[i] = alive * surplus
        buffers.dead_weight[i] = (1.0 - moves.survival[few, drop]) * max(2.0, surplus)
        buffers.margin[i] = moves.margin[few, drop]
