"""The joint plan's recursion over sets of living members, compiled.

A set d of n members is a bit mask below m = 2^n. In a step its members are lost independently with
probabilities q_i(d), so that the expectation E(d) of a function of the survivors is linear in each
q_i. Steps of one plan follow each other, and their loops are over sets; what is local to steps
(`casswarm.joint.derivative_kernels`) is done for `LANES` of them, the last axis of arrays, before
the next operation.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..compiled.kernels import allocating_kernel, kernel
from ..compiled.parallel import execute
from ..hazard.rate_kernels import LANES
from ..typing import FloatArray, IntArray

_PER_THREAD = 2**15  # sets, of all steps, that are worth a thread


@kernel
def list_set(d: int, n: int, members: IntArray, subsets: IntArray) -> int:
    """Write members and subsets of the set d; return its number of members."""
    count = 0
    subsets[0] = 0
    for i in range(n):
        if d >> i & 1:
            for m in range(1 << count):
                subsets[m + (1 << count)] = subsets[m] | 1 << i
            members[count] = i
            count += 1
    return count


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
    members, subsets, values = np.empty(n, np.int64), np.empty(sets, np.int64), np.empty(sets)
    work = members, subsets, values
    for k in range(plans[0], plans[1]):
        for t in range(lost.shape[1] - 1, -1, -1):
            step_back(lost[k, t], continues[k, t], costs[k, t], value[k], after[k, t], work)
        masses[k, 0, sets - 1] = 1.0
        for t in range(lost.shape[1] - 1):
            step_forth(lost[k, t], continues[k, t], masses[k, t], masses[k, t + 1], work)


@kernel
def step_back(
    lost: FloatArray,
    continues: FloatArray,
    costs: FloatArray,
    value: FloatArray,
    after: FloatArray,
    work: tuple[IntArray, IntArray, FloatArray],
) -> None:
    """Write the function after a step, and its expectations in place of `value`."""
    members, subsets, values = work
    for d in range(value.size):
        after[d] = costs[d] + continues[d] * value[d]
    for d in range(value.size):
        count = list_set(d, lost.shape[1], members, subsets)
        half = 1 << count
        for m in range(half):
            values[m] = after[subsets[m]]
        for s in range(count - 1, -1, -1):
            half >>= 1
            q = lost[d, members[s]]
            for m in range(half):
                values[m] = values[m + half] + q * (values[m] - values[m + half])
        value[d] = values[0]


@kernel
def step_forth(
    lost: FloatArray,
    continues: FloatArray,
    masses: FloatArray,
    later: FloatArray,
    work: tuple[IntArray, IntArray, FloatArray],
) -> None:
    """Add the probabilities of all sets after a step to the masses before the next one."""
    members, subsets, values = work
    for d in range(masses.size):
        if masses[d] > 0.0:
            count = list_set(d, lost.shape[1], members, subsets)
            values[0] = masses[d]
            for s in range(count):
                q, half = lost[d, members[s]], 1 << s
                for m in range(half):
                    values[m + half] = values[m] * (1.0 - q)
                    values[m] *= q
            for m in range(1 << count):
                later[subsets[m]] += values[m] * continues[subsets[m]]


class Work(NamedTuple):
    """Work arrays for one set of k members, in all lanes, and for sums over all sets."""

    members: IntArray  # (n,), its members
    subsets: IntArray  # (m,), the masks of its 2^k subsets
    values: FloatArray  # (m, LANES), a function of its subsets
    cube: FloatArray  # (m, LANES), a copy that is overwritten
    first: FloatArray  # (n, LANES), derivatives of its expectation in its members' probabilities
    second: FloatArray  # (n, n, LANES), likewise
    rate: FloatArray  # (n, 2n, LANES), gradients of these in the positions of its members
    row: FloatArray  # (2n + 1, LANES)
    gradient: FloatArray  # (2n, LANES), a sum over all sets
    by_outcome: FloatArray  # (m, 2n, LANES), likewise


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
def copy(values: FloatArray, target: FloatArray) -> None:
    """Copy lanes."""
    for lane in range(LANES):
        target[lane] = values[lane]


@kernel
def write_expectation(
    count: int, i: int, j: int, lost: FloatArray, work: Work, out: FloatArray
) -> None:
    """Write the derivative of the expectation of `values` in those of members i and j (or -1)."""
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
        write_expectation(count, u, -1, lost, work, work.first[u])
        for v in range(u):
            write_expectation(count, u, v, lost, work, work.second[u, v])
            copy(work.second[u, v], work.second[v, u])
