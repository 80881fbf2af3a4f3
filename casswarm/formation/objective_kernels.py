"""The formation problem's objective and its gradient, for rates that are made of kernels.

The same sums as `casswarm.hazard.kernel_hazard` assembles in matrix form: the objective of
`casswarm.problems.formation`, with its layout of x and p. Every pair of members is evaluated once.
`scratch` (n (n + 8),) is overwritten; its last n entries are what each of the living adds to the
densities of others, where members differ.

In large swarms the order of sums is free, so that loops over pairs are vectorised, and diagonal
blocks of the Hessian are written too, one for every member: the members' curvatures differ by
orders of magnitude, and these precondition Newton steps.
"""

from __future__ import annotations

from ..compiled.kernels import kernel
from ..hazard.rate_kernels import (
    COLLIDES,
    DIFFER,
    FIRST_RADAR,
    Parameters,
    collision,
    density,
    member_rate,
    second_collision,
    second_combine,
    second_density,
    second_source,
    second_zone,
    unpacked,
)
from ..typing import FloatArray


@kernel
def evaluate_few(
    x: FloatArray, p: FloatArray, constants: FloatArray, gradient: FloatArray, scratch: FloatArray
) -> float:
    """Objective of x (2n,); its gradient is written to the first 2n entries.

    The living are copied to vectors of their coordinates, so that the loops over pairs can be
    vectorised: their indices begin at zero, they have no branches, and each reads and writes few
    arrays (the compiler must check that these do not overlap). Where nobody is alive, members with
    a weight count as if each were alone.
    """
    n, parameters = x.size // 2, unpacked(constants)
    dt = p[6 * n + 2]
    east, north = scratch[:n], scratch[n : 2 * n]
    densities, collisions = scratch[2 * n : 3 * n], scratch[3 * n : 4 * n]
    gradient_east, gradient_north = scratch[4 * n : 5 * n], scratch[5 * n : 6 * n]
    members = scratch[6 * n : 7 * n]
    first, living = gather(x, p, constants, scratch)
    alone = living > 0 and p[4 * n + int(members[living - 1])] == 0.0
    if not alone:
        sum_pairs(n, first, living, parameters, scratch)
    own_density, objective = density(0.0, parameters)[0], 0.0
    shares = scratch[n * (n + 7) :]
    for k in range(first):
        densities[k], collisions[k] = 0.0, 0.0
        gradient_east[k], gradient_north[k] = 0.0, 0.0
    for k in range(first, living):
        i = int(members[k])
        weight, own = p[5 * n + i], shares[k] * own_density if DIFFER else own_density
        rate, gradient_east[k], gradient_north[k], densities[k], collisions[k] = member_rate(
            i,
            n,
            (east[k], north[k]),
            (densities[k] + own, collisions[k]),
            2.0 * dt * weight,
            constants,
            parameters,
        )
        objective += weight * rate
    if not alone:
        pair_gradients(n, first, living, scratch)
    for c in range(2 * n):
        gradient[c] = 0.0
    for k in range(living):
        i = int(members[k])
        gradient[2 * i], gradient[2 * i + 1] = gradient_east[k], gradient_north[k]
    return objective


@kernel
def evaluate_many(
    x: FloatArray, p: FloatArray, constants: FloatArray, gradient: FloatArray, scratch: FloatArray
) -> float:
    """Objective of x (2n,); its gradient is written, and where it has 5n entries, the blocks."""
    objective: float = evaluate_few(x, p, constants, gradient, scratch)
    if gradient.size > x.size:
        first, living = gather(x, p, constants, scratch)
        write_blocks(first, living, p, constants, scratch, gradient[x.size :])
    return objective


@kernel
def gather(
    x: FloatArray, p: FloatArray, constants: FloatArray, scratch: FloatArray
) -> tuple[int, int]:
    """Write coordinates and indices of members that are alive or have a weight; set sums to zero.

    Returned are the first that has a weight, and their number.
    """
    n, living, first = x.size // 2, 0, 0
    dt = p[6 * n + 2]
    for weighted in range(2):
        first = living
        for i in range(n):
            weight = p[5 * n + i]
            if weight != 0.0 if weighted else weight == 0.0 and p[4 * n + i] != 0.0:
                scratch[6 * n + living] = i
                scratch[living] = p[2 * i] + dt * x[2 * i]
                scratch[n + living] = p[2 * i + 1] + dt * x[2 * i + 1]
                scratch[2 * n + living], scratch[3 * n + living] = 0.0, 0.0
                if DIFFER:
                    scratch[n * (n + 7) + living] = constants[constants.size - n + i]
                living += 1
    return first, living


