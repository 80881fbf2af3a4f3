"""Formation of the next step, or of the next H: velocities around the guide's next points.

The paper's section IV.B, both of its problems as one program with weights and a horizon:

    minimise    sum over s = 1..H, i of w_i lambda_i(X + dt u_s, alive)
    over        displacements u_1, ..., u_H in R^(2n),  v_s = u_s - u_{s-1},  u_0 = 0
    subject to  -v_max <= v_{s,i} <= v_max
                ||v_{s,i} - v_{s-1,i}||^2 <= a_max,  v_0 = V(t-1)   equation (5)
                ||X_i + dt u_{s,i} - X*(t+s)||^2 <= r_{s,i}^2       equation (7), with a corridor

Displacements are in units of dt, and v_1 = u_1 is applied. The paper has H = 1; with more steps
this is model predictive control, see ``docs/mpc.md``.

- **Leader protection** (6): w is 1 for the leader; the leader's velocity is fixed,
  dt v_i = X*(t+1) - X_i or as close to it as v_max and a_max allow; no corridor. For the others w
  is 0 where this determines their velocities, without collisions, and `FOLLOWER_WEIGHT` elsewhere.
- **Constrained trajectory** (7): w is 1 for the living; every member has the corridor, r^2 = rho.

For one step, the set of a member is a box and one or two discs in the plane, and that of a state
their product, `PlanarSets`. It can be empty, which the paper does not say. So the corridor and the
leader's position are soft constraints: a member that cannot meet its own comes as close to it as
v_max and a_max allow, and counts as infeasible. The destroyed do not move.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from .._util.threads import locked_cache
from ..hazard import Hazard, KernelHazard
from ..optimization.feasible_sets.planar import PlanarSets
from ..optimization.problem import Instances, Nlp
from ..typing import BoolArray, FloatArray, IntArray
from .formation_kernels import formation_objective
from .step import Step

FOLLOWER_WEIGHT = 0.01
"""Weight of the other members' rates in leader protection, where members collide.

The leader's rate depends on distances to the leader alone. Without collisions it increases with
each, and determines the formation. With collisions it is least at some distance, in any direction:
among the minimisers, the one of least total rate is wanted. This weight selects it."""


@locked_cache(maxsize=32)
def formation_nlp(hazard: Hazard, n: int, corridor: bool, horizon: int = 1) -> Nlp:
    """The program above for n members and H = `horizon`, with or without the corridor.

    The variables are displacements, a column for every step and member: (2, H n). Constraints are
    in units of v_max, of a step and of a velocity, so that tolerances do not depend on units.
    """
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
    X, previous_velocities, alive, weights, goal, dt, v_max, *later = parameters.values()
    displacements = ca.horzsplit(u, n)
    positions = [X + dt * each for each in displacements]
    velocities = [b - a for a, b in pairwise([ca.MX.zeros(2, n), *displacements])]
    changes = [b - a for a, b in pairwise([previous_velocities, *velocities])]
    squares = [ca.sum1((change / v_max) ** 2) for change in changes]
    constraints = {"acceleration": ca.horzcat(*squares)}
    if horizon > 1:  # the first step's velocity is a variable, and has bounds
        constraints["speed"] = ca.horzcat(*velocities[1:]) / v_max
    if corridor:
        offsets = ca.horzcat(*positions) - ca.kron(ca.horzcat(goal, *later), ca.DM.ones(1, n))
        constraints["corridor"] = ca.sum1((offsets / (v_max * dt)) ** 2)
    size = f"formation[{n}" if horizon == 1 else f"mpc-formation[{horizon} x {n}"
    return Nlp(
        name=f"{size}{', corridor' if corridor else ''}]",
        variables={"displacements": u},
        parameters=parameters,
        objective=sum(ca.dot(weights, hazard.expression(x, alive)) for x in positions),
        constraints=constraints,
        unroll=horizon * n <= (8 if horizon == 1 else 24),  # where scalar expressions are faster
        compiled=formation_objective(hazard, n),
        n_starts=1 if isinstance(hazard, KernelHazard) and not hazard.collides else 4,
    )


@dataclass(frozen=True, eq=False)
class Formation:
    """A batch of B formation problems, ready to be solved.

    Parameters
    ----------
    nlp : Nlp
    instances : Instances
        B instances; members whose velocity is prescribed have a box of zero width.
    free : (B, n) bool
        Members whose velocity is optimised.
    sets : PlanarSets, shape (B, n)
        Sets of the velocities of the first step.
    fallback : (B, n, 2)
        Allowed velocities to apply if a solver fails.
    infeasible : (B, n) bool
        Members that cannot meet their soft constraint within the hard constraints.
    tracked : (B, n) bool, optional
        Members of whom the applied velocity shows whether they meet it.
    radius : float
        Distance from the goal within which tracked members meet it.
    failures : (B,) int, optional
        1 where building the problem failed and an approximation is used.
    """

    nlp: Nlp
    instances: Instances
    free: BoolArray
    sets: PlanarSets
    fallback: FloatArray
    infeasible: BoolArray
    tracked: BoolArray | None = None
    radius: float = 0.0
    failures: IntArray | None = None


def leader_formation(step: Step, leaders: NDArray[np.intp]) -> Formation:
    """Leader protection, problem (6); `leaders` (B,) are the indices of living members."""
    leads = np.arange(step.alive.shape[1]) == leaders[:, None]
    sets = step.motion.sets(step.previous_velocities)
    positions, goal = step.positions[leads], step.goal[:, 0]
    velocity = step.motion.toward(positions, step.previous_velocities[leads], goal)
    prescribed = np.zeros_like(step.positions)
    prescribed[leads] = velocity
    infeasible = np.zeros_like(step.alive)
    infeasible[leads] = step.motion.misses(positions, velocity, goal)
    infeasible &= step.alive  # where no member is alive, none is infeasible
    guess = None
    if isinstance(step.hazard, KernelHazard) and step.hazard.gathers:
        # closed form: the closer to the leader the better, for every follower independently
        following = positions + step.motion.dt * velocity
        guess = (following[:, None] - step.positions) / step.motion.dt
    followers = step.alive & ~leads
    weights = leader_weights(step, leads)
    return _formation(step, sets, weights, followers, prescribed, infeasible, guess)


def leader_weights(step: Step, leads: BoolArray) -> FloatArray:
    """Weights (B, n) of the members' rates in leader protection, for leaders (B, n)."""
    gathers = isinstance(step.hazard, KernelHazard) and step.hazard.gathers
    return np.where(leads, 1.0, 0.0 if gathers else FOLLOWER_WEIGHT) * step.alive


