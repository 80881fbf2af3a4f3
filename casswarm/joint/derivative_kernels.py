"""Derivatives of the steps of the joint plan's recursion over sets, compiled.

The rates are combine(S_i, D_i(d), C_i(d)) of sums over radars and over other members, as in
`casswarm.hazard.kernel_hazard`. An operation is done for `LANES` steps before the next one: they
are the last axis of all arrays but the results.
"""

from __future__ import annotations

from typing import NamedTuple

from ..compiled.kernels import allocating_kernel, kernel
from ..hazard.rate_kernels import LANES
from ..typing import FloatArray
from .curvature_kernels import (
    Curvature,
    add_curvature,
    add_products,
    add_second_derivatives,
    curvature,
    write_slopes,
)
from .set_kernels import (
    Work,
    copy,
    differentiate_expectation,
    list_set,
    workspace,
    write_outcomes,
)


class Steps(NamedTuple):
    """Blocks of steps of n members, in front of these axes; m = 2^n is the number of sets."""

    clock: FloatArray  # (LANES,), time steps
    lost: FloatArray  # (m, n, LANES), probabilities of the members of each set
    mass: FloatArray  # (m, LANES), of the sets before the step
    after: FloatArray  # (m, LANES), a function of the survivors
    continues: FloatArray  # (m, LANES), whether the run goes on with these; 0 for the empty set
    costs: FloatArray  # (m, LANES), else its cost; for the empty set, of having lost all
    points: FloatArray  # (n, 2, LANES), positions after the step
    radars: FloatArray  # (n, 5, LANES), gradient and Hessian (xx, xy, yy) of S_i
    pairs: FloatArray  # (4, n, n, LANES), derivatives of density, collision in squared distance
    rates: FloatArray  # (m, 10, n, LANES), combine, its gradient, upper triangle of its Hessian


class Derivatives(NamedTuple):
    """Derivatives of steps, in front, in their positions X; M is a step's matrix over sets."""

    gradient: FloatArray  # (2n,), of mass' M after
    hessian: FloatArray  # (2n, 2n), likewise
    by_set: FloatArray  # (m, 2n), of M after
    by_outcome: FloatArray  # (m, 2n), of M' mass if the run goes on; in row 0, of its cost if not
    transitions: FloatArray  # (3^n,), M likewise, for the subsets of every set in ascending order


@kernel
def differentiate_rates(
    d: int, count: int, block: int, steps: Steps, slopes: FloatArray, work: Work
) -> None:
    """Write the gradients of the members' probabilities in the positions of the set."""
    clock, rates, row = steps.clock[block], steps.rates[block, d], work.row
    n = len(slopes)
    for u in range(count):
        i = work.members[u]
        q = steps.lost[block, d, i]
        for k in range(3):
            factor, partial = row[k], rates[1 + k, i]
            for lane in range(LANES):
                factor[lane] = clock[lane] * (1.0 - q[lane]) * partial[lane]
        for a in range(2):
            own, source = work.rate[u, 2 * u + a], slopes[i, 0, a]
            for lane in range(LANES):
                own[lane] = row[0, lane] * source[lane]
            for v in range(count):
                if v != u:
                    j = work.members[v]
                    other = work.rate[u, 2 * v + a]
                    density, collision = slopes[i, 1 + j, a], slopes[i, 1 + n + j, a]
                    for lane in range(LANES):
                        slope = row[1, lane] * density[lane] + row[2, lane] * collision[lane]
                        other[lane] = -slope
                        own[lane] += slope


@kernel
def write_by_set(
    d: int, count: int, first: int, mass: FloatArray, work: Work, out: Derivatives
) -> None:
    """Write the gradient of the set's expectation, and add it to that of all."""
    for c in range(2 * count):
        row, gradient = work.row[c], work.gradient[2 * work.members[c >> 1] + (c & 1)]
        row[:] = 0.0
        for u in range(count):
            factor, rate = work.first[u], work.rate[u, c]
            for lane in range(LANES):
                row[lane] += factor[lane] * rate[lane]
        for lane in range(LANES):
            gradient[lane] += mass[lane] * row[lane]
    lanes = min(LANES, len(out.by_set) - first)
    for lane in range(lanes):
        target = out.by_set[first + lane, d]
        target[:] = 0.0
        for c in range(2 * count):
            target[2 * work.members[c >> 1] + (c & 1)] = work.row[c, lane]


