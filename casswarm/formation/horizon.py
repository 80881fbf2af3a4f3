"""Instances of formation problems over several steps: soft constraints first, then the program.

See `casswarm.problems.formation` for the program, and ``docs/mpc.md``.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..compiled.kernels import contiguous
from ..hazard import KernelHazard
from ..motion.planar import PlanarSets
from ..motion.step import Step
from ..nlp.program import Instances
from ..typing import BoolArray, FloatArray
from .objective import formation_program
from .spectral_kernels import Results
from .task import FOLLOWER_WEIGHT, Formation, formation_scale, leader_weights
from .trajectory import Limits, TrajectorySets, distances, fraction_within

MARGIN = 1e-4
"""Decrease of the corridor's radius from each step of the horizon to the next, relative to it."""


class _Plan(NamedTuple):
    """Data that the soft constraints determine; paths are displacements in units of dt.

    Parameters
    ----------
    constrained : (B, n) bool
        Members with a soft constraint.
    weights : (B, n)
        Weights of the members' rates in the objective.
    free : (B, n) bool
        Members whose paths are optimised.
    interior : (B, n, H, 2)
        Paths strictly within the limits; prescribed for members that are not free.
    guess : (B, n, H, 2)
        Initial guesses.
    radii : (B, n, H)
        Radii of the corridor; infinite where there is none.
    first_radii : (B, n)
        Radii to which the first step is projected.
    radius : float
        Distance from the goal that the soft constraint allows; 0 for a position.
    failed : (B,) bool
        Whether a least-squares problem was not solved.
    """

    constrained: BoolArray
    weights: FloatArray
    free: BoolArray
    interior: FloatArray
    guess: FloatArray
    radii: FloatArray
    first_radii: FloatArray
    radius: float
    failed: BoolArray


def leader_mpc_formation(
    step: Step, leaders: NDArray[np.intp], follower_weight: float = FOLLOWER_WEIGHT
) -> Formation:
    """Leader protection over H steps; `leaders` (B,) are the indices of living members."""
    limits, dt, previous = path_limits(step), step.motion.dt, step.previous_velocities
    batch, n = step.alive.shape
    rows = np.arange(batch)
    leads = (np.arange(n) == leaders[:, None]) & step.alive
    path, failed = nearest_trajectories(
        limits, previous[rows, leaders], path_targets(step)[rows, leaders], np.zeros(step.horizon)
    )
    interior = limits.slowing(previous, step.horizon)
    interior[rows, leaders] = path
    positions = step.positions[rows, leaders][:, None] + dt * path
    to_leader = (positions[:, None] - step.positions[:, :, None]) / dt
    free = step.alive & ~leads
    guess = interior.copy()
    guess[free] = limits.greedy(previous[free], to_leader[free])
    if isinstance(step.hazard, KernelHazard) and step.hazard.gathers:
        # members that can stay with the leader over the whole horizon are solved in closed form
        joined = free & (distances(guess, to_leader) <= 1e-12 * limits.speed).all(axis=-1)
        interior[joined], free = guess[joined], free & ~joined
    radii = np.full((batch, n, step.horizon), np.inf)
    weights = leader_weights(step, leads, follower_weight)
    plan = _Plan(leads, weights, free, interior, guess, radii, radii[..., 0], 0.0, failed)
    return _formation(step, plan)


def corridor_mpc_formation(step: Step, rho: float) -> Formation:
    """Constrained trajectory over H steps; `rho` bounds the squared distance to the goals."""
    limits, previous = path_limits(step), step.previous_velocities
    radius = np.sqrt(rho) / step.motion.dt
    margin, living, targets = MARGIN * radius, step.alive, path_targets(step)
    narrow = np.maximum(0.0, radius - margin * np.arange(1, step.horizon + 1))
    slowing = limits.slowing(previous, step.horizon)
    nearest, failed = slowing.copy(), np.zeros_like(living)
    nearest[living], failed[living] = nearest_trajectories(
        limits, previous[living], targets[living], narrow
    )
    excess = np.maximum(0.0, distances(nearest, targets) - narrow)
    radii = np.where(living[..., None], narrow + margin + excess, np.inf)
    fraction = fraction_within(nearest, slowing, targets, radii)[..., None, None]
    interior = nearest + fraction * (slowing - nearest)
    # for the applied step, exactly the paper's corridor where it can be met
    first_radii = np.where(excess[..., 0] > margin, radii[..., 0], radius)
    first_radii = np.where(living, first_radii, np.inf)
    failures = np.asarray(failed.any(axis=1))
    weights = living.astype(float)
    soft_radius = float(np.sqrt(rho))
    return _formation(
        step,
        _Plan(
            living, weights, living, interior, nearest, radii, first_radii, soft_radius, failures
        ),
    )


