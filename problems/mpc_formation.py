"""The formation of the next H steps: look-ahead along the guide, for a receding horizon.

The one-step problem of `casswarm.problems.formation` over a window of H steps, with v_max and a_max
from step to step and the living as they are now:

    minimise    sum over s = 1..H, i of w_i lambda_i(X + dt u_s, alive)
    over        advances u_1, ..., u_H in R^(2n),  v_s = u_s - u_{s-1},  u_0 = 0
    subject to  -v_max <= v_{s,i} <= v_max
                ||v_{s,i} - v_{s-1,i}||^2 <= a_max,             v_0 = V(t-1)
                ||X_i + dt u_{s,i} - X*(t+s)||^2 <= r_{s,i}^2   where a corridor is wished

Only v_1 is flown; the next step asks again. With H = 1 it is the one-step program itself. The
window ends with the guide: beyond its arrival there is nothing to follow.

**Wishes.** v_max and a_max hold always, and leave room in every window. The leader's place and the
corridor are wishes over the whole window, and cannot always be fulfilled. They come first, before
the rates, as convex least squares, member by member (`casswarm.optimization.feasible_sets.trajectory.Limits.following`):

- **Leader protection**: the leader's path minimises sum over s of ||X + dt u_s - X*(t+s)||^2 within
  its limits; it is given in the problem above, whose w is 1 for the leader and 0 for the others.
- **Constrained trajectory**: w is 1 for the living, and every member's path that minimises the sum
  of its squared distances e_s^2 to the corridors of radius sqrt(rho) - s m shows how near it can
  come. The corridor of step s is then

      r_s = sqrt(rho) - (s - 1) m + e_s,   m = 1e-4 sqrt(rho):

  the paper's for the step that is flown, a little narrower for later ones, so that this window's
  plan fits into the next window, and as much wider as it must be (e_s) where it cannot be met.

With H = 1 both are the paper's problem with the one-step code's rule for empty sets: as near as the
limits allow (for the corridor up to m).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import casadi as ca
import numpy as np

from ..hazard import Hazard, KernelHazard
from ..optimization.feasible_sets.planar import PlanarSets
from ..optimization.feasible_sets.trajectory import Limits
from ..optimization.problem import Instances, Nlp
from ..typing import BoolArray, FloatArray, IntArray
from .formation import SHORTFALL, Motion
from .formation_kernels import formation_objective

_UNROLL = 24  # members times steps up to which scalar expressions are faster
_STARTS = 4  # where members endanger each other, which makes local minima


@lru_cache(maxsize=32)
def lookahead_nlp(hazard: Hazard, n: int, steps: int, corridor: bool) -> Nlp:
    """The program above for n members and H = `steps`, with the corridor or without.

    The variables are advances, a column a member, step by step: (2, H n).
    """
    u = ca.MX.sym("advances", 2, steps * n)
    X, previous_velocities = ca.MX.sym("positions", 2, n), ca.MX.sym("previous_velocities", 2, n)
    alive, weights = ca.MX.sym("alive", 1, n), ca.MX.sym("weights", 1, n)
    goal, dt = ca.MX.sym("goal", 2), ca.MX.sym("dt")
    later = ca.MX.sym("later", 2, max(1, steps - 1))
    goals = [goal, *ca.horzsplit(later)]
    parameters = {
        "positions": X,
        "previous_velocities": previous_velocities,
        "alive": alive,
        "weights": weights,
        "goal": goal,
        "dt": dt,
    }
    objective, speeds, turns, off = ca.MX(0), [], [], []
    velocity, place = previous_velocities, ca.MX.zeros(2, n)
    for s in range(steps):
        advance = u[:, s * n : (s + 1) * n]
        following = X + dt * advance
        objective += ca.dot(weights, hazard.expression(following, alive))
        speeds.append(advance - place)
        turns.append(ca.sum1((speeds[-1] - velocity) ** 2))
        off.append(ca.sum1((following - ca.repmat(goals[s], 1, n)) ** 2))
        velocity, place = speeds[-1], advance
    constraints = {"acceleration": ca.horzcat(*turns)}
    if steps > 1:  # the first step's velocity is a variable, and has bounds
        parameters["later"] = later
        constraints["speed"] = ca.horzcat(*speeds[1:])
    if corridor:
        constraints["corridor"] = ca.horzcat(*off)
    return Nlp(
        name=f"look-ahead[{steps} x {n}{', corridor' if corridor else ''}]",
        variables={"advances": u},
        parameters=parameters,
        objective=objective,
        constraints=constraints,
        unroll=n * steps <= _UNROLL,
        compiled=formation_objective(hazard),
        n_starts=_STARTS if not isinstance(hazard, KernelHazard) or hazard.collides else 1,
    )


@dataclass(frozen=True, eq=False)
class Window:
    """The data of the steps t -> t + H, for a batch of B states.

    Parameters
    ----------
    hazard : Hazard
    motion : Motion
    positions, previous_velocities : (B, n, 2)
        X(t) and V(t-1).
    alive : (B, n) bool
        Held fixed over the window.
    goals : (H, 2)
        X*(t+1), ..., X*(t+H).
    """

    hazard: Hazard
    motion: Motion
    positions: FloatArray
    previous_velocities: FloatArray
    alive: BoolArray
    goals: FloatArray

    @property
    def limits(self) -> Limits:
        """Of every member's path."""
        return Limits(self.motion.v_max, float(np.sqrt(self.motion.a_max)))

    @property
    def steps(self) -> int:
        """H."""
        return len(self.goals)

    @property
    def targets(self) -> FloatArray:
        """The goals as advances of every member, (B, n, H, 2)."""
        away = self.goals - self.positions[:, :, None]
        return np.asarray(away / self.motion.dt)


@dataclass(frozen=True, eq=False)
class MpcFormation:
    """A batch of B look-ahead problems, ready to be solved.

    Parameters
    ----------
    nlp : Nlp
    instances : Instances
        B instances, `paths` among them.
    free : (B, n) bool
        Whose paths are to be found.
    first : PlanarSets, shape (B, n)
        What the velocities to be flown keep to: the limits, and the corridor as `instances` has it.
    wished : (B, n) bool
        Who has a wish for the next step.
    radius : float
        How near to the goal it is fulfilled; 0 for a place.
    failures : (B,) int
        1 where a member's nearest path was not found, and the greedy one is given instead.
    fallback : (B, n, 2)
        Allowed velocities, for when a solver fails.
    """

    nlp: Nlp
    instances: Instances
    free: BoolArray
    first: PlanarSets
    wished: BoolArray
    radius: float
    failures: IntArray
    fallback: FloatArray

    def infeasible(self, window: Window, velocities: FloatArray) -> BoolArray:
        """Who, by velocities (B, n, 2), ends elsewhere than the next step's wish has it, (B, n)."""
        away = window.positions + window.motion.dt * velocities - window.goals[0]
        allowed = self.radius + SHORTFALL * window.motion.v_max * window.motion.dt
        return np.asarray(self.wished & (np.hypot(away[..., 0], away[..., 1]) > allowed))
