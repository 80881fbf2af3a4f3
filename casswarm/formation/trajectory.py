r"""Trajectories of members over some steps within limits of speed and acceleration, in batches.

A trajectory is written in displacements: u_s = v_1 + ... + v_s, velocities summed, so that a member
is at X + dt u_s after s steps. Its limits are those of every step of a formation,

    |v_s| <= speed in each component,   |v_s - v_{s-1}| <= change,   v_0 = `initial_velocities`,

and, where a corridor is given, |u_s - center_s| <= radius_s. The first two alone always have an
interior, whatever the initial velocity within the box: `Limits.slowing`.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..motion.planar import PlanarSets
from ..typing import BoolArray, FloatArray


@dataclass(frozen=True, eq=False)
class TrajectorySets:
    """Sets of trajectories of B states with n members over H steps: a product over members.

    With these as `Instances.feasible_set`, x are the displacements per step, and the objective is
    the sum of the `CompiledObjective` over the steps.
    """

    initial_velocities: FloatArray  # (B, n, 2)
    centers: FloatArray  # (B, n, H, 2), of the corridor, as displacements
    radii: FloatArray  # (B, n, H), of the corridor; infinite where there is none
    free: BoolArray  # (B, n), members whose trajectories are variables
    inside: FloatArray  # (B, H, n, 2), trajectories strictly within the limits, or fixed
    limits: Limits

    @property
    def shape(self) -> tuple[int, int, int]:
        """States, steps and members."""
        states, steps, members, _ = self.inside.shape
        return states, steps, members

    def contains(self, points: FloatArray, tolerance: float = 0.0) -> BoolArray:
        """Test if displacements (B, H, n, 2) are in the sets of their members, shape (B, n)."""
        first = np.zeros_like(points[:, :1])
        velocities = np.diff(points, axis=1, prepend=first)
        changes = np.diff(velocities, axis=1, prepend=self.initial_velocities[:, None])
        to_center = distances(points, self.centers.swapaxes(1, 2))
        excess = np.maximum.reduce(
            [
                abs(velocities).max(axis=-1) - self.limits.speed,
                np.hypot(changes[..., 0], changes[..., 1]) - self.limits.change,
                to_center - self.radii.swapaxes(1, 2),
            ]
        )
        return np.asarray((excess <= tolerance).all(axis=1))

    def __getitem__(self, rows: slice | NDArray[Any]) -> TrajectorySets:
        """The sets of some of the states."""
        arrays = ("initial_velocities", "centers", "radii", "free", "inside")
        return replace(self, **{name: getattr(self, name)[rows] for name in arrays})


@dataclass(frozen=True)
class Limits:
    """Bounds on a velocity's components, and on the length of its change in a step."""

    speed: float
    change: float

    def slowing(self, initial_velocities: FloatArray, steps: int) -> FloatArray:
        """Displacements (..., H, 2) of slowing down from velocities (..., 2), strictly within."""
        speed = np.hypot(initial_velocities[..., 0], initial_velocities[..., 1])
        ratio = 1.0 - 0.5 * np.minimum(1.0, self.change / np.maximum(speed, 1e-300))
        ratio = np.where(speed > 0.0, ratio, 0.0)
        powers = ratio[..., None] ** np.arange(1, steps + 1)
        return np.asarray(np.cumsum(powers, axis=-1)[..., None] * initial_velocities[..., None, :])

    def greedy(self, initial_velocities: FloatArray, goals: FloatArray) -> FloatArray:
        """Displacements (M, H, 2) that step by step come as near to goals (M, H, 2) as allowed."""
        box = np.full(2, self.speed)
        velocity, displacement = initial_velocities, np.zeros_like(initial_velocities)
        trajectory = []
        for s in range(goals.shape[1]):
            step = PlanarSets(-box, box, velocity[:, None], np.full(1, self.change))
            velocity = step.project(goals[:, s] - displacement)
            displacement = displacement + velocity
            trajectory.append(displacement)
        return np.stack(trajectory, axis=1)


def distances(trajectories: FloatArray, goals: FloatArray) -> FloatArray:
    """Distances (..., H) of trajectories to goals (..., H, 2)."""
    offsets = trajectories - goals
    return np.asarray(np.hypot(offsets[..., 0], offsets[..., 1]))


def fraction_within(
    start: FloatArray, end: FloatArray, centers: FloatArray, radii: FloatArray
) -> FloatArray:
    """Fraction (...), at most 0.5, of the move from start to end (..., H, 2) that stays in discs.

    No squared distance to a disc's boundary may fall below half of its value at the start.
    """
    from_center, direction = start - centers, end - start
    outward, square = (from_center * direction).sum(axis=-1), (direction * direction).sum(axis=-1)
    margin = 0.5 * np.maximum(radii**2 - (from_center * from_center).sum(axis=-1), 0.0)
    with np.errstate(divide="ignore", invalid="ignore"):
        root = np.sqrt(outward * outward + square * margin)
        length = np.where(outward > 0.0, margin / (outward + root), (root - outward) / square)
    bounded = (square > 0.0) & np.isfinite(radii)
    return np.asarray(np.minimum(0.5, np.where(bounded, length, 1.0).min(axis=-1)))
