"""Proofs that linear rows and bounds contradict each other, in exact arithmetic (Farkas' lemma).

For linear rows a_i' x in [l_i, u_i], multipliers y prove that there is no feasible point if the
least value of sum y_i a_i' x over the bounds of the variables is above the greatest value that
sum y_i [l_i, u_i] can have. All numbers are the doubles of the program, as rationals.
"""

from __future__ import annotations

from collections.abc import Sequence
from fractions import Fraction
from math import isfinite

from ..typing import FloatArray

_Row = list[Fraction]


def is_contradiction(matrix: FloatArray, lower: FloatArray, upper: FloatArray) -> bool:
    """Whether it is proven that no x has lower <= matrix x <= upper.

    For an irreducible set the multipliers are unique up to a factor: they are found by eliminating
    the columns.

    Parameters
    ----------
    matrix : (k, n)
    lower, upper : (k,)
        Infinite where there is no bound.
    """
    null = _null_vector([list(map(Fraction, row)) for row in matrix.tolist()])
    if null is None:
        return False
    sides = [(lower[i], upper[i]) if y > 0 else (upper[i], lower[i]) for i, y in enumerate(null)]
    return any(
        all(isfinite(side[which]) for side, y in zip(sides, null, strict=True) if y)
        and sign
        * sum(
            (y * Fraction(float(side[which])) for side, y in zip(sides, null, strict=True) if y),
            Fraction(0),
        )
        > 0
        for which, sign in ((0, 1), (1, -1))
    )  # 0 = sum y_i a_i' x is at least the first sum, and at most the second


def _null_vector(rows: Sequence[_Row]) -> _Row | None:
    """The vector y with y' rows = 0 if there is one up to a factor, exactly; else None."""
    size = len(rows)
    left = [[*row, *(Fraction(i == j) for j in range(size))] for i, row in enumerate(rows)]
    for column in range(len(rows[0])):
        pivot = next((row for row in left if row[column]), None)
        if pivot is None:
            continue
        left.remove(pivot)
        for row in left:
            if factor := row[column] / pivot[column]:
                row[:] = [a - factor * b for a, b in zip(row, pivot, strict=True)]
    return left[0][len(rows[0]) :] if len(left) == 1 else None
