"""Derivatives of a step of the joint plan's recursion over sets, compiled.

The rates are combine(S_i, D_i(d), C_i(d)) of sums over radars and over other members, as in
`casswarm.hazard.kernels`.
"""

from __future__ import annotations

from typing import NamedTuple

from .._util.jit import allocating_kernel, kernel
from ..typing import FloatArray
from .joint_kernels import Scratch, expectation, outcomes, read_set, scratch


class Step(NamedTuple):
    """A step of n members; m = 2^n is the number of sets.

    Parameters
    ----------
    x : (2n,)
        Positions after it.
    dt : float
    lost : (m, n)
        Probabilities of the members of each set.
    mass, after : (m,)
        Masses of the sets before it, and a function of the survivors.
    radars : (n, 5)
        Gradient and Hessian (xx, xy, yy) of S_i.
    pairs : (4, n, n)
        First and second derivatives of density and collision in the squared distance.
    rates : (m, n, 10)
        combine, its gradient and the upper triangle of its Hessian.
    collides : bool
        Whether the collision kernel is not zero.
    continues, costs : (m,)
        Whether the run goes on with each set alive after the step, and else its cost; for the empty
        set, 0 and the cost of having lost all.
    """

    x: FloatArray
    dt: float
    lost: FloatArray
    mass: FloatArray
    after: FloatArray
    radars: FloatArray
    pairs: FloatArray
    rates: FloatArray
    collides: bool
    continues: FloatArray
    costs: FloatArray


class Derivatives(NamedTuple):
    """Derivatives of a step in x; M is its matrix over sets.

    Parameters
    ----------
    gradient, hessian : (2n,), (2n, 2n)
        Of mass' M after.
    by_set : (m, 2n)
        Of M after.
    by_outcome : (m, 2n)
        Of M' mass where the run goes on; in row 0, of its expected cost if it ends.
    transitions : (3^n,)
        M likewise, for the subsets of every set in ascending order.
    """

    gradient: FloatArray
    hessian: FloatArray
    by_set: FloatArray
    by_outcome: FloatArray
    transitions: FloatArray


@kernel
def rate_gradients(d: int, count: int, step: Step, work: Scratch) -> None:
    """Write the gradients of D, C and q of all members of the set."""
    n = step.lost.shape[1]
    for u in range(count):
        i = work.members[u]
        weight = step.dt * (1.0 - work.lost[u])
        by_source, by_density, by_collision = (
            weight * step.rates[d, i, 1],
            weight * step.rates[d, i, 2],
            weight * step.rates[d, i, 3],
        )
        density, collision, rate = work.density[u], work.collision[u], work.rate[u]
        for c in range(2 * n):
            density[c] = 0.0
            collision[c] = 0.0
        for v in range(count):
            j = work.members[v]
            if j != i:
                for a in range(2):
                    slope = 2.0 * (step.x[2 * i + a] - step.x[2 * j + a])
                    density[2 * i + a] += step.pairs[0, i, j] * slope
                    density[2 * j + a] = -step.pairs[0, i, j] * slope
                    collision[2 * i + a] += step.pairs[2, i, j] * slope
                    collision[2 * j + a] = -step.pairs[2, i, j] * slope
        for c in range(2 * n):
            rate[c] = by_density * density[c] + by_collision * collision[c]
        rate[2 * i] += by_source * step.radars[i, 0]
        rate[2 * i + 1] += by_source * step.radars[i, 1]


@kernel
def set_derivatives(d: int, count: int, step: Step, work: Scratch) -> None:
    """Write the derivatives of E(d) in one and two of its members' probabilities."""
    for m in range(1 << count):
        work.values[m] = step.after[work.subsets[m]]
    for u in range(count):
        work.first[u] = expectation(count, u, -1, work)
        if step.mass[d] > 0.0:
            for v in range(u):
                work.second[u, v] = work.second[v, u] = expectation(count, u, v, work)


@kernel
def add_outer(left: FloatArray, right: FloatArray, hessian: FloatArray) -> None:
    """Add left right' to the Hessian."""
    for r in range(left.size):
        target, factor = hessian[r], left[r]
        for c in range(right.size):
            target[c] += factor * right[c]


@kernel
def add_outcome_derivatives(mass: float, count: int, work: Scratch, by_outcome: FloatArray) -> None:
    """Add the derivatives of the masses of all subsets after the step."""
    for u in range(count):
        q = work.lost[u]
        work.lost[u] = 0.5  # both outcomes have this factor, which is doubled and signed
        outcomes(2.0 * mass, count, work)
        work.lost[u] = q
        rate = work.rate[u]
        for m in range(1 << count):
            target = by_outcome[work.subsets[m]]
            p = -work.values[m] if m >> u & 1 else work.values[m]
            for c in range(rate.size):
                target[c] += p * rate[c]


