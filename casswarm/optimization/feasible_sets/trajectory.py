r"""Paths of members over some steps within limits of speed and acceleration, in batches.

A path is written as what it advances: u_s = v_1 + ... + v_s, velocities summed, so that a member is
at X + dt u_s after s steps. Its limits are those of every step of a formation,

    |v_s| <= speed in each component,   |v_s - v_{s-1}| <= change,   v_0 = `before`,

and, where a corridor is given, |u_s - center_s| <= radius_s. The first two alone always leave
room: slowing down, v_s = q v_{s-1} with q a little below 1, keeps strictly within them
(`slowing`), whatever velocity within the box one comes with.
"""

from __future__ import annotations

import inspect
from dataclasses import dataclass
from functools import cache
from types import ModuleType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..._util.jit import compiled_module
from ...typing import BoolArray, FloatArray
from . import planar_kernels, trajectory_kernels
from .planar import PlanarSets

POINTS, DISCS = ((1e-13, 1e-9),), ((1e-10, 1e-8), (1e-7, 1e-6))
"""Barrier parameters and residuals at which `following` ends, the next where it does not come to
the first, in units of the squared speed: for points the answer is unique and smooth, for discs it
is neither, and used with a margin."""

_GOOD = 100.0  # times as large a residual is still good
_ITERATIONS = 300
ROUNDING = 1e-9
"""Violation of a limit, in its unit, that counts as rounding."""

_OBJECTIVE = '''
@compiled
def evaluate(x, p, shared, gradient, scratch):
    """Half the squared distance of `x` (2,) to the disc p: center x, center y, radius."""
    dx, dy = x[0] - p[0], x[1] - p[1]
    away = math.sqrt(dx * dx + dy * dy)
    out = max(0.0, away - p[2])
    pull = out / away if away > 0.0 else 0.0
    gradient[0], gradient[1] = pull * dx, pull * dy
    return 0.5 * out * out
'''


@dataclass(frozen=True, eq=False)
class PathSets:
    """Sets of paths of B states with n members over H steps: a product over members.

    Parameters
    ----------
    before : (B, n, 2)
        Velocities that the paths begin with.
    centers : (B, n, H, 2)
        Of the corridor, as advances.
    radii : (B, n, H)
        Of the corridor; infinite where there is none.
    free : (B, n) bool
        Whose paths are to be found.
    inside : (B, H, n, 2)
        Paths strictly within the limits; those of members who are not free are given.
    speed, change : float
        Bounds on a velocity's components, and on the length of its change in a step.
    """

    before: FloatArray
    centers: FloatArray
    radii: FloatArray
    free: BoolArray
    inside: FloatArray
    speed: float
    change: float

    @property
    def shape(self) -> tuple[int, int, int]:
        """States, steps and members."""
        states, steps, members, _ = self.inside.shape
        return states, steps, members

    def __getitem__(self, rows: slice | NDArray[Any]) -> PathSets:
        """The sets of some of the states."""
        return PathSets(
            self.before[rows],
            self.centers[rows],
            self.radii[rows],
            self.free[rows],
            self.inside[rows],
            self.speed,
            self.change,
        )


