"""The formation of one step: where the members go around the guide's next point.

The paper's section IV.B, both of its problems as one program with weights:

    minimise    sum over i of w_i lambda_i(X + dt v, alive)
    over        v in R^(2n)
    subject to  -v_max <= v_i <= v_max
                ||v_i - V_i(t-1)||^2 <= a_max                equation (5)
                ||X_i + dt v_i - X*(t+1)||^2 <= rho          equation (7), where wished

- **Leader protection** (6): w is 1 for the leader and 0 for the others; the leader's velocity is
  fixed, dt v_i = X*(t+1) - X_i or as near to it as v_max and a_max allow; no corridor.
- **Constrained trajectory** (7): w is 1 for the living; everybody has the corridor.

Per member the constraint set is a box and one or two discs in the plane, so the set of a state is
a product, `PlanarSets` of n members. It can be empty, which the paper does not say. v_max and a_max
are physical and always hold; a member that cannot reach its corridor goes as near to it as they
allow, and is counted (`Formation.infeasible`). The destroyed stay where they fell.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from ..hazard import Hazard, KernelHazard
from ..optimization.feasible_sets.planar import PlanarSets
from ..optimization.problem import Instances, Nlp
from ..typing import BoolArray, FloatArray
from .formation_kernels import formation_objective

if TYPE_CHECKING:
    from ..scenario import Scenario

SHORTFALL = 1e-6
"""Distance, in steps of v_max dt, up to which a member counts as in its place."""

_UNROLL = 8  # members up to which scalar expressions are faster


@lru_cache(maxsize=16)
def formation_nlp(hazard: Hazard, n: int, corridor: bool) -> Nlp:
    """The program above for n members, with the corridor's constraints or without."""
    v = ca.MX.sym("velocities", 2, n)
    X, previous_velocities = ca.MX.sym("positions", 2, n), ca.MX.sym("previous_velocities", 2, n)
    alive, weights = ca.MX.sym("alive", 1, n), ca.MX.sym("weights", 1, n)
    goal, dt = ca.MX.sym("goal", 2), ca.MX.sym("dt")
    following = X + dt * v
    constraints = {"acceleration": ca.sum1((v - previous_velocities) ** 2)}
    if corridor:
        constraints["corridor"] = ca.sum1((following - ca.repmat(goal, 1, n)) ** 2)
    return Nlp(
        name=f"formation[{n}{', corridor' if corridor else ''}]",
        variables={"velocities": v},
        parameters={
            "positions": X,
            "previous_velocities": previous_velocities,
            "alive": alive,
            "weights": weights,
            "goal": goal,
            "dt": dt,
        },
        objective=ca.dot(weights, hazard.expression(following, alive)),
        constraints=constraints,
        unroll=n <= _UNROLL,
        compiled=formation_objective(hazard),
        n_starts=_starts(hazard, corridor),
    )


def _starts(hazard: Hazard, corridor: bool) -> int:
    """How many starts find the best of the local minima that collisions make, almost always."""
    if isinstance(hazard, KernelHazard) and not hazard.collides:
        return 1
    return 4 if corridor else 2


@dataclass(frozen=True)
class Motion:
    """What limits a member's step.

    Parameters
    ----------
    v_max : float
        Bound on each velocity component.
    a_max : float
        Bound on ||V(t) - V(t-1)||^2.
    dt : float
    """

    v_max: float
    a_max: float
    dt: float

    def sets(self, previous_velocities: FloatArray) -> PlanarSets:
        """Velocities (..., 2) that the limits allow after `previous_velocities` (..., 2)."""
        return PlanarSets(
            np.full(2, -self.v_max),
            np.full(2, self.v_max),
            previous_velocities[..., None, :],
            np.full(1, np.sqrt(self.a_max)),
        )

    def toward(
        self, positions: FloatArray, previous_velocities: FloatArray, goals: FloatArray
    ) -> FloatArray:
        """Velocities (..., 2) that bring positions (..., 2) as near to goals as is allowed.

        Equation (6)'s v_i = X* - X_i where the limits allow it, and its projection where not.
        """
        return self.sets(previous_velocities).project((goals - positions) / self.dt)

    def misses(self, positions: FloatArray, velocities: FloatArray, goals: FloatArray) -> BoolArray:
        """Whether the step (..., 2) ends elsewhere than at the goals, shape (...)."""
        missed = positions + self.dt * velocities - goals
        distance = np.hypot(missed[..., 0], missed[..., 1])
        return np.asarray(distance > SHORTFALL * self.v_max * self.dt)


def motion_of(scenario: Scenario) -> Motion:
    """The members' physical limits."""
    return Motion(scenario.swarm.v_max, scenario.swarm.a_max, scenario.time.dt)


@dataclass(frozen=True, eq=False)
class Step:
    """The data of a step t -> t + 1, for a batch of B states.

    Parameters
    ----------
    hazard : Hazard
    motion : Motion
    positions, previous_velocities : (B, n, 2)
        X(t) and V(t-1).
    alive : (B, n) bool
    goal : (2,) or (B, 2)
        X*(t+1), for all states or for each.
    """

    hazard: Hazard
    motion: Motion
    positions: FloatArray
    previous_velocities: FloatArray
    alive: BoolArray
    goal: FloatArray


