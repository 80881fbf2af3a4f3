"""Formation of the next step, or of the next H: velocities around the guide's next points.

The paper's section IV.B, both of its problems as one program with weights and a horizon:

    minimise    sum over s = 1..H, i of w_i lambda_i(X + dt u_s, alive)
    over        displacements u_1, ..., u_H in R^(2n),  v_s = u_s - u_{s-1},  u_0 = 0
    subject to  -v_max <= v_{s,i} <= v_max
                ||v_{s,i}||^2 <= v_max^2                    if the speed has this limit, too
                ||v_{s,i} - v_{s-1,i}||^2 <= a_max,  v_0 = V(t-1)   equation (5)
                ||X_i + dt u_{s,i} - X*(t+s)||^2 <= r_{s,i}^2       equation (7), with a corridor

Displacements are in units of dt, and v_1 = u_1 is applied. The paper has H = 1; with more steps
this is model predictive control, see ``docs/mpc.md``.

- **Leader protection** (6): w is 1 for the leader; the leader's velocity is fixed,
  dt v_i = X*(t+1) - X_i or as close to it as v_max and a_max allow; no corridor. For the others w
  is 0 where this determines their velocities, without collisions, and `FOLLOWER_WEIGHT` elsewhere.
- **Constrained trajectory** (7): w is 1 for the living; every member has the corridor, r^2 = rho.

For one step, the set of a member is a box and one to three discs in the plane, that of a state
their product, `PlanarSets`. It can be empty, which the paper does not say. So the corridor and the
leader's position are soft constraints: a member that cannot meet its own comes as close to it as
v_max and a_max allow, and counts as infeasible. The destroyed do not move.
"""

from __future__ import annotations

from itertools import pairwise

import casadi as ca

from .._util.threads import locked_cache
from ..hazard import Hazard
from ..nlp.program import Nlp


@locked_cache(maxsize=32)
def formation_nlp(
    hazard: Hazard,
    n: int,
    corridor: bool,
    horizon: int = 1,
    later: tuple[Hazard, ...] = (),
    disc: bool = False,
) -> Nlp:
    """The program above for n members and H = `horizon`, with or without the corridor.

    `later` are the hazards of the steps after the first, where they have others; with a `disc`, the
    speed is limited in every direction.
    The variables are displacements, a column for every step and member: (2, H n). Constraints are
    in units of v_max, of a step and of a velocity, so that tolerances do not depend on units.
    """
    hazards = [hazard, *(later or [hazard] * (horizon - 1))]
    u = ca.MX.sym("displacements", 2, horizon * n)
    shapes = {
        "positions": (2, n),
        "previous_velocities": (2, n),
        "alive": (1, n),
        "weights": (1, n),
        "goal": (2, 1),
        "dt": (1, 1),
        "v_max": (1, 1),
        "later": (2, horizon - 1),
    }
    parameters = {name: ca.MX.sym(name, *shape) for name, shape in shapes.items() if all(shape)}
    X, previous_velocities, alive, weights, goal, dt, v_max, *goals = parameters.values()
    displacements = ca.horzsplit(u, n)
    positions = [X + dt * each for each in displacements]
    velocities = [b - a for a, b in pairwise([ca.MX.zeros(2, n), *displacements])]
    changes = [b - a for a, b in pairwise([previous_velocities, *velocities])]
    squares = [ca.sum1((change / v_max) ** 2) for change in changes]
    constraints = {"acceleration": ca.horzcat(*squares)}
    if horizon > 1:  # the first step's velocity is a variable, and has bounds
        constraints["speed"] = ca.horzcat(*velocities[1:]) / v_max
    if corridor:
        offsets = ca.horzcat(*positions) - ca.kron(ca.horzcat(goal, *goals), ca.DM.ones(1, n))
        constraints["corridor"] = ca.sum1((offsets / (v_max * dt)) ** 2)
    if disc:
        constraints["speed_norm"] = ca.horzcat(
            *(ca.sum1((velocity / v_max) ** 2) for velocity in velocities)
        )
    size = f"formation[{n}" if horizon == 1 else f"mpc-formation[{horizon} x {n}"
    return Nlp(
        name=f"{size}{', corridor' if corridor else ''}{', disc' if disc else ''}]",
        variables={"displacements": u},
        parameters=parameters,
        objective=sum(
            ca.dot(weights, each.expression(x, alive))
            for each, x in zip(hazards, positions, strict=True)
        ),
        constraints=constraints,
        unroll=horizon * n <= (8 if horizon == 1 else 24),  # where scalar expressions are faster
    )