@kernel
def write_transitions(
    count: int,
    first: int,
    place: int,
    continues: FloatArray,
    costs: FloatArray,
    work: Work,
    out: FloatArray,
) -> None:
    """Write the probabilities of going on with all subsets; the first is the cost of ending."""
    ending, cost = work.values[0], costs[0]
    for lane in range(LANES):
        ending[lane] *= cost[lane]
    for m in range(1, 1 << count):
        value, goes_on, cost = work.values[m], continues[work.subsets[m]], costs[work.subsets[m]]
        for lane in range(LANES):
            ending[lane] += cost[lane] * value[lane]
            value[lane] *= goes_on[lane]
    for lane in range(min(LANES, len(out) - first)):
        target = out[first + lane, place : place + (1 << count)]
        for m in range(1 << count):
            target[m] = work.values[m, lane]


@kernel
def add_by_outcome(count: int, lost: FloatArray, mass: FloatArray, work: Work) -> None:
    """Add the derivatives of the masses of all subsets after the step."""
    for u in range(count):
        copy(mass, work.values[0])
        write_outcomes(count, u, lost, work)
        for m in range(1 << count):
            factor = work.values[m]
            for v in range(count):
                j = work.members[v]
                for a in range(2):
                    target = work.by_outcome[work.subsets[m], 2 * j + a]
                    rate = work.rate[u, 2 * v + a]
                    for lane in range(LANES):
                        target[lane] += factor[lane] * rate[lane]


@kernel
def write_sums(
    first: int,
    continues: FloatArray,
    costs: FloatArray,
    work: Work,
    lower: FloatArray,
    out: Derivatives,
) -> None:
    """Write the sums over all sets."""
    by_outcome, width = work.by_outcome, len(work.gradient)
    for c in range(width):
        ending, cost = by_outcome[0, c], costs[0]
        for lane in range(LANES):
            ending[lane] *= cost[lane]
        for d in range(1, len(by_outcome)):
            target, cost, goes_on = by_outcome[d, c], costs[d], continues[d]
            for lane in range(LANES):
                ending[lane] += cost[lane] * target[lane]
                target[lane] *= goes_on[lane]
    for lane in range(min(LANES, len(out.gradient) - first)):
        step = first + lane
        for r in range(width):
            out.gradient[step, r] = work.gradient[r, lane]
            for c in range(r + 1):
                out.hessian[step, r, c] = out.hessian[step, c, r] = lower[r, c, lane]
        for d in range(len(by_outcome)):
            for c in range(width):
                out.by_outcome[step, d, c] = by_outcome[d, c, lane]


@kernel
def differentiate_block(
    block: int,
    steps: Steps,
    kinds: int,
    work: Work,
    sums: Curvature,
    out: Derivatives,
) -> None:
    """Write all derivatives of the steps of a block."""
    n, first = steps.lost.shape[2], block * LANES
    continues, costs = steps.continues[block], steps.costs[block]
    sums.lower[:] = 0.0
    sums.first[:] = 0.0
    sums.second[:] = 0.0
    write_slopes(steps.points[block], steps.radars[block], steps.pairs[block], sums.slopes)
    work.gradient[:] = 0.0
    work.by_outcome[:] = 0.0
    out.by_set[first : first + LANES, 0] = 0.0
    out.transitions[first : first + LANES, 0] = 1.0
    place = 1
    for d in range(1, 1 << n):
        lost, mass = steps.lost[block, d], steps.mass[block, d]
        count = list_set(d, n, work.members, work.subsets)
        differentiate_expectation(count, lost, steps.after[block], work)
        differentiate_rates(d, count, block, steps, sums.slopes, work)
        write_by_set(d, count, first, mass, work, out)
        work.values[0] = 1.0
        write_outcomes(count, -1, lost, work)
        write_transitions(count, first, place, continues, costs, work, out.transitions)
        place += 1 << count
        add_by_outcome(count, lost, mass, work)
        set_data = work.members[:count], lost, mass, work.first, work.second
        add_products(set_data, work.rate, work.row, sums.lower)
        add_curvature(set_data, steps.clock[block], steps.rates[block, d], kinds, work.row, sums)
    add_second_derivatives(
        steps.points[block], steps.radars[block], steps.pairs[block], kinds, sums
    )
    write_sums(first, continues, costs, work, sums.lower, out)


@allocating_kernel
def differentiate(blocks: tuple[int, int], steps: Steps, collides: bool, out: Derivatives) -> None:
    """Write the derivatives of the steps of these blocks; `collides` as the hazard.

    Results have the axis of all steps in front.
    """
    n = steps.lost.shape[2]
    work, sums = workspace(n), curvature(n)
    for block in range(blocks[0], blocks[1]):
        differentiate_block(block, steps, 3 if collides else 2, work, sums, out)