def path_limits(step: Step) -> Limits:
    """Limits of every member's path."""
    return Limits(step.motion.v_max, float(np.sqrt(step.motion.a_max)))


def path_targets(step: Step) -> FloatArray:
    """The goals as displacements of every member, (B, n, H, 2)."""
    goals = _goals(step)[:, None]
    return np.asarray((goals - step.positions[:, :, None]) / step.motion.dt)


def _goals(step: Step) -> FloatArray:
    """The goals (1, H, 2) for all states, or (B, H, 2) for each."""
    return step.goals[None] if step.goals.ndim == 2 else step.goals.transpose(1, 0, 2)


def _first_sets(step: Step, plan: _Plan) -> PlanarSets:
    """Sets of the applied velocities; a point for members that are not free, 0 for the dead."""
    hard = step.motion.sets(step.previous_velocities)
    fixed = np.where(step.alive[..., None], hard.project(plan.interior[:, :, 0]), 0)
    free = plan.free[..., None]
    to_goal = (step.goal - step.positions) / step.motion.dt
    acceleration = np.broadcast_to(hard.radii[..., 0], plan.first_radii.shape)
    return PlanarSets(
        np.where(free, hard.lower, fixed),
        np.where(free, hard.upper, fixed),
        np.stack([step.previous_velocities, to_goal], axis=-2),
        np.where(free, np.stack([acceleration, plan.first_radii], -1), np.inf),
    )


def _formation(step: Step, plan: _Plan) -> Formation:
    """Batch of problems; paths of the destroyed are 0."""
    batch, n = step.alive.shape
    horizon, motion, free = step.horizon, step.motion, plan.free
    corridor = plan.radius > 0.0
    nlp = formation_program(step.hazard, n, corridor, horizon, step.later)
    living = step.alive[..., None, None]
    interior, guess = (
        np.ascontiguousarray(np.where(living, path, 0.0).transpose(0, 2, 1, 3))
        for path in (plan.interior, plan.guess)
    )
    bound = np.full((batch, horizon, n, 2), np.inf)
    bound[:, 0] = motion.v_max
    fixed = ~free[:, None, :, None]
    parameters: dict[str, FloatArray] = {
        "positions": step.positions,
        "previous_velocities": step.previous_velocities,
        "alive": step.alive[..., None].astype(float),
        "weights": plan.weights[..., None],
        "goal": _goals(step)[:, :1],
        "dt": np.array([[motion.dt]]),
        "v_max": np.array([[motion.v_max]]),
    }
    change = motion.a_max / motion.v_max**2
    blocks: dict[str, FloatArray] = {"acceleration": np.full((batch, horizon, n, 1), change)}
    if horizon > 1:
        parameters["later"] = _goals(step)[:, 1:]
        blocks["speed"] = np.ones((batch, horizon - 1, n, 2))
    if corridor:
        blocks["corridor"] = (plan.radii.transpose(0, 2, 1)[..., None] / motion.v_max) ** 2
    upper = {
        name: np.where(fixed, np.inf, block).reshape(batch, -1, block.shape[-1])
        for name, block in blocks.items()
    }
    lower = {
        name: -block if name == "speed" else np.full_like(block, -np.inf)
        for name, block in upper.items()
    }
    instances = Instances(
        x0=guess.reshape(batch, -1),
        p=nlp.pack_parameters(**parameters),
        lbx=np.where(fixed, interior, -bound).reshape(batch, -1),
        ubx=np.where(fixed, interior, bound).reshape(batch, -1),
        lbg=nlp.pack_constraints(**lower),
        ubg=nlp.pack_constraints(**upper),
        scale=formation_scale(step, plan.weights),
        feasible_set=TrajectorySets(
            step.previous_velocities,
            np.where(np.isfinite(plan.radii)[..., None], path_targets(step), 0.0),
            plan.radii,
            free,
            interior,
            path_limits(step),
        ),
    )
    return Formation(
        nlp,
        instances,
        free,
        sets=_first_sets(step, plan),
        fallback=interior[:, 0],
        infeasible=np.zeros_like(step.alive),
        tracked=plan.constrained,
        radius=plan.radius,
        failures=plan.failed.astype(np.int64),
    )


