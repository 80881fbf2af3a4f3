"""Motion on a lattice: nearly equal states become equal to the last bit.

A policy decides only to the accuracy of its solver, so states that are equal in exact arithmetic
differ in their last digits, and so do all of their successors. On a lattice a member's command is
rounded so that the member moves to a lattice point: the nearest one or, where that exceeds v_max or
a_max, the nearest of the nine around it that does not. Where none of them is allowed, which takes a
set thinner than the lattice, the command is executed as it is. This is a policy of its own, whose
commands differ from the given policy's by at most 3/2 spacing / dt in each component, and in which
states coincide exactly.

The lattice moves with the guide. So a member on the guide stays exactly on it, members that gather
around it coincide, and which of them leads is not decided by rounding.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product
from typing import TYPE_CHECKING

import numpy as np

from .._util.constants import SPEED_TOL
from ..errors import PolicyError
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
    def along(
        cls, guide: Guide, scenario: Scenario, spacing: float | None, accuracy: float = 0.0
    ) -> Lattice | None:
        """Lattice that moves with a guide.

        Parameters
        ----------
        guide : Guide
        scenario : Scenario
        spacing : float, optional
            By default as near to `accuracy` v_max dt as is allowed; 0 for no lattice.
        accuracy : float
            0 for no lattice.

        Returns
        -------
        Lattice, or None

        Raises
        ------
        PolicyError
            The spacing is so large that members could not move, or too small for double precision.
        """
        motion = Motion.from_scenario(scenario)
        path = np.stack([guide.reference(step) for step in range(scenario.n_steps + 1)])
        reach = motion.dt * motion.v_max
        extent = max(np.abs(scenario.positions).max(), np.abs(path).max())
        finest = _FINEST * (float(extent) + scenario.n_steps * reach)
        coarsest = _COARSEST * min(reach, motion.dt * motion.max_change)
        if spacing is None:
            allowed = accuracy > 0 and finest <= coarsest
            spacing = min(max(accuracy * reach, finest), coarsest) if allowed else 0.0
        if spacing != 0.0 and not finest <= spacing <= coarsest:
            raise PolicyError(
                f"aggregation_tol = {spacing:g}; allowed: 0, or from {finest:.3g}, for double "
                f"precision, to {coarsest:.3g}, a part of what members can move in a step"
            )
        return cls(path, spacing, motion.dt, motion.v_max) if spacing else None

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
        on = self.path[step] + self.spacing * nearest == positions
        return np.asarray(np.where(on, nearest, indices))

    def _velocities(self, step: int, moves: FloatArray) -> FloatArray:
        """Velocities of moves, in spacings relative to the path."""
        own = self.path[step + 1] - self.path[step]
        return np.asarray((own + self.spacing * moves) / self.dt)

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
