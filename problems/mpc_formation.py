"""Formation of the next H steps: model predictive control along the guide.

The one-step problem of `casswarm.problems.formation` over a horizon of H steps, with v_max and
a_max at every step and the living members held fixed:

    minimise    sum over s = 1..H, i of w_i lambda_i(X + dt u_s, alive)
    over        displacements u_1, ..., u_H in R^(2n),  v_s = u_s - u_{s-1},  u_0 = 0
    subject to  -v_max <= v_{s,i} <= v_max
                ||v_{s,i} - v_{s-1,i}||^2 <= a_max,             v_0 = V(t-1)
                ||X_i + dt u_{s,i} - X*(t+s)||^2 <= r_{s,i}^2   if there is a corridor

Displacements are in units of dt. Only v_1 is applied; the next step solves again. With H = 1 it is
the one-step program itself. The horizon ends with the guide's arrival: there is nothing to follow
beyond it.

**Soft constraints.** v_max and a_max are hard constraints, which can be met over every horizon. The
leader's position and the corridor are soft constraints over the whole horizon. They take precedence
over the rates, as convex least-squares problems, member by member:

- **Leader protection**: the leader's path minimises sum over s of ||X + dt u_s - X*(t+s)||^2 within
  its limits; it is prescribed in the problem above, whose w is 1 for the leader and 0 for the
  others.
- **Constrained trajectory**: w is 1 for the living, and every member's path that minimises the sum
  of its squared distances e_s^2 to the corridors of radius sqrt(rho) - s m shows how close it can
  come. The corridor of step s is then

      r_s = sqrt(rho) - (s - 1) m + e_s,   m = 1e-4 sqrt(rho):

  the paper's for the applied step, slightly narrower for later ones, so that this horizon's plan
  is feasible in the next one, and wider by e_s where it cannot be met.

With H = 1 both are the paper's problem with the one-step rule for empty sets: as close as the
limits allow (for the corridor up to m).
"""

from __future__ import annotations

from functools import lru_cache

import casadi as ca

from ..hazard import Hazard, KernelHazard
from ..optimization.problem import Nlp
from .formation_kernels import formation_objective

_UNROLL = 24  # largest members times steps for which scalar expressions are faster
_STARTS = 4  # where collisions create local minima


@lru_cache(maxsize=32)
def mpc_formation_nlp(hazard: Hazard, n: int, horizon: int, corridor: bool) -> Nlp:
    """The program above for n members and H = `horizon`, with or without the corridor.

    The variables are displacements, a column for every step and member: (2, H n).
    """
    u = ca.MX.sym("displacements", 2, horizon * n)
    X, previous_velocities = ca.MX.sym("positions", 2, n), ca.MX.sym("previous_velocities", 2, n)
    alive, weights = ca.MX.sym("alive", 1, n), ca.MX.sym("weights", 1, n)
    goal, dt = ca.MX.sym("goal", 2), ca.MX.sym("dt")
    later = ca.MX.sym("later", 2, max(1, horizon - 1))
    goals = [goal, *ca.horzsplit(later)]
    parameters = {
        "positions": X,
        "previous_velocities": previous_velocities,
        "alive": alive,
        "weights": weights,
        "goal": goal,
        "dt": dt,
    }
    objective = ca.MX(0)
    velocities, changes, offsets = [], [], []  # of every step; the last two squared
    velocity, displacement = previous_velocities, ca.MX.zeros(2, n)
    for s in range(horizon):
        following = X + dt * u[:, s * n : (s + 1) * n]
        objective += ca.dot(weights, hazard.expression(following, alive))
        velocities.append(u[:, s * n : (s + 1) * n] - displacement)
        changes.append(ca.sum1((velocities[-1] - velocity) ** 2))
        offsets.append(ca.sum1((following - ca.repmat(goals[s], 1, n)) ** 2))
        velocity, displacement = velocities[-1], u[:, s * n : (s + 1) * n]
    constraints = {"acceleration": ca.horzcat(*changes)}
    if horizon > 1:  # the first step's velocity is a variable, and has bounds
        parameters["later"] = later
        constraints["speed"] = ca.horzcat(*velocities[1:])
    if corridor:
        constraints["corridor"] = ca.horzcat(*offsets)
    return Nlp(
        name=f"mpc-formation[{horizon} x {n}{', corridor' if corridor else ''}]",
        variables={"displacements": u},
        parameters=parameters,
        objective=objective,
        constraints=constraints,
        unroll=n * horizon <= _UNROLL,
        compiled=formation_objective(hazard),
        n_starts=_STARTS if not isinstance(hazard, KernelHazard) or hazard.collides else 1,
    )
