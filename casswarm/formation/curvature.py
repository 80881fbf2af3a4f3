"""Diagonal blocks of the formation objective's Hessian as source, one for every member.

They precondition Newton steps of large swarms: members' curvatures differ by orders of magnitude.
"""

from __future__ import annotations

BLOCKS = """
@kernel
def hessian_blocks(first, living, p, constants, parameters, scratch, blocks):
    n = blocks.size // 3
    radars = int(constants[0])
    dt = p[6 * n + 2]
    east, north, members = scratch[:n], scratch[n : 2 * n], scratch[6 * n : 7 * n]
    by_density, by_collision = scratch[2 * n : 3 * n], scratch[3 * n : 4 * n]
    twice_density, mixed = scratch[7 * n : 8 * n], scratch[8 * n : 9 * n]
    twice_collision = scratch[9 * n : 10 * n]
    for c in range(3 * n):
        blocks[c] = 0.0
    for i in range(living):
        k = 3 * int(members[i])
        if i < first:
            by_density[i], by_collision[i] = 0.0, 0.0
            twice_density[i], mixed[i], twice_collision[i] = 0.0, 0.0, 0.0
            continue
        weight = p[5 * n + k // 3]
        risk, risk_east, risk_north = 0.0, 0.0, 0.0
        round, east_east, east_north, north_north = 0.0, 0.0, 0.0, 0.0
        for r in range(1, 1 + 3 * radars, 3):
            de, dn, strength = east[i] - constants[r], north[i] - constants[r + 1], constants[r + 2]
            value, slope, curvature = second_source(de * de + dn * dn, parameters)
            risk += strength * value
            risk_east += 2.0 * strength * slope * de
            risk_north += 2.0 * strength * slope * dn
            round += 2.0 * strength * slope
            east_east += 4.0 * strength * curvature * de * de
            east_north += 4.0 * strength * curvature * de * dn
            north_north += 4.0 * strength * curvature * dn * dn
        east_i, north_i = east[i], north[i]
        densities, density_east, density_north = 0.0, 0.0, 0.0
        for j in range(living):
            de, dn = east_i - east[j], north_i - north[j]
            value, slope = density(de * de + dn * dn, parameters)
            densities += value
            density_east += 2.0 * slope * de
            density_north += 2.0 * slope * dn
        collisions, collision_east, collision_north = 0.0, 0.0, 0.0
        if {collides}:
            for j in range(living):
                de, dn = east_i - east[j], north_i - north[j]
                value, slope = collision(de * de + dn * dn, parameters)
                collisions += value if j != i else 0.0
                collision_east += 2.0 * slope * de
                collision_north += 2.0 * slope * dn
        _, by_risk, d, c, rr, rd, rc, dd, dc, cc = second_combine(
            risk, densities, collisions, parameters
        )
        by_density[i], by_collision[i] = weight * d, weight * c
        twice_density[i], mixed[i] = weight * dd, weight * dc
        twice_collision[i] = weight * cc
        along_risk = rr * risk_east + rd * density_east + rc * collision_east
        along_density = rd * risk_east + dd * density_east + dc * collision_east
        along_collision = rc * risk_east + dc * density_east + cc * collision_east
        east_east = by_risk * (round + east_east) + along_risk * risk_east
        east_east += along_density * density_east + along_collision * collision_east
        east_north = by_risk * east_north + along_risk * risk_north
        east_north += along_density * density_north + along_collision * collision_north
        along_risk = rr * risk_north + rd * density_north + rc * collision_north
        along_density = rd * risk_north + dd * density_north + dc * collision_north
        along_collision = rc * risk_north + dc * density_north + cc * collision_north
        north_north = by_risk * (round + north_north) + along_risk * risk_north
        north_north += along_density * density_north + along_collision * collision_north
        blocks[k], blocks[k + 1] = weight * east_east, weight * east_north
        blocks[k + 2] = weight * north_north
    for i in range(living):
        k = 3 * int(members[i])
        east_i, north_i, density_i, collision_i = east[i], north[i], by_density[i], by_collision[i]
        round, east_east, east_north, north_north = 0.0, 0.0, 0.0, 0.0
        for j in range(living):
            de, dn = east_i - east[j], north_i - north[j]
            _, slope, curvature = second_density(de * de + dn * dn, parameters)
            factor = density_i + by_density[j]
            round += factor * slope if j != i else 0.0
            factor = factor * curvature + twice_density[j] * slope * slope
            if {collides}:
                _, steepness, curvature = second_collision(de * de + dn * dn, parameters)
                other = collision_i + by_collision[j]
                round += other * steepness if j != i else 0.0
                factor += other * curvature
                factor += (2.0 * mixed[j] * slope + twice_collision[j] * steepness) * steepness
            east_east += factor * de * de
            east_north += factor * de * dn
            north_north += factor * dn * dn
        blocks[k] = dt * dt * (blocks[k] + 2.0 * round + 4.0 * east_east)
        blocks[k + 1] = dt * dt * (blocks[k + 1] + 4.0 * east_north)
        blocks[k + 2] = dt * dt * (blocks[k + 2] + 2.0 * round + 4.0 * north_north)
"""
"""Blocks (east east, east north, north north) of members, zero for those that are not living.

Called by `evaluate` of `casswarm.formation.pair_loops`, with its `scratch`: the
coordinates of the living are read, the rest is overwritten.
"""