@kernel
def sum_pairs(n: int, first: int, living: int, parameters: Parameters, scratch: FloatArray) -> None:
    """Add the densities and collisions of the same pairs; keep their slopes."""
    east, north = scratch[:n], scratch[n : 2 * n]
    densities, collisions = scratch[2 * n : 3 * n], scratch[3 * n : 4 * n]
    pairs, shares, start = scratch[7 * n :], scratch[n * (n + 7) :], 0
    for i in range(first, living):
        east_i, north_i, total = east[i], north[i], 0.0
        slopes = pairs[start : start + i]
        for j in range(i):
            de, dn = east_i - east[j], north_i - north[j]
            value, slopes[j] = density(de * de + dn * dn, parameters)
            total += shares[j] * value if DIFFER else value
            densities[j] += shares[i] * value if DIFFER else value
        densities[i] += total
        start += i
        if COLLIDES:
            total = 0.0
            slopes = pairs[start : start + i]
            for j in range(i):
                de, dn = east_i - east[j], north_i - north[j]
                value, slopes[j] = collision(de * de + dn * dn, parameters)
                total += value
                collisions[j] += value
            collisions[i] += total
            start += i


@kernel
def pair_gradients(n: int, first: int, living: int, scratch: FloatArray) -> None:
    """Add the gradient of the same pairs, with the derivatives in the sums in their place."""
    east, north = scratch[:n], scratch[n : 2 * n]
    densities, collisions = scratch[2 * n : 3 * n], scratch[3 * n : 4 * n]
    gradient_east, gradient_north = scratch[4 * n : 5 * n], scratch[5 * n : 6 * n]
    pairs, shares, start = scratch[7 * n :], scratch[n * (n + 7) :], 0
    for i in range(first, living):
        east_i, north_i, own = east[i], north[i], densities[i]
        slopes = pairs[start : start + i]
        for j in range(i):
            slopes[j] *= (
                shares[j] * own + shares[i] * densities[j] if DIFFER else own + densities[j]
            )
        start += i
        if COLLIDES:
            own = collisions[i]
            collision_slopes = pairs[start : start + i]
            for j in range(i):
                slopes[j] += (own + collisions[j]) * collision_slopes[j]
            start += i
        total_east, total_north = gradient_east[i], gradient_north[i]
        for j in range(i):
            de, dn = slopes[j] * (east_i - east[j]), slopes[j] * (north_i - north[j])
            total_east += de
            total_north += dn
            gradient_east[j] -= de
            gradient_north[j] -= dn
        gradient_east[i], gradient_north[i] = total_east, total_north


@kernel
def write_blocks(
    first: int,
    living: int,
    p: FloatArray,
    constants: FloatArray,
    scratch: FloatArray,
    blocks: FloatArray,
) -> None:
    """Write blocks (east east, east north, north north) of members, zero for the destroyed.

    The coordinates and indices of the living in `scratch` are read, the rest is overwritten.
    """
    n, parameters = blocks.size // 3, unpacked(constants)
    east, north, members = scratch[:n], scratch[n : 2 * n], scratch[6 * n : 7 * n]
    by_density, by_collision = scratch[2 * n : 3 * n], scratch[3 * n : 4 * n]
    twice_density, mixed = scratch[7 * n : 8 * n], scratch[8 * n : 9 * n]
    twice_collision, squared_dt = scratch[9 * n : 10 * n], p[6 * n + 2] * p[6 * n + 2]
    shares = scratch[n * (n + 7) :]
    for c in range(3 * n):
        blocks[c] = 0.0
    for i in range(first):
        by_density[i], by_collision[i] = 0.0, 0.0
        twice_density[i], mixed[i], twice_collision[i] = 0.0, 0.0, 0.0
    for i in range(first, living):
        own_curvature(i, living, p, constants, scratch, blocks)
    for i in range(living):
        k = 3 * int(members[i])
        east_i, north_i, density_i, collision_i = east[i], north[i], by_density[i], by_collision[i]
        around, east_east, east_north, north_north = 0.0, 0.0, 0.0, 0.0
        for j in range(living):
            de, dn = east_i - east[j], north_i - north[j]
            _, slope, curvature = second_density(de * de + dn * dn, parameters)
            if DIFFER:
                factor = shares[j] * density_i + shares[i] * by_density[j]
                around += factor * slope if j != i else 0.0
                factor, slope = factor * curvature, shares[i] * slope
            else:
                factor = density_i + by_density[j]
                around += factor * slope if j != i else 0.0
                factor *= curvature
            factor += twice_density[j] * slope * slope
            if COLLIDES:
                _, steepness, curvature = second_collision(de * de + dn * dn, parameters)
                other = collision_i + by_collision[j]
                around += other * steepness if j != i else 0.0
                factor += other * curvature
                factor += (2.0 * mixed[j] * slope + twice_collision[j] * steepness) * steepness
            east_east += factor * de * de
            east_north += factor * de * dn
            north_north += factor * dn * dn
        blocks[k] = squared_dt * (blocks[k] + 2.0 * around + 4.0 * east_east)
        blocks[k + 1] = squared_dt * (blocks[k + 1] + 4.0 * east_north)
        blocks[k + 2] = squared_dt * (blocks[k + 2] + 2.0 * around + 4.0 * north_north)


