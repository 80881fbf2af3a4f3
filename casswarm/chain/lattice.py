"""Positions on a lattice: nearly equal states become equal to the last bit.

A policy decides only to the accuracy of its solver, so states that are equal in exact arithmetic
differ in their last digits, and so do all of their successors. On a lattice a member's command is
rounded so that the member moves to a lattice point. That defines a policy of its own, whose
commands differ from the given policy's by half a spacing over dt in each component, or by up to one
and a half where the nearest point exceeds v_max or a_max; its states coincide exactly.

The lattice moves with the guide. So a member on the guide stays exactly on it, members that gather
around it coincide, and which of them leads is not decided by rounding.

**A lattice point that respects the limits exists** within one and a half spacings in each
coordinate. The velocities that v_max and a_max allow are a box and a disc around a point of the
box, V(t-1). At any of their points, they contain a cone of at least 90 degrees whose size is
comparable to the disc's radius, and a cone of 90 degrees contains one of the nine points nearest to
its apex: for a direction of tangent s in [0, 1] of its lower edge, a unit square from
(a, -s a), a = s / (1 + s^2) <= 1/2 on.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product
from typing import TYPE_CHECKING

import numpy as np

from .._util.constants import SPEED_TOL
from ..optimization.feasible_sets.planar import PlanarSets
from ..problems.step import Motion
from ..typing import BoolArray, FloatArray

if TYPE_CHECKING:
    from ..planning.guide import Guide
    from ..scenario import Scenario

_NEIGHBOURS = np.array(list(product((0.0, -1.0, 1.0), repeat=2)))  # the nearest point comes first
_COARSEST = 1 / 8  # spacing, in displacements that v_max and a_max allow
_FINEST = 1e-13  # spacing, in the scenario's largest coordinate: indices remain exact


@dataclass(frozen=True, eq=False)
class Lattice:
    """Square lattice of positions that moves along a path.

    Parameters
    ----------
    path : (N+1, 2)
        A point of the lattice at every step.
    spacing : float
    dt, v_max : float
    """

    path: FloatArray
    spacing: float
    dt: float
    v_max: float

    @classmethod
    def along(cls, guide: Guide, scenario: Scenario, spacing: float) -> Lattice | None:
        """Lattice that moves with a guide; None for a spacing of 0.

        Raises
        ------
        ValueError
            The spacing is so large that members could not move, or too small for double precision.
        """
        if spacing == 0.0:
            return None
        motion = Motion.from_scenario(scenario)
        path = np.stack([guide.reference(step) for step in range(scenario.n_steps + 1)])
        longest = motion.dt * motion.v_max
        coarsest = _COARSEST * min(longest, motion.dt * motion.max_change)
        extent = max(np.abs(scenario.positions).max(), np.abs(path).max())
        finest = _FINEST * (float(extent) + scenario.n_steps * longest)
        if not finest <= spacing <= coarsest:
            raise ValueError(
                f"aggregation_tol = {spacing}; allowed: 0, or from {finest:.3g} to {coarsest:.3g}, an "
                "eighth of what v_max and a_max let a member move in a step"
            )
        return cls(path, spacing, motion.dt, motion.v_max)

    def moved(
        self, step: int, positions: FloatArray, velocities: FloatArray, sets: PlanarSets
    ) -> tuple[FloatArray, FloatArray]:
        """Velocities and positions (B, n, 2) of a step to lattice points near the commanded ones.

        Equal indices of lattice points give equal results to the last bit.

        Parameters
        ----------
        step : int
            t.
        positions, velocities : (B, n, 2)
            X(t), and the commanded velocities, within their sets.
        sets : PlanarSets, shape (B, n)
            Velocities that v_max and a_max allow.
        """
        start = self._indices(step, positions)
        commanded = positions + self.dt * velocities
        exact = (commanded - self.path[step + 1]) / self.spacing
        goals = np.rint(exact)
        moves = self._velocities(step, goals - start)
        exceeds = self._exceeds(sets, moves)
        if exceeds.any():
            rows = np.nonzero(exceeds)
            goals[rows] = self._allowed(step, start[rows], exact[rows], sets[exceeds])
            moves[rows] = self._velocities(step, goals[rows] - start[rows])
        following = self.path[step + 1] + self.spacing * goals
        if exceeds.any():
            exceeds = self._exceeds(sets, moves)  # only next to limits that hold a sliver
            moves[exceeds], following[exceeds] = velocities[exceeds], commanded[exceeds]
        return moves, following

    def _indices(self, step: int, positions: FloatArray) -> FloatArray:
        """Positions in spacings: whole numbers for lattice points, to the last bit."""
        indices = (positions - self.path[step]) / self.spacing
        nearest = np.rint(indices)
        return np.where(self.path[step] + self.spacing * nearest == positions, nearest, indices)

    def _velocities(self, step: int, moves: FloatArray) -> FloatArray:
        """Velocities of moves, in spacings relative to the path."""
        own = self.path[step + 1] - self.path[step]
        return (own + self.spacing * moves) / self.dt

    def _exceeds(self, sets: PlanarSets, velocities: FloatArray) -> BoolArray:
        return np.asarray(sets.violation(velocities) > SPEED_TOL * self.v_max)

    def _allowed(
        self, step: int, start: FloatArray, exact: FloatArray, sets: PlanarSets
    ) -> FloatArray:
        """The allowed goal (R, 2) nearest to the exact one among the nine around, if any."""
        nearest = np.rint(exact)
        best, least = nearest.copy(), np.full(len(exact), np.inf)
        for offset in _NEIGHBOURS:
            other = nearest + offset
            distance = np.hypot(*(other - exact).T)
            distance[self._exceeds(sets, self._velocities(step, other - start))] = np.inf
            nearer = distance < least
            best[nearer], least[nearer] = other[nearer], distance[nearer]
        return best
