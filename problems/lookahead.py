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
the rates, as convex least squares, member by member (`casswarm.paths.Limits.following`):

- **Leader protection**: the leader's path minimises sum over s of ||X + dt u_s - X*(t+s)||^2 within
  its limits; it is given in the problem above, whose w is 1 for the leader and 0 for the others.
- **Constrained trajectory**: w is 1 for the living, and every member's path that minimises the sum
  of its squared distances e_s^2 to the corridors of radius sqrt(rho) - s m shows how near it can
  come. The corridor of step s is then

      r_s = sqrt(rho) - (s - 1) m + e_s,   m = `MARGIN` sqrt(rho):

  the paper's for the step that is flown, a little narrower for later ones, so that this window's
  plan fits into the next window, and as much wider as it must be (e_s) where it cannot be met.

With H = 1 both are the paper's problem with the one-step code's rule for empty sets: as near as the
limits allow (for the corridor up to m).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from ..arrays import Booleans, Counts, Floats
from ..hazard import Hazard, KernelHazard
from ..nlp import Instances, Nlp
from ..paths import Limits, PathSets, distances, part_within
from ..sets import PlanarSets
from .formation import SHORTFALL, Motion
from .formation_compiled import formation_objective

MARGIN = 1e-4
"""By how much a corridor is narrower for every step ahead, as a part of its radius."""

_UNROLL = 24  # members times steps up to which scalar expressions are faster
_STARTS = 4  # where members endanger each other, which makes local minima


@lru_cache(maxsize=32)
def lookahead_nlp(hazard: Hazard, n: int, steps: int, corridor: bool) -> Nlp:
    """The program above for n members and H = `steps`, with the corridor or without.

    The variables are advances, a column a member, step by step: (2, H n).
    """
    u = ca.MX.sym("advances", 2, steps * n)
    X, previous = ca.MX.sym("positions", 2, n), ca.MX.sym("previous", 2, n)
    alive, weights = ca.MX.sym("alive", 1, n), ca.MX.sym("weights", 1, n)
    goal, dt = ca.MX.sym("goal", 2), ca.MX.sym("dt")
    later = ca.MX.sym("later", 2, max(1, steps - 1))
    goals = [goal, *ca.horzsplit(later)]
    parameters = {
        "positions": X,
        "previous": previous,
        "alive": alive,
        "weights": weights,
        "goal": goal,
        "dt": dt,
    }
    objective, speeds, turns, off = ca.MX(0), [], [], []
    velocity, place = previous, ca.MX.zeros(2, n)
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
        starts=_STARTS if not isinstance(hazard, KernelHazard) or hazard.collides else 1,
    )


@dataclass(frozen=True, eq=False)
class Window:
    """The data of the steps t -> t + H, for a batch of B states.

    Parameters
    ----------
    hazard : Hazard
    motion : Motion
    positions, previous : (B, n, 2)
        X(t) and V(t-1).
    alive : (B, n) bool
        Held fixed over the window.
    goals : (H, 2)
        X*(t+1), ..., X*(t+H).
    """

    hazard: Hazard
    motion: Motion
    positions: Floats
    previous: Floats
    alive: Booleans
    goals: Floats

    @property
    def limits(self) -> Limits:
        """Of every member's path."""
        return Limits(self.motion.v_max, float(np.sqrt(self.motion.a_max)))

    @property
    def steps(self) -> int:
        """H."""
        return len(self.goals)

    @property
    def targets(self) -> Floats:
        """The goals as advances of every member, (B, n, H, 2)."""
        away = self.goals - self.positions[:, :, None]
        return np.asarray(away / self.motion.dt)


@dataclass(frozen=True, eq=False)
class LookAhead:
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
    free: Booleans
    first: PlanarSets
    wished: Booleans
    radius: float
    failures: Counts
    fallback: Floats

    def shortfalls(self, window: Window, velocities: Floats) -> Booleans:
        """Who, by velocities (B, n, 2), ends elsewhere than the next step's wish has it, (B, n)."""
        away = window.positions + window.motion.dt * velocities - window.goals[0]
        allowed = self.radius + SHORTFALL * window.motion.v_max * window.motion.dt
        return np.asarray(self.wished & (np.hypot(away[..., 0], away[..., 1]) > allowed))


def leader_ahead(window: Window, leaders: NDArray[np.intp]) -> LookAhead:
    """Leader protection over the window; `leaders` (B,) are the indices of living members."""
    batch, n = window.alive.shape
    rows = np.arange(batch)
    leads = (np.arange(n) == leaders[:, None]) & window.alive
    path, failed = window.limits.following(
        window.previous[rows, leaders], window.targets[rows, leaders], np.zeros(window.steps)
    )
    inside = window.limits.slowing(window.previous, window.steps)
    inside[rows, leaders] = path
    place = window.positions[rows, leaders][:, None] + window.motion.dt * path
    to_leader = (place[:, None] - window.positions[:, :, None]) / window.motion.dt
    free = window.alive & ~leads
    guess = inside.copy()
    guess[free] = window.limits.greedy(window.previous[free], to_leader[free])
    if isinstance(window.hazard, KernelHazard) and window.hazard.gathers:
        # nothing is better than to be with the leader all the time: who can, is done
        there = free & (distances(guess, to_leader) <= 1e-12 * window.limits.speed).all(axis=-1)
        inside[there], free = guess[there], free & ~there
    none = np.full((*window.alive.shape, window.steps), np.inf)
    first = _first(window, ~free, inside[:, :, 0], none[..., 0])
    return _problem(window, leads, free, leads, none, inside, guess, first, failed, 0.0)