_POINTS, _DISCS = ((1e-13, 1e-9),), ((1e-10, 1e-8), (1e-7, 1e-6))
"""Final barrier parameters and residuals, the next where the first is not reached, in units of the
squared speed: for points the answer is unique and smooth, for discs it is neither, and used with a
margin."""

_ACCEPTABLE = 100.0  # times the residual is still accepted
_MAX_ITER = 300
_ROUNDING = 1e-9  # violation of a limit, in its unit, that counts as rounding


def nearest_trajectories(
    limits: Limits, initial_velocities: FloatArray, goals: FloatArray, radii: FloatArray
) -> tuple[FloatArray, BoolArray]:
    """Trajectories with the least sum of squared distances to moving discs.

    They minimise sum over s of max(0, |u_s - goal_s| - radius_s)^2, which is convex. Where the
    greedy trajectory touches every disc, or there is only one step, it is the answer; the others
    are found by the interior-point method.

    Parameters
    ----------
    limits : Limits
    initial_velocities : (M, 2)
    goals : (M, H, 2)
        Centres of the discs, as displacements.
    radii : (H,)

    Returns
    -------
    trajectories : (M, H, 2)
        Displacements, within the limits up to rounding.
    failed : (M,) bool
        Where the method did not converge; the greedy trajectory is returned.
    """
    trajectories = limits.greedy(initial_velocities, goals)
    outside = distances(trajectories, goals) > radii + 1e-12 * limits.speed
    failed: BoolArray = np.asarray(outside.any(axis=1) & (goals.shape[1] > 1))
    discs = np.dstack([goals, np.broadcast_to(radii, goals.shape[:2])])
    for tolerances in _DISCS if radii.any() else _POINTS:
        rows = np.flatnonzero(failed)
        if rows.size:
            x, good = _solve(limits, initial_velocities[rows], discs[rows], tolerances)
            trajectories[rows] = np.where(good[:, None, None], x, trajectories[rows])
            failed[rows] = ~good
    return trajectories, failed


def _solve(
    limits: Limits,
    initial_velocities: FloatArray,
    discs: FloatArray,
    tolerances: tuple[float, float],
) -> tuple[FloatArray, BoolArray]:
    """Answers (M, H, 2) for discs (M, H, 3), and whether they are good (M,)."""
    from .horizon_kernels import Batch, Options, minimise_batch
    from .spectral_kernels import Starts
    from .trajectory_kernels import disc_distance  # Numba takes a second to import

    size, steps, _ = discs.shape
    inside = limits.slowing(initial_velocities, steps)
    batch = Batch(
        x0=inside,
        inside=inside,
        free=np.ones((size, 1), bool),
        initial_velocities=contiguous(initial_velocities)[:, None],
        change=limits.change,
        centers=np.zeros((size, steps, 2)),
        radii=np.full((size, steps, 1), np.inf),
        p=discs,
        constants=np.zeros((1, 1)),
        scale=np.tile([limits.speed, limits.speed**2], (size, 1)),
    )
    results, multipliers = Results.empty((size, steps, 2)), np.empty((size, steps, 1, 6))
    options = Options(*tolerances, _MAX_ITER)
    minimise_batch((0, size), disc_distance, batch, Starts.single(), options, multipliers, results)
    _, violation, residual = results.verified.T
    return results.x, (violation <= _ROUNDING) & (residual <= _ACCEPTABLE * tolerances[1])