@kernel
def add_curvature(d: int, count: int, step: Step, work: Scratch, hessian: FloatArray) -> None:
    """Add the products of first derivatives that a set contributes to the Hessian.

    The factors of second derivatives of S, D and C are added to `curvature`.
    """
    row, mass = work.row, step.mass[d]
    for u in range(count):
        i = work.members[u]
        rate, density, collision = work.rate[u], work.density[u], work.collision[u]
        east, north = step.radars[i, 0], step.radars[i, 1]
        alive = 1.0 - work.lost[u]
        first = mass * work.first[u]
        for c in range(row.size):
            row[c] = -first / alive * rate[c] if alive > 0.0 else 0.0
        for v in range(count):
            if v != u:
                other, factor = work.rate[v], mass * work.second[u, v]
                for c in range(row.size):
                    row[c] += factor * other[c]
        add_outer(rate, row, hessian)
        weight = first * step.dt * alive
        partials = step.rates[d, i]
        work.curvature[0, i, i] += weight * partials[1]
        for v in range(count):
            j = work.members[v]
            if j != i:
                work.curvature[1, i, j] += weight * partials[2]
                work.curvature[2, i, j] += weight * partials[3]
        combined_row(weight * partials[7], weight * partials[8], density, collision, row)
        row[2 * i] += weight * partials[5] * east
        row[2 * i + 1] += weight * partials[5] * north
        add_outer(density, row, hessian)
        if step.collides:
            combined_row(weight * partials[8], weight * partials[9], density, collision, row)
            row[2 * i] += weight * partials[6] * east
            row[2 * i + 1] += weight * partials[6] * north
            add_outer(collision, row, hessian)
        combined_row(weight * partials[5], weight * partials[6], density, collision, row)
        row[2 * i] += weight * partials[4] * east
        row[2 * i + 1] += weight * partials[4] * north
        for c in range(row.size):
            hessian[2 * i, c] += east * row[c]
            hessian[2 * i + 1, c] += north * row[c]


@kernel
def combined_row(
    by_density: float,
    by_collision: float,
    density: FloatArray,
    collision: FloatArray,
    row: FloatArray,
) -> None:
    """Write a combination of the gradients of D and C."""
    for c in range(row.size):
        row[c] = by_density * density[c] + by_collision * collision[c]


@kernel
def add_second_derivatives(step: Step, work: Scratch, hessian: FloatArray) -> None:
    """Add the second derivatives of S, D and C, with their factors in `curvature`."""
    for i in range(step.lost.shape[1]):
        factor = work.curvature[0, i, i]
        for a in range(2):
            for b in range(2):
                hessian[2 * i + a, 2 * i + b] += factor * step.radars[i, 2 + a + b]
        for j in range(i):
            density = work.curvature[1, i, j] + work.curvature[1, j, i]
            collision = work.curvature[2, i, j] + work.curvature[2, j, i]
            slope = 2.0 * (density * step.pairs[0, i, j] + collision * step.pairs[2, i, j])
            bend = 4.0 * (density * step.pairs[1, i, j] + collision * step.pairs[3, i, j])
            for a in range(2):
                for b in range(2):
                    entry = bend * (step.x[2 * i + a] - step.x[2 * j + a])
                    entry *= step.x[2 * i + b] - step.x[2 * j + b]
                    if a == b:
                        entry += slope
                    hessian[2 * i + a, 2 * i + b] += entry
                    hessian[2 * j + a, 2 * j + b] += entry
                    hessian[2 * i + a, 2 * j + b] -= entry
                    hessian[2 * j + a, 2 * i + b] -= entry


@kernel
def fold(step: Step, probabilities: FloatArray, count: int, work: Scratch) -> None:
    """Write the probabilities of going on with every subset; entry 0 is the cost of ending now."""
    probabilities[0] = step.costs[0] * work.values[0]
    for m in range(1, 1 << count):
        subset = work.subsets[m]
        probabilities[0] += step.costs[subset] * work.values[m]
        probabilities[m] = step.continues[subset] * work.values[m]


@kernel
def fold_outcomes(step: Step, by_outcome: FloatArray) -> None:
    """The same for derivatives of the masses of all sets."""
    for c in range(by_outcome.shape[1]):
        by_outcome[0, c] *= step.costs[0]
    for d in range(1, len(by_outcome)):
        for c in range(by_outcome.shape[1]):
            by_outcome[0, c] += step.costs[d] * by_outcome[d, c]
            by_outcome[d, c] *= step.continues[d]


@kernel
def differentiate(step: Step, out: Derivatives, work: Scratch) -> None:
    """Write all derivatives of a step; `out` begins with zeros."""
    n = step.lost.shape[1]
    work.curvature[:] = 0.0
    out.transitions[0] = 1.0
    place = 1
    for d in range(1, 1 << n):
        count = read_set(d, step.lost, work)
        set_derivatives(d, count, step, work)
        rate_gradients(d, count, step, work)
        for u in range(count):
            for c in range(2 * n):
                out.by_set[d, c] += work.first[u] * work.rate[u, c]
        outcomes(1.0, count, work)
        fold(step, out.transitions[place:], count, work)
        place += 1 << count
        if step.mass[d] > 0.0:
            for c in range(2 * n):
                out.gradient[c] += step.mass[d] * out.by_set[d, c]
            add_outcome_derivatives(step.mass[d], count, work, out.by_outcome)
            add_curvature(d, count, step, work, out.hessian)
    add_second_derivatives(step, work, out.hessian)
    fold_outcomes(step, out.by_outcome)


@allocating_kernel
def differentiate_steps(clocks: FloatArray, steps: Step, out: Derivatives) -> None:
    """Derivatives of b recursions of T steps: arrays have these axes in front, clocks (b,)."""
    batch, count = steps.x.shape[:2]
    work = scratch(steps.lost.shape[3])
    for k in range(batch):
        for t in range(count):
            step = Step(
                steps.x[k, t],
                clocks[k],
                steps.lost[k, t],
                steps.mass[k, t],
                steps.after[k, t],
                steps.radars[k, t],
                steps.pairs[k, t],
                steps.rates[k, t],
                steps.collides,
                steps.continues[k, t],
                steps.costs[k, t],
            )
            part = Derivatives(
                out.gradient[k, t],
                out.hessian[k, t],
                out.by_set[k, t],
                out.by_outcome[k, t],
                out.transitions[k, t],
            )
            differentiate(step, part, work)