@dataclass(frozen=True, eq=False)
class Formation:
    """A batch of B formation problems, ready to be solved.

    Parameters
    ----------
    nlp : Nlp
    instances : Instances
        B instances; members whose velocity is given have a box of zero width.
    free : (B, n) bool
        Whose velocity is to be found.
    infeasible : (B, n) bool
        Who cannot fulfil its wish (the leader's place, the corridor) within the physical limits.
    fallback : (B, n, 2)
        Allowed velocities nearest to the previous ones, for when a solver fails.
    """

    nlp: Nlp
    instances: Instances
    free: BoolArray
    infeasible: BoolArray
    fallback: FloatArray


def leader_formation(step: Step, leaders: NDArray[np.intp]) -> Formation:
    """Leader protection, problem (6); `leaders` (B,) are the indices of living members."""
    leads = np.arange(step.alive.shape[1]) == leaders[:, None]
    sets = step.motion.sets(step.previous_velocities)
    positions = step.positions[leads]
    velocity = step.motion.toward(positions, step.previous_velocities[leads], step.goal)
    given = np.zeros_like(step.positions)
    given[leads] = velocity
    infeasible = np.zeros_like(step.alive)
    infeasible[leads] = step.motion.misses(positions, velocity, step.goal)
    infeasible &= step.alive  # where nobody is alive, nobody falls short
    guess = None
    if isinstance(step.hazard, KernelHazard) and step.hazard.gathers:
        # solved in closed form: the nearer to the leader the better, every follower on its own
        following = positions + step.motion.dt * velocity
        guess = (following[:, None] - step.positions) / step.motion.dt
    return _formation(step, sets, leads, step.alive & ~leads, given, infeasible, guess)


def corridor_formation(
    step: Step, rho: float, pathfinders: NDArray[np.intp] | None = None
) -> Formation:
    """Constrained trajectory, problem (7); `rho` bounds the squared distance to the goal.

    `pathfinders` (B,) are the indices of members who fly to the goal itself, if there are any.
    """
    physical = step.motion.sets(step.previous_velocities)
    to_goal = (np.atleast_2d(step.goal)[:, None] - step.positions) / step.motion.dt
    wishes = PlanarSets(
        physical.lower,
        physical.upper,
        np.stack([step.previous_velocities, to_goal], axis=-2),
        np.sqrt([step.motion.a_max, rho]) / [1.0, step.motion.dt],
    )
    sets, unmet = wishes.fulfil()
    free, given = step.alive & ~unmet, sets.lower
    if pathfinders is not None:
        first = np.arange(step.alive.shape[1]) == pathfinders[:, None]
        free &= ~first
        given = np.where(first[..., None], physical.project(to_goal), given)
    return _formation(step, sets, step.alive, free, given, step.alive & unmet)


def _formation(
    step: Step,
    sets: PlanarSets,
    weights: BoolArray,
    free: BoolArray,
    given: FloatArray,
    infeasible: BoolArray,
    guess: FloatArray | None = None,
) -> Formation:
    """Formation in which the living who are not free have the velocities `given` (B, n, 2).

    The solve starts from the point of the sets nearest to `guess` (B, n, 2), by default to the
    previous velocities.
    """
    nlp = formation_nlp(step.hazard, step.alive.shape[1], sets.radii.shape[-1] == 2)
    fixed = np.where(step.alive[..., None], given, 0.0)
    lower = np.where(free[..., None], sets.lower, fixed)
    upper = np.where(free[..., None], sets.upper, fixed)
    radii = np.where(free[..., None], sets.radii, np.inf)
    sets = PlanarSets(lower, upper, sets.centers, radii)
    fallback = sets.project(step.previous_velocities)
    squared = (
        radii * [1.0, step.motion.dt][: radii.shape[-1]]
    ) ** 2  # as the constraints state them
    instances = Instances(
        x0=nlp.pack_variables(velocities=fallback if guess is None else sets.project(guess)),
        p=nlp.pack_parameters(
            positions=step.positions,
            previous_velocities=step.previous_velocities,
            alive=step.alive[..., None],
            weights=weights[..., None],
            goal=step.goal[None] if step.goal.ndim == 1 else step.goal[:, None],
            dt=[[step.motion.dt]],
        ),
        lbx=nlp.pack_variables(velocities=lower),
        ubx=nlp.pack_variables(velocities=upper),
        lbg=np.full((len(free), nlp.sizes[2]), -np.inf),
        ubg=nlp.pack_constraints(
            **{name: squared[..., k, None] for k, name in enumerate(nlp.constraints)}
        ),
        feasible_set=sets,
        scale=_units(step, weights),
    )
    return Formation(nlp, instances, free, infeasible, fallback)


def _units(step: Step, weights: BoolArray) -> FloatArray:
    """v_max, and what the members with a weight would risk alone where they are, (B, 2)."""
    alone = (weights * step.hazard.single_agent_rates(step.positions)).sum(axis=1)
    return np.stack([np.full(len(alone), step.motion.v_max), np.where(alone > 0, alone, 1.0)], 1)