def corridor_formation(
    step: Step, rho: float, lead_agents: NDArray[np.intp] | None = None
) -> Formation:
    """Constrained trajectory, problem (7); `rho` bounds the squared distance to the goal.

    `lead_agents` (B,), if given, are the indices of members that move to the goal itself.
    """
    hard = step.motion.sets(step.previous_velocities)
    to_goal = (step.goal - step.positions) / step.motion.dt
    corridor = PlanarSets(
        hard.lower,
        hard.upper,
        np.stack([step.previous_velocities, to_goal], axis=-2),
        np.sqrt([step.motion.a_max, rho]) / [1.0, step.motion.dt],
    )
    sets, infeasible = corridor.relax_infeasible()
    free, prescribed = step.alive & ~infeasible, sets.lower
    if lead_agents is not None:
        leads = np.arange(step.alive.shape[1]) == lead_agents[:, None]
        free &= ~leads
        prescribed = np.where(leads[..., None], hard.project(to_goal), prescribed)
    weights = step.alive.astype(float)
    return _formation(step, sets, weights, free, prescribed, step.alive & infeasible)


def _formation(
    step: Step,
    sets: PlanarSets,
    weights: FloatArray,
    free: BoolArray,
    prescribed: FloatArray,
    infeasible: BoolArray,
    guess: FloatArray | None = None,
) -> Formation:
    """Formation in which living members that are not free have `prescribed` velocities (B, n, 2).

    The initial guess is the projection of `guess` (B, n, 2), by default of the previous velocities.
    """
    nlp = formation_nlp(step.hazard, step.alive.shape[1], sets.radii.shape[-1] == 2)
    fixed = np.where(step.alive[..., None], prescribed, 0.0)
    lower = np.where(free[..., None], sets.lower, fixed)
    upper = np.where(free[..., None], sets.upper, fixed)
    radii = np.where(free[..., None], sets.radii, np.inf)
    sets = PlanarSets(lower, upper, sets.centers, radii)
    fallback = sets.project(step.previous_velocities)
    squared = (radii / step.motion.v_max) ** 2  # the constraints bound squared distances
    instances = Instances(
        x0=nlp.pack_variables(displacements=fallback if guess is None else sets.project(guess)),
        p=nlp.pack_parameters(
            positions=step.positions,
            previous_velocities=step.previous_velocities,
            alive=step.alive[..., None],
            weights=weights[..., None],
            goal=step.goal,
            dt=step.motion.dt,
            v_max=step.motion.v_max,
        ),
        lbx=nlp.pack_variables(displacements=lower),
        ubx=nlp.pack_variables(displacements=upper),
        lbg=np.full((len(free), nlp.sizes[2]), -np.inf),
        ubg=np.moveaxis(squared, -1, 1).reshape(len(free), -1),  # in the order of `constraints`
        feasible_set=sets,
        scale=formation_scale(step, weights),
    )
    return Formation(nlp, instances, free, sets, fallback, infeasible)


def formation_scale(step: Step, weights: FloatArray) -> FloatArray:
    """Scales (B, 2): v_max, and the rate of isolated members at the present positions, H steps."""
    isolated = (weights * step.hazard.single_agent_rates(step.positions)).sum(axis=1)
    rates = step.horizon * np.where(isolated > 0, isolated, 1.0)
    return np.stack([np.full(len(isolated), step.motion.v_max), rates], 1)