@kernel
def own_curvature(
    i: int,
    living: int,
    p: FloatArray,
    constants: FloatArray,
    scratch: FloatArray,
    blocks: FloatArray,
) -> None:
    """Write the second derivatives of a member's weighted rate, and those in its sums."""
    n, parameters = blocks.size // 3, unpacked(constants)
    east, north, k = scratch[:n], scratch[n : 2 * n], 3 * int(scratch[6 * n + i])
    weight, east_i, north_i = p[5 * n + k // 3], east[i], north[i]
    risk, risk_east, risk_north, east_east, east_north, north_north = second_zone(
        east_i, north_i, parameters
    )
    around, last = 0.0, constants.size - 2 * n if DIFFER else constants.size
    for r in range(FIRST_RADAR, last, 3):
        de, dn, strength = east_i - constants[r], north_i - constants[r + 1], constants[r + 2]
        value, slope, curvature = second_source(de * de + dn * dn, parameters)
        risk += strength * value
        risk_east += 2.0 * strength * slope * de
        risk_north += 2.0 * strength * slope * dn
        around += 2.0 * strength * slope
        east_east += 4.0 * strength * curvature * de * de
        east_north += 4.0 * strength * curvature * de * dn
        north_north += 4.0 * strength * curvature * dn * dn
    if DIFFER:
        exposure = constants[last + k // 3]
        risk, risk_east, risk_north = exposure * risk, exposure * risk_east, exposure * risk_north
        around, east_east = exposure * around, exposure * east_east
        east_north, north_north = exposure * east_north, exposure * north_north
    densities, density_east, density_north = 0.0, 0.0, 0.0
    for j in range(living):
        de, dn = east_i - east[j], north_i - north[j]
        value, slope = density(de * de + dn * dn, parameters)
        if DIFFER:
            share = scratch[n * (n + 7) + j]
            value, slope = share * value, share * slope
        densities += value
        density_east += 2.0 * slope * de
        density_north += 2.0 * slope * dn
    collisions, collision_east, collision_north = 0.0, 0.0, 0.0
    if COLLIDES:
        for j in range(living):
            de, dn = east_i - east[j], north_i - north[j]
            value, slope = collision(de * de + dn * dn, parameters)
            collisions += value if j != i else 0.0
            collision_east += 2.0 * slope * de
            collision_north += 2.0 * slope * dn
    _, by_risk, d, c, rr, rd, rc, dd, dc, cc = second_combine(
        risk, densities, collisions, parameters
    )
    scratch[2 * n + i], scratch[3 * n + i] = weight * d, weight * c
    scratch[7 * n + i], scratch[8 * n + i] = weight * dd, weight * dc
    scratch[9 * n + i] = weight * cc
    along_risk = rr * risk_east + rd * density_east + rc * collision_east
    along_density = rd * risk_east + dd * density_east + dc * collision_east
    along_collision = rc * risk_east + dc * density_east + cc * collision_east
    east_east = by_risk * (around + east_east) + along_risk * risk_east
    east_east += along_density * density_east + along_collision * collision_east
    east_north = by_risk * east_north + along_risk * risk_north
    east_north += along_density * density_north + along_collision * collision_north
    along_risk = rr * risk_north + rd * density_north + rc * collision_north
    along_density = rd * risk_north + dd * density_north + dc * collision_north
    along_collision = rc * risk_north + dc * density_north + cc * collision_north
    north_north = by_risk * (around + north_north) + along_risk * risk_north
    north_north += along_density * density_north + along_collision * collision_north
    blocks[k], blocks[k + 1] = weight * east_east, weight * east_north
    blocks[k + 2] = weight * north_north


FEW = member_rate, gather, sum_pairs, pair_gradients, evaluate_few
MANY = *FEW, own_curvature, write_blocks, evaluate_many
"""Kernels that the objective is made of, for `casswarm.hazard.rate_module`."""
