"""Compiled loops of potentials and of the level game: sets of levels, the best joint moves.

A set of k levels, each from 0 to M - 1, is a sorted row; its rank is its position among all of them
in colexicographic order: lower levels have lower ranks.

Equations (S1) to (S4) are those of ``docs/success-bound.md``, which also lists the symbols.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..compiled.kernels import kernel
from ..typing import FloatArray, IntArray


@kernel
def limit_slope(values: FloatArray, straight: float, diagonal: float) -> None:
    """Lower node values (n, m) until neighbours differ by at most `straight` or `diagonal`.

    The result is the largest such function below the values, Lambda of equation (S1): with the
    slope L, `straight` is L h / kappa and `diagonal` sqrt(2) times as much. Two sweeps suffice but
    for rounding; they are repeated until nothing changes.
    """
    rows, columns = values.shape
    changed = True
    while changed:
        changed = False
        for sweep in range(2):
            step = 1 - 2 * sweep
            for row in range(rows):
                i = row if sweep == 0 else rows - 1 - row
                for column in range(columns):
                    j = column if sweep == 0 else columns - 1 - column
                    best = values[i, j]
                    if 0 <= j - step < columns:
                        best = min(best, values[i, j - step] + straight)
                    if 0 <= i - step < rows:
                        best = min(best, values[i - step, j] + straight)
                        if j > 0:
                            best = min(best, values[i - step, j - 1] + diagonal)
                        if j + 1 < columns:
                            best = min(best, values[i - step, j + 1] + diagonal)
                    if best < values[i, j]:
                        values[i, j] = best
                        changed = True


class Moves(NamedTuple):
    """Survival and interpolation terms of a step with k members alive before it.

    The density of the neighbours is in units of which S - 1 are all k - 1 of them at no distance.
    """

    survival: FloatArray  # (S, D + 1), P: of surviving a drop of d levels, by density
    steepness: FloatArray  # (S, D + 1), gamma_d (1 - r): of the correction for interpolation
    surplus: FloatArray  # (S,), largest ratio of the probabilities at neighbouring drops
    growth: float  # 1 / r, ratio of neighbours' values beyond which the correction is needed
    density: FloatArray  # (M + 2,), most that a neighbour adds, by the levels that it is behind


class Buffers(NamedTuple):
    """Working memory of `best_moves`: a joint move, by member, and its outcomes, by bit set."""

    drops: IntArray  # (k,), in the order of the levels before
    after: IntArray  # (k,), levels after the move, sorted; the following are in this order
    fallen: IntArray  # (k,), drops
    alive: FloatArray  # (k,), probability of survival
    least: FloatArray  # (k,), this and the next: bounds on its weight within the grid's cells
    most: FloatArray
    margin: FloatArray  # (k,), factor of the correction
    ranks: IntArray  # (2^k,), of every set of survivors, within all sets of as many levels
    values: FloatArray  # (2^k,), of these sets
    low: FloatArray  # (2^k,), this and the next: bounds on their probabilities
    high: FloatArray

    @classmethod
    def of(cls, k: int) -> Buffers:
        """Buffers for k members."""
        drops, after, fallen, ranks = (np.zeros(n, np.int64) for n in (k, k, k, 1 << k))
        alive, least, most, margin = (np.zeros(k) for _ in range(4))
        sets = [np.zeros(1 << k) for _ in range(3)]
        return cls(drops, after, fallen, alive, least, most, margin, ranks, *sets)


class Tables(NamedTuple):
    """Values of all sets of 0, ..., k levels, by their number and rank."""

    values: FloatArray
    offsets: IntArray  # (k + 1,), where those of each number begin
    binomials: IntArray  # (., k + 2)


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
    levels: IntArray, moves: Moves, corrected: bool, buffers: Buffers, tables: Tables
) -> None:
    """Values of all sets of k levels, from those of lower levels and of fewer members.

    G_k(a) is the largest of G_(k-1) without any one member and of (S4) for every move from the
    nodes a to b, a - b in {0, ..., D}^k but 0. Values of `levels` (count, k) are written, but for
    those with a member at level 0; to be corrected for interpolation, they are given without.
    """
    count, k = levels.shape
    deepest = moves.survival.shape[1] - 1
    drops, begin = buffers.drops, tables.offsets[k]
    for rank in range(count):
        if levels[rank, 0] == 0:
            continue
        best = float(tables.values[begin + rank])
        for i in range(k):  # more members are never worse
            best = max(best, _without(levels[rank], i, tables))
        drops[:] = 0
        while _next_drops(drops, levels[rank], deepest):
            best = max(best, _expected(levels[rank], moves, corrected, buffers, tables))
        tables.values[begin + rank] = best


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
def _without(row: IntArray, left_out: int, tables: Tables) -> float:
    """Value of a set without one of its levels."""
    rank, place = 0, 0
    for i in range(row.shape[0]):
        if i != left_out:
            rank += tables.binomials[row[i] + place, place + 1]
            place += 1
    return float(tables.values[tables.offsets[place] + rank])


@kernel
def _expected(
    row: IntArray, moves: Moves, corrected: bool, buffers: Buffers, tables: Tables
) -> float:
    """Expected value after a joint move, with corrections: equation (S4).

    The sum over the sets A of survivors of prod_A P_j prod_(not A) (1 - P_j) G(b_A), with P_j in
    `alive`, and the correction of every member that drops.
    """
    k, ranks, values, weights = row.shape[0], buffers.ranks, buffers.values, buffers.low
    binomials = tables.binomials
    _prepare(row, moves, buffers)
    ranks[0], weights[0] = 0, 1.0
    for i in range(k):  # sets whose last member is i
        for chosen in range(1 << i):
            place = _ones(chosen)
            ranks[chosen | 1 << i] = ranks[chosen] + binomials[buffers.after[i] + place, place + 1]
            weights[chosen | 1 << i] = weights[chosen] * buffers.alive[i]
            weights[chosen] *= 1.0 - buffers.alive[i]
    total = 0.0
    for chosen in range(1 << k):
        values[chosen] = tables.values[tables.offsets[_ones(chosen)] + ranks[chosen]]
        total += weights[chosen] * values[chosen]
    if corrected:
        after, fallen, correction = buffers.after, buffers.fallen, 0.0
        for i in range(k):
            if i == 0 or after[i] != after[i - 1] or fallen[i] != fallen[i - 1]:
                correction = 0.0  # else the same again
                if fallen[i] > 0:
                    correction = _correction(i, moves.growth, buffers, tables)
            total += correction
    return total


@kernel
def _correction(i: int, growth: float, buffers: Buffers, tables: Tables) -> float:
    """Correction for the interpolation in the level of a member that drops, as in (S4).

    K_i (sum over A without i of pi_A [G(b_(A+i)) - G(b_A) - (G(b_(A+i) + e_i) - G(b_A))^+ / r])^+,
    with 1 / r in `growth` and K_i in `margin`.
    """
    after, values, binomials = buffers.after, buffers.values, tables.binomials
    k = after.shape[0]
    last = i  # of the members at this level: sets in which it is one higher are sorted
    while last + 1 < k and after[last + 1] == after[i]:
        last += 1
    _weigh_others(i, buffers)
    level, total = after[i], 0.0
    for others in range(1 << k):
        if others >> i & 1:
            continue
        raised = others | 1 << last  # the same levels as with i, whose place is the last one's
        if others >> last & 1:
            raised |= 1 << i
        place = _ones(raised & ((1 << last) - 1))
        rank = buffers.ranks[raised] - binomials[level + place, place + 1]
        rank += binomials[level + 1 + place, place + 1]
        higher = tables.values[tables.offsets[_ones(raised)] + rank] - values[others]
        excess = values[others | 1 << i] - values[others] - growth * max(higher, 0.0)
        total += excess * (buffers.high[others] if excess > 0.0 else buffers.low[others])
    return float(buffers.margin[i]) * max(total, 0.0)


@kernel
def _weigh_others(i: int, buffers: Buffers) -> None:
    """Bounds on the probability pi_A, as in (S4), of every set A of survivors other than i."""
    low, high, least, most = buffers.low, buffers.high, buffers.least, buffers.most
    low[0], high[0] = 1.0, 1.0
    for j in range(least.shape[0]):
        for chosen in range(1 << j):
            more = chosen | 1 << j
            if j == i:
                low[more], high[more] = 0.0, 0.0
            else:
                low[more], high[more] = low[chosen] * least[j], high[chosen] * most[j]
                low[chosen] *= 1.0 - most[j]
                high[chosen] *= 1.0 - least[j]


@kernel
def _ones(bits: int) -> int:
    """Number of ones."""
    count = 0
    while bits:
        bits &= bits - 1
        count += 1
    return count


@kernel
def _prepare(row: IntArray, moves: Moves, buffers: Buffers) -> None:
    """Sorted levels after a joint move, and each member's probabilities.

    `alive` is P_q for the largest density S; `margin` is K_q = P_(q-1) gamma_q (1 - r) of (S2),
    with P for the largest S and gamma for the least one; `least` and `most` are the ends of the
    interval of a member's weight, which (S3) extends for drops from node 1 to 0.
    """
    k, after, fallen = row.shape[0], buffers.after, buffers.fallen
    largest = moves.survival.shape[0] - 1
    for i in range(k):
        level, j = row[i] - buffers.drops[i], i
        while j > 0 and after[j - 1] > level:
            after[j], fallen[j] = after[j - 1], fallen[j - 1]
            j -= 1
        after[j], fallen[j] = level, buffers.drops[i]
    for i in range(k):
        high, low = 0.0, 0.0
        for j in range(k):
            if j != i:
                behind = max(after[j] - after[i], 0)
                high += moves.density[max(behind - 2, 0)]
                low += moves.density[behind]
        many, few = min(int(np.ceil(high)), largest), int(low)
        alive, surplus = moves.survival[many, fallen[i]], moves.surplus[few]
        buffers.alive[i] = alive
        buffers.least[i] = moves.survival[few, fallen[i]] / surplus
        buffers.most[i] = min(alive * surplus, 1.0)
        buffers.margin[i] = 0.0
        if fallen[i] > 0:
            before = moves.survival[many, fallen[i] - 1]
            buffers.margin[i] = before * moves.steepness[few, fallen[i]]
            if fallen[i] == 1 and after[i] == 0:  # a true drop within the lowest cell
                buffers.least[i] = min(buffers.least[i], 1.0 - moves.steepness[few, 1])


@kernel
def make_decreasing(levels: IntArray, binomials: IntArray, values: FloatArray) -> None:
    """Raise values (count,) of sets (count, k) until none increases when a level rises.

    The least such function above G_k: docs/success-bound.md, Fewer members.
    """
    count, k = levels.shape
    top = levels[count - 1, 0]
    for rank in range(count - 1, -1, -1):
        for i in range(k):
            level = levels[rank, i]
            if level < top and (i + 1 == k or levels[rank, i + 1] > level):
                raised = rank + binomials[level + 1 + i, i + 1] - binomials[level + i, i + 1]
                values[rank] = max(values[rank], values[raised])
