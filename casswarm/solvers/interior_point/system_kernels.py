"""Compiled loops of the interior-point method: sparse products and Cholesky factors.

Arrays (k, b) hold numbers of b instances, and factors those of `LANES` at a time, (k, LANES), so
that inner loops do an operation for many instances.
"""

from __future__ import annotations

import math

from ...compiled.kernels import kernel
from ...typing import BoolArray, FloatArray, IntArray
from .iterate_kernels import LANES


@kernel
def times(
    entries: FloatArray, rows: IntArray, columns: IntArray, vectors: FloatArray, out: FloatArray
) -> None:
    """Write A v (m, b) of sparse matrices with entries (k, b) at (rows, columns)."""
    out[:] = 0.0
    for k in range(len(rows)):
        row, column = rows[k], columns[k]
        for i in range(vectors.shape[1]):
            out[row, i] += entries[k, i] * vectors[column, i]


@kernel
def adjacent(instances: IntArray) -> bool:
    """Whether instances are all from the first on, without a gap or a repetition."""
    same = True
    for lane in range(len(instances)):
        same = same and instances[lane] == instances[0] + lane
    return same


@kernel
def load(values: FloatArray, instances: IntArray, lanes: FloatArray) -> None:
    """Copy the values (k, b) of some instances, at most `LANES`, to lanes (k, LANES)."""
    first, number = instances[0], len(instances)
    if adjacent(instances):
        for k in range(len(values)):
            for lane in range(number):
                lanes[k, lane] = values[k, first + lane]
    else:
        for k in range(len(values)):
            for lane in range(number):
                lanes[k, lane] = values[k, instances[lane]]


@kernel
def assemble(
    lanes: tuple[FloatArray, FloatArray, FloatArray, FloatArray],
    places: tuple[IntArray, IntArray, IntArray],
    factor: FloatArray,
) -> None:
    """Write the entries of H + diag(w) + A' diag(v) A to those of the factor.

    `lanes` are the entries of H and A, v and w; `places` those of H, of the diagonal, and (u, 4)
    for the products of entries a, b of A in a row: the places of a, b, the row, and the result.
    """
    hessian, jacobian, rows, diagonal = lanes
    of_hessian, of_diagonal, products = places
    factor[:] = 0.0
    for k in range(len(of_hessian)):
        for lane in range(LANES):
            factor[of_hessian[k], lane] += hessian[k, lane]
    for k in range(len(of_diagonal)):
        for lane in range(LANES):
            factor[of_diagonal[k], lane] += diagonal[k, lane]
    for k in range(len(products)):
        one, two, row, target = products[k]
        for lane in range(LANES):
            factor[target, lane] += rows[row, lane] * jacobian[one, lane] * jacobian[two, lane]


@kernel
def cholesky(starts: IntArray, rows: IntArray, factor: FloatArray, positive: BoolArray) -> None:
    """Replace matrices by their factors; `positive` (LANES,) tells which have one.

    The rows below an entry of a column are among those of the entry's own column, in their order.
    """
    positive[:] = True
    for column in range(len(starts) - 1):
        diagonal = starts[column]
        for lane in range(LANES):
            if not factor[diagonal, lane] > 0.0:
                positive[lane] = False
            factor[diagonal, lane] = 1.0 / math.sqrt(factor[diagonal, lane])
        for k in range(diagonal + 1, starts[column + 1]):
            for lane in range(LANES):
                factor[k, lane] *= factor[diagonal, lane]
        for one in range(diagonal + 1, starts[column + 1]):
            target = starts[rows[one]]
            for two in range(one, starts[column + 1]):
                while rows[target] != rows[two]:
                    target += 1
                for lane in range(LANES):
                    factor[target, lane] -= factor[one, lane] * factor[two, lane]


@kernel
def substitute(starts: IntArray, rows: IntArray, factor: FloatArray, x: FloatArray) -> None:
    """Replace right-hand sides x (n, LANES), in the factor's order, by the solutions."""
    for column in range(len(starts) - 1):
        diagonal = starts[column]
        for lane in range(LANES):
            x[column, lane] *= factor[diagonal, lane]
        for k in range(diagonal + 1, starts[column + 1]):
            for lane in range(LANES):
                x[rows[k], lane] -= factor[k, lane] * x[column, lane]
    for column in range(len(starts) - 2, -1, -1):
        diagonal = starts[column]
        for k in range(diagonal + 1, starts[column + 1]):
            for lane in range(LANES):
                x[column, lane] -= factor[k, lane] * x[rows[k], lane]
        for lane in range(LANES):
            x[column, lane] *= factor[diagonal, lane]


@kernel
def factorise(
    values: tuple[FloatArray, FloatArray, FloatArray, FloatArray],
    shifts: FloatArray,
    instances: IntArray,
    places: tuple[IntArray, IntArray, IntArray],
    pattern: tuple[IntArray, IntArray],
    work: tuple[tuple[FloatArray, FloatArray, FloatArray, FloatArray], FloatArray, BoolArray],
    results: tuple[FloatArray, BoolArray],
) -> None:
    """Write the factors of r of the instances, to whose diagonals `shifts` (r,) are added.

    `values` (k, b) are those of `assemble`, of all instances. `results` are the factors
    (blocks, l, LANES) and which have one (r,); of an instance with several, the last one is kept.
    """
    (lanes, factor, positive), (factors, done) = work, results
    starts, rows_of = pattern
    for first in range(0, len(instances), LANES):
        some = instances[first : first + LANES]
        for values_of, lanes_of in zip(values, lanes):  # noqa: B905  (Numba has no strict)
            load(values_of, some, lanes_of)
        for k in range(len(lanes[3])):
            for lane in range(len(some)):
                lanes[3][k, lane] += shifts[first + lane]
        assemble(lanes, places, factor)
        cholesky(starts, rows_of, factor, positive)
        for lane in range(len(some)):
            done[first + lane] = positive[lane]
        store(factor, positive, some, factors)


@kernel
def store(
    factor: FloatArray, positive: BoolArray, instances: IntArray, factors: FloatArray
) -> None:
    """Copy the factors (l, LANES) of some instances to those of all."""
    block, place, number = instances[0] // LANES, instances[0] % LANES, len(instances)
    together = adjacent(instances) and place + number <= LANES
    for k in range(len(factor) if together else 0):
        for lane in range(number):
            factors[block, k, place + lane] = factor[k, lane]
    for lane in range(0 if together else number):
        block, place = instances[lane] // LANES, instances[lane] % LANES
        for k in range(len(factor) if positive[lane] else 0):
            factors[block, k, place] = factor[k, lane]


@kernel
def solve(
    starts: IntArray,
    rows: IntArray,
    order: IntArray,
    factors: FloatArray,
    x: FloatArray,
    right: FloatArray,
) -> None:
    """Replace b right-hand sides (n, b) by the solutions; x is (n, LANES)."""
    for block in range(len(factors)):
        first = block * LANES
        number = min(LANES, right.shape[1] - first)
        for k in range(len(order)):
            for lane in range(number):
                x[k, lane] = right[order[k], first + lane]
        substitute(starts, rows, factors[block], x)
        for k in range(len(order)):
            for lane in range(number):
                right[order[k], first + lane] = x[k, lane]
