"""Look-ahead problems from windows: wishes first, then the instances of the program.

See `casswarm.problems.mpc_formation` for the mathematics.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from ..hazard import KernelHazard
from ..optimization.feasible_sets.planar import PlanarSets
from ..optimization.feasible_sets.trajectory import PathSets, distances, part_within
from ..optimization.problem import Instances, Nlp
from ..problems.mpc_formation import MpcFormation, Window, lookahead_nlp
from ..typing import BoolArray, FloatArray

MARGIN = 1e-4
"""By how much a corridor is narrower for every step ahead, as a part of its radius."""


def leader_mpc(window: Window, leaders: NDArray[np.intp]) -> MpcFormation:
    """Leader protection over the window; `leaders` (B,) are the indices of living members."""
    batch, n = window.alive.shape
    rows = np.arange(batch)
    leads = (np.arange(n) == leaders[:, None]) & window.alive
    path, failed = window.limits.following(
        window.previous_velocities[rows, leaders],
        window.targets[rows, leaders],
        np.zeros(window.steps),
    )
    inside = window.limits.slowing(window.previous_velocities, window.steps)
    inside[rows, leaders] = path
    place = window.positions[rows, leaders][:, None] + window.motion.dt * path
    to_leader = (place[:, None] - window.positions[:, :, None]) / window.motion.dt
    free = window.alive & ~leads
    guess = inside.copy()
    guess[free] = window.limits.greedy(window.previous_velocities[free], to_leader[free])
    if isinstance(window.hazard, KernelHazard) and window.hazard.gathers:
        # nothing is better than to be with the leader all the time: who can, is done
        there = free & (distances(guess, to_leader) <= 1e-12 * window.limits.speed).all(axis=-1)
        inside[there], free = guess[there], free & ~there
    none = np.full((*window.alive.shape, window.steps), np.inf)
    first = _first(window, ~free, inside[:, :, 0], none[..., 0])
    return _problem(window, leads, free, leads, none, inside, guess, first, failed, 0.0)


def constrained_mpc(window: Window, rho: float) -> MpcFormation:
    """Constrained trajectory over the window; `rho` is the paper's bound of the corridor."""
    radius = np.sqrt(rho) / window.motion.dt
    margin, living, targets = MARGIN * radius, window.alive, window.targets
    narrow = np.maximum(0.0, radius - margin * np.arange(1, window.steps + 1))
    slowing = window.limits.slowing(window.previous_velocities, window.steps)
    nearest, failed = slowing.copy(), np.zeros_like(living)
    nearest[living], failed[living] = window.limits.following(
        window.previous_velocities[living], targets[living], narrow
    )
    excess = np.maximum(0.0, distances(nearest, targets) - narrow)
    radii = np.where(living[..., None], narrow + margin + excess, np.inf)
    part = part_within(nearest, slowing, targets, radii)[..., None, None]
    inside = nearest + part * (slowing - nearest)
    # the step that is flown: the paper's corridor to the letter, where it can be met
    wide = np.where(excess[..., 0] > margin, radii[..., 0], radius)
    wide = np.where(living, wide, np.inf)
    nobody = np.zeros_like(living)
    first = _first(window, nobody, window.previous_velocities, wide)
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


def _first(
    window: Window, given: BoolArray, velocities: FloatArray, radii: FloatArray
) -> PlanarSets:
    """Sets of the velocities to be flown; those of `given` members, and of the dead, are points."""
    physical = window.motion.sets(window.previous_velocities)
    living = window.alive[..., None]
    known = np.where(
        living, physical.project(np.broadcast_to(velocities, window.previous_velocities.shape)), 0
    )
    free = living & ~given[..., None]
    to_goal = (window.goals[0] - window.positions) / window.motion.dt
    return PlanarSets(
        np.where(free, physical.lower, known),
        np.where(free, physical.upper, known),
        np.stack([window.previous_velocities, to_goal], axis=-2),
        np.where(
            free,
            np.stack([np.broadcast_to(physical.radii[..., 0], radii.shape), radii], -1),
            np.inf,
        ),
    )


def _problem(
    window: Window,
    weights: BoolArray,
    free: BoolArray,
    wished: BoolArray,
    radii: FloatArray,
    inside: FloatArray,
    guess: FloatArray,
    first: PlanarSets,
    failed: BoolArray,
    radius: float,
) -> MpcFormation:
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
    blocks: dict[str, FloatArray] = {"acceleration": np.full((batch, steps, n), motion.a_max)}
    if steps > 1:
        blocks["speed"] = np.full((batch, steps - 1, n, 2), motion.v_max)
    if corridor:
        blocks["corridor"] = (motion.dt * radii.transpose(0, 2, 1)) ** 2
    upper = _rows(nlp, blocks, free)
    lower = -_rows(
        nlp, {k: v if k == "speed" else np.full_like(v, np.inf) for k, v in blocks.items()}, free
    )
    targets = np.where(np.isfinite(radii)[..., None], window.targets, 0.0)
    alone = (weights * window.hazard.single_agent_rates(window.positions)).sum(axis=1)
    parameters: dict[str, FloatArray] = {
        "positions": window.positions,
        "previous_velocities": window.previous_velocities,
        "alive": window.alive[..., None].astype(float),
        "weights": weights[..., None].astype(float),
        "goal": window.goals[None, :1],
        "dt": np.array([[motion.dt]]),
    }
    if steps > 1:
        parameters["later"] = window.goals[None, 1:]
    instances = Instances(
        x0=guess.reshape(batch, -1),
        p=nlp.pack_parameters(**parameters),
        lbx=np.where(fixed, inside, -bound).reshape(batch, -1),
        ubx=np.where(fixed, inside, bound).reshape(batch, -1),
        lbg=lower,
        ubg=upper,
        scale=np.stack(
            [np.full(batch, motion.v_max), steps * np.where(alone > 0, alone, 1.0)], axis=1
        ),
        feasible_set=PathSets(
            window.previous_velocities,
            targets,
            radii,
            free,
            inside,
            window.limits.speed,
            window.limits.change,
        ),
    )
    return MpcFormation(
        nlp, instances, free, first, wished, radius, failed.astype(np.int64), inside[:, 0]
    )


def _rows(nlp: Nlp, blocks: Mapping[str, FloatArray], free: BoolArray) -> FloatArray:
    """Bounds of g (B, ng) from blocks (B, steps, n, ...); none for members who are not free."""
    columns = []
    for name in nlp.constraints:
        block = blocks[name]
        mask = free[:, None, :].reshape(len(free), 1, free.shape[1], *[1] * (block.ndim - 3))
        columns.append(np.where(mask, block, np.inf).reshape(len(free), -1))
    return np.concatenate(columns, axis=1)
