"""The joint plan's recursion over sets of living members, compiled.

A set d of n members is a bit mask below m = 2^n. In a step its members are lost independently with
probabilities q_i(d), so that the expectation E(d) of a function of the survivors is linear in each
q_i.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..compiled.kernels import allocating_kernel, kernel
from ..compiled.parallel import execute
from ..typing import FloatArray, IntArray

_PER_THREAD = 2**15  # sets, of all steps, that are worth a thread


class Scratch(NamedTuple):
    """What is computed of one set with k members.

    Parameters
    ----------
    members, subsets : (n,), (m,) int
        Its members, and the masks of its 2^k subsets.
    lost : (n,)
        Probabilities of its members.
    values : (m,)
        A function of its subsets, which is overwritten.
    """

    members: IntArray
    subsets: IntArray
    lost: FloatArray
    values: FloatArray


@allocating_kernel
def scratch(n: int) -> Scratch:
    """Arrays for sets of n members."""
    sets = 1 << n
    return Scratch(np.empty(n, np.int64), np.empty(sets, np.int64), np.empty(n), np.empty(sets))


@kernel
def read_set(d: int, lost: FloatArray, work: Scratch) -> int:
    """Write members, subsets and probabilities of the set d; return its number of members."""
    count = 0
    work.subsets[0] = 0
    for i in range(lost.shape[1]):
        if d >> i & 1:
            for m in range(1 << count):
                work.subsets[m + (1 << count)] = work.subsets[m] | 1 << i
            work.members[count] = i
            work.lost[count] = lost[d, i]
            count += 1
    return count


@kernel
def expectation(count: int, work: Scratch) -> float:
    """The expectation of `values`, which is overwritten."""
    values, half = work.values, 1 << count
    for s in range(count - 1, -1, -1):
        half >>= 1
        q = work.lost[s]
        for m in range(half):
            values[m] = values[m + half] + q * (values[m] - values[m + half])
    return values[0]  # type: ignore[no-any-return]


@kernel
def outcomes(mass: float, count: int, work: Scratch) -> None:
    """Write to `values` the probabilities of all subsets after a step, times a mass."""
    values = work.values
    values[0] = mass
    for s in range(count):
        q = work.lost[s]
        for m in range(1 << s):
            values[m + (1 << s)] = values[m] * (1.0 - q)
            values[m] *= q


def recursion(
    lost: FloatArray, continues: FloatArray, costs: FloatArray, last_cost: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """F_0 (b, m), masses before and functions after every step (b, T, m), of b recursions.

    `lost` are probabilities (b, T, m, n); `continues`, `costs` (b, T, m); `last_cost` (b, m).
    """
    batch, steps, sets, _ = lost.shape
    value, masses, after = last_cost.copy(), np.zeros(costs.shape), np.empty(costs.shape)
    arguments = lost, continues, costs, value, masses, after
    execute(sweep, batch, arguments, _PER_THREAD // (steps * sets))
    return value, masses, after


@allocating_kernel
def sweep(
    plans: tuple[int, int],
    lost: FloatArray,
    continues: FloatArray,
    costs: FloatArray,
    value: FloatArray,
    masses: FloatArray,
    after: FloatArray,
) -> None:
    """Run these of the recursions, whose value begins as the last cost and masses as zeros."""
    sets, n = lost.shape[2:]
    work = scratch(n)
    for k in range(plans[0], plans[1]):
        backward(lost[k], continues[k], costs[k], value[k], after[k], work)
        masses[k, 0, sets - 1] = 1.0
        forward(lost[k], continues[k], masses[k], work)


@kernel
def backward(
    lost: FloatArray,
    continues: FloatArray,
    costs: FloatArray,
    value: FloatArray,
    after: FloatArray,
    work: Scratch,
) -> None:
    """Write the functions after every step; `value` begins as the last cost, and ends as F_0."""
    for t in range(len(lost) - 1, -1, -1):
        for d in range(value.size):
            after[t, d] = costs[t, d] + continues[t, d] * value[d]
        for d in range(value.size):
            count = read_set(d, lost[t], work)
            for m in range(1 << count):
                work.values[m] = after[t, work.subsets[m]]
            value[d] = expectation(count, work)


@kernel
def forward(lost: FloatArray, continues: FloatArray, masses: FloatArray, work: Scratch) -> None:
    """Write the masses before every step but the first."""
    for t in range(len(lost) - 1):
        for d in range(masses.shape[1]):
            if masses[t, d] > 0.0:
                count = read_set(d, lost[t], work)
                outcomes(masses[t, d], count, work)
                for m in range(1 << count):
                    survivors = work.subsets[m]
                    masses[t + 1, survivors] += work.values[m] * continues[t, survivors]
