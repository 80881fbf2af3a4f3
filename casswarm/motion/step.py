"""A time step of the members: the limits of their motion, and the states that it begins from."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from ..compiled.kernels import contiguous
from ..hazard import Hazard
from ..scenario import Scenario
from ..typing import BoolArray, FloatArray, IntArray
from .planar import PlanarSets
from .planar_kernels import WIDTH, motion_sets, project_adjoint

POSITION_TOL = 1e-6
"""Distance, in units of v_max dt, up to which a member counts as being at a position."""


@dataclass(frozen=True)
class Motion:
    """Limits of a member's motion in a step.

    Parameters
    ----------
    v_max : float
        Bound on each velocity component; where members differ, the largest one, a unit.
    a_max : float
        Bound on ||V(t) - V(t-1)||^2; the largest one.
    dt : float
    disc : bool
        Whether v_max also bounds the speed in every direction.
    members : tuple of n pairs of float
        v_max and a_max of every member, where they differ.
    """

    v_max: float
    a_max: float
    dt: float
    disc: bool = False
    members: tuple[tuple[float, float], ...] = ()

    @classmethod
    def from_scenario(cls, scenario: Scenario) -> Motion:
        """Limits of the members of a scenario."""
        swarm, dt = scenario.swarm, scenario.time.dt
        limits = [
            (kind.v_max or swarm.v_max, kind.a_max or swarm.a_max) for kind in swarm.member_kinds
        ]
        v_max, a_max = map(max, zip(*limits, strict=True))
        members = () if len(set(limits)) == 1 else tuple(limits)
        return cls(v_max, a_max, dt, swarm.speed == "disc", members)

    def sets(self, previous_velocities: FloatArray) -> PlanarSets:
        """Sets of velocities (..., 2) allowed after `previous_velocities` (..., 2).

        Of n members, (..., n, 2), where they differ.
        """
        rows = np.empty((*previous_velocities.shape[:-1], WIDTH))
        flat = contiguous(previous_velocities.reshape(-1, 2).astype(float))
        motion_sets(flat, self.limits, rows.reshape(-1, WIDTH))
        return PlanarSets.from_packed(rows, 3 if self.disc else 1)

    @cached_property
    def limits(self) -> FloatArray:
        """The limits as kernels take them, (n, 3) or (1, 3): see `planar_kernels.motion_set`."""
        rows = self.members or ((self.v_max, self.a_max),)
        return np.array([(v, math.sqrt(a), v if self.disc else math.inf) for v, a in rows], float)

    @property
    def bounds(self) -> FloatArray:
        """v_max and a_max of every member, (n, 2), or of all, (1, 2)."""
        return np.array(self.members or ((self.v_max, self.a_max),), float)

    @property
    def max_change(self) -> float:
        """Bound on ||V(t) - V(t-1)||."""
        return math.sqrt(self.a_max)

    @property
    def position_tol(self) -> float:
        """Distance up to which a member counts as being at a position."""
        return POSITION_TOL * self.v_max * self.dt

    def toward(
        self, positions: FloatArray, previous_velocities: FloatArray, goals: FloatArray
    ) -> FloatArray:
        """Velocities (..., 2) that bring positions (..., 2) as close to goals as is allowed.

        Equation (6)'s v_i = X* - X_i where the limits allow it, and its projection elsewhere.
        """
        return self.sets(previous_velocities).project((goals - positions) / self.dt)

    def project_adjoint(
        self,
        commanded: FloatArray,
        previous_velocities: FloatArray,
        projected: FloatArray,
        seeds: FloatArray,
    ) -> tuple[FloatArray, FloatArray]:
        """Products of seeds with the derivatives of a projection; all arrays are (..., 2).

        With `projected` = ``sets(previous_velocities).project(commanded)`` and the derivatives
        `seeds` with respect to it: those with respect to `commanded` and `previous_velocities`.
        """
        given = (commanded, previous_velocities, projected, seeds)
        p, c, q, s = (contiguous(array.reshape(-1, 2)) for array in given)
        to_commanded, to_previous = np.empty_like(p), np.empty_like(p)
        project_adjoint(p, c, q, self.limits, s, to_commanded, to_previous)
        return to_commanded.reshape(seeds.shape), to_previous.reshape(seeds.shape)

    def misses(
        self, positions: FloatArray, velocities: FloatArray, goals: FloatArray, radius: float = 0.0
    ) -> BoolArray:
        """Test if steps (..., 2) end farther than `radius` from the goals, shape (...)."""
        offset = positions + self.dt * velocities - goals
        distance = np.hypot(offset[..., 0], offset[..., 1])
        return np.asarray(distance > radius + self.position_tol)


@dataclass(frozen=True, eq=False)
class Step:
    """Data of a step t -> t + 1, or of H steps, for a batch of B states."""

    hazard: Hazard
    motion: Motion
    positions: FloatArray  # (B, n, 2), X(t)
    previous_velocities: FloatArray  # (B, n, 2), V(t-1)
    alive: BoolArray  # (B, n), held fixed over the steps
    goals: FloatArray  # (H, 2) or (H, B, 2), X*(t+1), ..., X*(t+H), for all states or for each
    later: tuple[Hazard, ...] = ()  # of the steps after the first, where they have others
    counts: BoolArray | None = None  # (n,), members that may lead: by default all

    def __getitem__(self, rows: IntArray) -> Step:
        goals = self.goals if self.goals.ndim == 2 else self.goals[:, rows]
        return replace(
            self,
            positions=self.positions[rows],
            previous_velocities=self.previous_velocities[rows],
            alive=self.alive[rows],
            goals=goals,
        )

    @property
    def candidates(self) -> BoolArray:
        """Living members (B, n) that may lead: those that count, all where none of these lives."""
        if self.counts is None:
            return self.alive
        counting = self.alive & self.counts
        return np.where(counting.any(axis=1, keepdims=True), counting, self.alive)

    @property
    def horizon(self) -> int:
        """Number of steps H."""
        return len(self.goals)

    @property
    def goal(self) -> FloatArray:
        """X*(t+1), (1, 1, 2) or (B, 1, 2)."""
        return np.asarray(self.goals[0].reshape(-1, 1, 2))
