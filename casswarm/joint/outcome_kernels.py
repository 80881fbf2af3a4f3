"""Expectations over the outcomes of steps, with derivatives in members' probabilities, compiled.

As in `joint_kernels`, but for `LANES` steps at a time, which are the last axis of all arrays.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..compiled.kernels import allocating_kernel, kernel
from ..typing import FloatArray, IntArray
from .curvature_kernels import LANES


class Work(NamedTuple):
    """What is computed of one set with k members.

    Parameters
    ----------
    members, subsets : (n,), (m,) int
        Its members, and the masks of its 2^k subsets.
    values, cube : (m, LANES)
        A function of its subsets, and a copy that is overwritten.
    first, second : (n, LANES), (n, n, LANES)
        Derivatives of its expectation in its members' probabilities.
    rate : (n, 2n, LANES)
        Gradients of these probabilities in the positions of its members.
    row : (2n + 1, LANES)
    gradient, by_outcome : (2n, LANES), (m, 2n, LANES)
        Sums over all sets.
    """

    members: IntArray
    subsets: IntArray
    values: FloatArray
    cube: FloatArray
    first: FloatArray
    second: FloatArray
    rate: FloatArray
    row: FloatArray
    gradient: FloatArray
    by_outcome: FloatArray


@allocating_kernel
def workspace(n: int) -> Work:
    """Arrays for sets of n members."""
    sets = 1 << n
    return Work(
        np.empty(n, np.int64),
        np.empty(sets, np.int64),
        np.empty((sets, LANES)),
        np.empty((sets, LANES)),
        np.empty((n, LANES)),
        np.zeros((n, n, LANES)),
        np.empty((n, 2 * n, LANES)),
        np.empty((2 * n + 1, LANES)),
        np.empty((2 * n, LANES)),
        np.empty((sets, 2 * n, LANES)),
    )


@kernel
def list_set(d: int, n: int, work: Work) -> int:
    """Write members and subsets of the set d; return its number of members."""
    count = 0
    work.subsets[0] = 0
    for i in range(n):
        if d >> i & 1:
            for m in range(1 << count):
                work.subsets[m + (1 << count)] = work.subsets[m] | 1 << i
            work.members[count] = i
            count += 1
    return count


@kernel
def copy(values: FloatArray, target: FloatArray) -> None:
    """Copy lanes."""
    for lane in range(LANES):
        target[lane] = values[lane]


@kernel
def expectation(count: int, i: int, j: int, lost: FloatArray, work: Work, out: FloatArray) -> None:
    """Derivative of the expectation of `values` in those of members i and j; -1 for none."""
    cube, half = work.cube, 1 << count
    for m in range(half):
        copy(work.values[m], cube[m])
    for s in range(count - 1, -1, -1):
        half >>= 1
        q = lost[work.members[s]]
        for m in range(half):
            dead, alive = cube[m], cube[m + half]
            if s in (i, j):
                for lane in range(LANES):
                    dead[lane] -= alive[lane]
            else:
                for lane in range(LANES):
                    dead[lane] = alive[lane] + q[lane] * (dead[lane] - alive[lane])
    copy(cube[0], out)


@kernel
def write_outcomes(count: int, skipped: int, lost: FloatArray, work: Work) -> None:
    """Multiply the probabilities of all subsets to values[0]; derivatives in that of `skipped`."""
    values = work.values
    for s in range(count):
        half, q = 1 << s, lost[work.members[s]]
        for m in range(half):
            dead, alive = values[m], values[m + half]
            if s == skipped:
                for lane in range(LANES):
                    alive[lane] = -dead[lane]
            else:
                for lane in range(LANES):
                    alive[lane] = dead[lane] * (1.0 - q[lane])
                    dead[lane] *= q[lane]


@kernel
def differentiate_expectation(count: int, lost: FloatArray, after: FloatArray, work: Work) -> None:
    """Write first and second derivatives of the expectation of `after`."""
    for m in range(1 << count):
        copy(after[work.subsets[m]], work.values[m])
    for u in range(count):
        expectation(count, u, -1, lost, work, work.first[u])
        for v in range(u):
            expectation(count, u, v, lost, work, work.second[u, v])
            copy(work.second[u, v], work.second[v, u])