@dataclass(frozen=True)
class Limits:
    """Bounds on a velocity's components, and on the length of its change in a step."""

    speed: float
    change: float

    def slowing(self, before: FloatArray, steps: int) -> FloatArray:
        """Advances (..., H, 2) of slowing down from `before` (..., 2), strictly within limits."""
        pace = np.hypot(before[..., 0], before[..., 1])
        shrink = 1.0 - 0.5 * np.minimum(1.0, self.change / np.maximum(pace, 1e-300))
        shrink = np.where(pace > 0.0, shrink, 0.0)
        powers = shrink[..., None] ** np.arange(1, steps + 1)
        return np.asarray(np.cumsum(powers, axis=-1)[..., None] * before[..., None, :])

    def greedy(self, before: FloatArray, goals: FloatArray) -> FloatArray:
        """Advances (M, H, 2) that come, step by step, as near to goals (M, H, 2) as is allowed."""
        box = np.full(2, self.speed)
        velocity, place, path = before, np.zeros_like(before), []
        for s in range(goals.shape[1]):
            step = PlanarSets(-box, box, velocity[:, None], np.full(1, self.change))
            velocity = step.project(goals[:, s] - place)
            place = place + velocity
            path.append(place)
        return np.stack(path, axis=1)

    def following(
        self, before: FloatArray, goals: FloatArray, radii: FloatArray
    ) -> tuple[FloatArray, BoolArray]:
        """Paths that follow moving discs with the least sum of squared distances.

        They minimise sum over s of max(0, |u_s - goal_s| - radius_s)^2, which is convex. Where the
        greedy path touches every disc, or there is one step only, it is the answer; the others are
        found by the barrier method.

        Parameters
        ----------
        before : (M, 2)
        goals : (M, H, 2)
            Centres of the discs, as advances.
        radii : (H,)

        Returns
        -------
        paths : (M, H, 2)
            Advances, within the limits up to rounding.
        failed : (M,) bool
            Where the method did not converge; the greedy path is given.
        """
        paths = self.greedy(before, goals)
        beside = distances(paths, goals) > radii + 1e-12 * self.speed
        failed: BoolArray = np.asarray(beside.any(axis=1) & (goals.shape[1] > 1))
        for finest, tolerance in DISCS if radii.any() else POINTS:
            left = np.flatnonzero(failed)
            if left.size:
                found, good = self._followed(before[left], goals[left], radii, finest, tolerance)
                paths[left] = np.where(good[:, None, None], found, paths[left])
                failed[left] = ~good
        return paths, failed

    def _followed(
        self,
        before: FloatArray,
        goals: FloatArray,
        radii: FloatArray,
        finest: float,
        tolerance: float,
    ) -> tuple[FloatArray, BoolArray]:
        size, steps = goals.shape[:2]
        discs = np.concatenate([goals, np.broadcast_to(radii[:, None], (size, steps, 1))], axis=2)
        inside = self.slowing(before, steps)
        x, judged = np.empty((size, steps, 2)), np.empty((size, 3))
        _compiled().minimise_batch(
            0,
            size,
            inside[:, None],
            inside,
            np.ones((size, 1), bool),
            np.ascontiguousarray(before)[:, None],
            np.array([self.speed, self.change]),
            np.zeros((size, 1, steps, 2)),
            np.full((size, 1, steps), np.inf),
            discs,
            np.zeros(1),
            np.tile([self.speed, self.speed**2], (size, 1)),
            finest,
            tolerance,
            _ITERATIONS,
            x,
            np.empty((size, steps, 1, 6)),
            judged,
            np.empty(size, np.int64),
            np.zeros((size, 2), np.int64),
        )
        residual = np.where(np.isnan(judged[:, 2]), np.inf, judged[:, 2])
        return x, (judged[:, 1] <= ROUNDING) & (residual <= _GOOD * tolerance)


def distances(paths: FloatArray, goals: FloatArray) -> FloatArray:
    """Distances (..., H) of paths to goals (..., H, 2)."""
    away = paths - goals
    return np.asarray(np.hypot(away[..., 0], away[..., 1]))


def part_within(
    start: FloatArray, end: FloatArray, centers: FloatArray, radii: FloatArray
) -> FloatArray:
    """How far (...) paths (..., H, 2) may go from start to end, 0.5 at the most, in discs.

    No squared distance to a disc's boundary may fall below half of what it is at the start.
    """
    from_center, way = start - centers, end - start
    outward, square = (from_center * way).sum(axis=-1), (way * way).sum(axis=-1)
    room = 0.5 * np.maximum(radii**2 - (from_center * from_center).sum(axis=-1), 0.0)
    with np.errstate(divide="ignore", invalid="ignore"):
        root = np.sqrt(outward * outward + square * room)
        far = np.where(outward > 0.0, room / (outward + root), (root - outward) / square)
    bounded = (square > 0.0) & np.isfinite(radii)
    return np.asarray(np.minimum(0.5, np.where(bounded, far, 1.0).min(axis=-1)))


def interior_point_sources() -> list[str]:
    """Texts of the barrier method, which an objective's `evaluate` completes."""
    from ..solvers.batch import interior_point_batch_kernels, interior_point_kernels

    cores = (
        planar_kernels,
        trajectory_kernels,
        interior_point_kernels,
        interior_point_batch_kernels,
    )
    return [inspect.getsource(core) for core in cores]


@cache
def _compiled() -> ModuleType:
    return compiled_module(_OBJECTIVE, *interior_point_sources())