def corridor_ahead(window: Window, rho: float) -> LookAhead:
    """Constrained trajectory over the window; `rho` is the paper's bound of the corridor."""
    radius = np.sqrt(rho) / window.motion.dt
    margin, living, targets = MARGIN * radius, window.alive, window.targets
    narrow = np.maximum(0.0, radius - margin * np.arange(1, window.steps + 1))
    slowing = window.limits.slowing(window.previous, window.steps)
    nearest, failed = slowing.copy(), np.zeros_like(living)
    nearest[living], failed[living] = window.limits.following(
        window.previous[living], targets[living], narrow
    )
    excess = np.maximum(0.0, distances(nearest, targets) - narrow)
    radii = np.where(living[..., None], narrow + margin + excess, np.inf)
    part = part_within(nearest, slowing, targets, radii)[..., None, None]
    inside = nearest + part * (slowing - nearest)
    # the step that is flown: the paper's corridor to the letter, where it can be met
    wide = np.where(excess[..., 0] > margin, radii[..., 0], radius)
    wide = np.where(living, wide, np.inf)
    nobody = np.zeros_like(living)
    first = _first(window, nobody, window.previous, wide)
    return _problem(
        window,
        living,
        living,
        living,
        radii,
        inside,
        nearest,
        first,
        np.asarray(failed.any(axis=1)),
        float(np.sqrt(rho)),
    )


def _first(window: Window, given: Booleans, velocities: Floats, radii: Floats) -> PlanarSets:
    """Sets of the velocities to be flown; those of `given` members, and of the dead, are points."""
    physical = window.motion.sets(window.previous)
    living = window.alive[..., None]
    known = np.where(
        living, physical.project(np.broadcast_to(velocities, window.previous.shape)), 0
    )
    free = living & ~given[..., None]
    to_goal = (window.goals[0] - window.positions) / window.motion.dt
    return PlanarSets(
        np.where(free, physical.lower, known),
        np.where(free, physical.upper, known),
        np.stack([window.previous, to_goal], axis=-2),
        np.where(
            free,
            np.stack([np.broadcast_to(physical.radii[..., 0], radii.shape), radii], -1),
            np.inf,
        ),
    )


def _problem(
    window: Window,
    weights: Booleans,
    free: Booleans,
    wished: Booleans,
    radii: Floats,
    inside: Floats,
    guess: Floats,
    first: PlanarSets,
    failed: Booleans,
    radius: float,
) -> LookAhead:
    """The batch; `inside` and `guess` are advances (B, n, H, 2), 0 for the destroyed."""
    batch, n = window.alive.shape
    steps, motion = window.steps, window.motion
    corridor = radius > 0.0
    nlp = lookahead_nlp(window.hazard, n, steps, corridor)
    living = window.alive[..., None, None]
    inside, guess = (
        np.ascontiguousarray(np.where(living, path, 0.0).transpose(0, 2, 1, 3))
        for path in (inside, guess)
    )
    bound = np.full((batch, steps, n, 2), np.inf)
    bound[:, 0] = motion.v_max
    fixed = ~free[:, None, :, None]
    blocks: dict[str, Floats] = {"acceleration": np.full((batch, steps, n), motion.a_max)}
    if steps > 1:
        blocks["speed"] = np.full((batch, steps - 1, n, 2), motion.v_max)
    if corridor:
        blocks["corridor"] = (motion.dt * radii.transpose(0, 2, 1)) ** 2
    upper = _rows(nlp, blocks, free)
    lower = -_rows(
        nlp, {k: v if k == "speed" else np.full_like(v, np.inf) for k, v in blocks.items()}, free
    )
    targets = np.where(np.isfinite(radii)[..., None], window.targets, 0.0)
    alone = (weights * window.hazard.lone_rates(window.positions)).sum(axis=1)
    parameters: dict[str, Floats] = {
        "positions": window.positions,
        "previous": window.previous,
        "alive": window.alive[..., None].astype(float),
        "weights": weights[..., None].astype(float),
        "goal": window.goals[None, :1],
        "dt": np.array([[motion.dt]]),
    }
    if steps > 1:
        parameters["later"] = window.goals[None, 1:]
    instances = Instances(
        start=guess.reshape(batch, -1),
        parameters=nlp.pack_parameters(**parameters),
        lower=np.where(fixed, inside, -bound).reshape(batch, -1),
        upper=np.where(fixed, inside, bound).reshape(batch, -1),
        lower_g=lower,
        upper_g=upper,
        units=np.stack(
            [np.full(batch, motion.v_max), steps * np.where(alone > 0, alone, 1.0)], axis=1
        ),
        paths=PathSets(
            window.previous, targets, radii, free, inside, window.limits.speed, window.limits.change
        ),
    )
    return LookAhead(
        nlp, instances, free, first, wished, radius, failed.astype(np.int64), inside[:, 0]
    )


def _rows(nlp: Nlp, blocks: Mapping[str, Floats], free: Booleans) -> Floats:
    """Bounds of g (B, ng) from blocks (B, steps, n, ...); none for members who are not free."""
    columns = []
    for name in nlp.constraints:
        block = blocks[name]
        mask = free[:, None, :].reshape(len(free), 1, free.shape[1], *[1] * (block.ndim - 3))
        columns.append(np.where(mask, block, np.inf).reshape(len(free), -1))
    return np.concatenate(columns, axis=1)
