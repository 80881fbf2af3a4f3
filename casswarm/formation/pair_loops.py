"""The formation objective of large swarms as source, with loops over pairs that are vectorised.

It is the objective of `casswarm.formation.objective`, which is faster for few members.
"""

from __future__ import annotations

EVALUATE = """
@vectorized_objective
def evaluate(x, p, constants, gradient, scratch):
    collides = {collides}
    n = x.size // 2
    radars = int(constants[0])
    parameters = {parameters}
    dt = p[6 * n + 2]
    east, north = scratch[:n], scratch[n : 2 * n]
    densities, collisions = scratch[2 * n : 3 * n], scratch[3 * n : 4 * n]
    gradient_east, gradient_north = scratch[4 * n : 5 * n], scratch[5 * n : 6 * n]
    members, pairs = scratch[6 * n : 7 * n], scratch[7 * n :]
    own_density = density(0.0, parameters)[0]
    living, first = 0, 0
    for weighted in range(2):  # the members without a weight, and then from `first` on those with
        first = living
        for i in range(n):
            if p[4 * n + i] != 0.0 and (p[5 * n + i] != 0.0) == (weighted == 1):
                members[living] = i
                east[living] = p[2 * i] + dt * x[2 * i]
                north[living] = p[2 * i + 1] + dt * x[2 * i + 1]
                densities[living], collisions[living] = own_density, 0.0
                living += 1
    start = 0
    for i in range(first, living):
        east_i, north_i, total = east[i], north[i], 0.0
        slopes = pairs[start : start + i]
        for j in range(i):
            de, dn = east_i - east[j], north_i - north[j]
            value, slopes[j] = density(de * de + dn * dn, parameters)
            total += value
            densities[j] += value
        densities[i] += total
        start += i
        if collides:
            total = 0.0
            slopes = pairs[start : start + i]
            for j in range(i):
                de, dn = east_i - east[j], north_i - north[j]
                value, slopes[j] = collision(de * de + dn * dn, parameters)
                total += value
                collisions[j] += value
            collisions[i] += total
            start += i
    objective = 0.0
    for k in range(first):
        densities[k], collisions[k] = 0.0, 0.0
        gradient_east[k], gradient_north[k] = 0.0, 0.0
    for k in range(first, living):
        weight = p[5 * n + int(members[k])]
        risk, risk_east, risk_north = 0.0, 0.0, 0.0
        for r in range(1, 1 + 3 * radars, 3):
            de, dn, strength = east[k] - constants[r], north[k] - constants[r + 1], constants[r + 2]
            value, slope = source(de * de + dn * dn, parameters)
            risk += strength * value
            risk_east += strength * slope * de
            risk_north += strength * slope * dn
        rate, by_risk, by_density, by_collision = combine(
            risk, densities[k], collisions[k], parameters
        )
        objective += weight * rate
        factor = 2.0 * dt * weight
        gradient_east[k] = factor * by_risk * risk_east
        gradient_north[k] = factor * by_risk * risk_north
        densities[k], collisions[k] = factor * by_density, factor * by_collision
    start = 0
    for i in range(first, living):
        east_i, north_i, own = east[i], north[i], densities[i]
        slopes = pairs[start : start + i]
        for j in range(i):
            slopes[j] *= own + densities[j]
        start += i
        if collides:
            own = collisions[i]
            collision_slopes = pairs[start : start + i]
            for j in range(i):
                slopes[j] += (own + collisions[j]) * collision_slopes[j]
            start += i
        total_east, total_north = 0.0, 0.0
        for j in range(i):
            de, dn = slopes[j] * (east_i - east[j]), slopes[j] * (north_i - north[j])
            total_east += de
            total_north += dn
            gradient_east[j] -= de
            gradient_north[j] -= dn
        gradient_east[i] += total_east
        gradient_north[i] += total_north
    for c in range(2 * n):
        gradient[c] = 0.0
    for k in range(living):
        i = int(members[k])
        gradient[2 * i], gradient[2 * i + 1] = gradient_east[k], gradient_north[k]
    if gradient.size == 5 * n:
        hessian_blocks(first, living, p, constants, parameters, scratch, gradient[2 * n :])
    return objective
"""
"""Objective of `x` (2n,) and its gradient, for positions, alive and weights in `p`.

Where `gradient` has 5n entries, the Hessian's diagonal blocks follow, as `CompiledObjective` says.

Every pair of members is evaluated once. `scratch` (n (n + 8),) is overwritten. Text, because the
kernels that it calls are generated: compiled in one module with them, they are inlined.

The living are copied to vectors of their coordinates, so that the loops over pairs are vectorised:
their indices begin at zero, they have no branches, and each reads and writes few arrays (the
compiler must check that these do not overlap).
"""
