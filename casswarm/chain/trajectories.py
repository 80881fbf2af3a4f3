"""The ways of runs: where everybody was at every step, and who led."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..policies.base import Policy
from ..typing import BoolArray, FloatArray, IntArray


@dataclass(frozen=True, eq=False)
class RunTrajectory:
    """The way of one run.

    Parameters
    ----------
    positions : (T+1, n, 2)
        The destroyed stay where they fell.
    alive : (T+1, n) bool
    leaders : (T,) int
        Who leads from step t to t + 1, -1 where the policy has no leaders.
    """

    positions: FloatArray
    alive: BoolArray
    leaders: IntArray

    def last_steps(self) -> IntArray:
        """The step (n,) at which every member fell, or the last one."""
        steps = len(self.alive) - 1
        return np.where(self.alive[-1], steps, np.argmin(self.alive, axis=0))


@dataclass
class TrajectoryRecorder:
    """The ways of the first few runs, a snapshot a step."""

    positions: list[FloatArray]
    alive: list[BoolArray]
    leaders: list[IntArray]

    def lead(
        self,
        active: IntArray,
        policy: Policy,
        step: int,
        positions: FloatArray,
        previous_velocities: FloatArray,
        alive: BoolArray,
    ) -> None:
        """Append who leads the active runs from here; states are those before the step."""
        rows = active[active < len(self.positions[0])]
        found = np.full(len(self.positions[0]), -1)
        if rows.size:
            found[rows] = policy.leaders(
                step, positions[rows], previous_velocities[rows], alive[rows]
            )
        self.leaders.append(found)

    def record(self, active: IntArray, following: FloatArray, alive: BoolArray) -> None:
        """Append where the active runs are now; the destroyed stay where they fell."""
        positions, moved = self.positions[-1].copy(), self.alive[-1]
        traced = active < len(positions)
        rows = active[traced]
        positions[rows] = np.where(moved[rows, :, None], following[traced], positions[rows])
        self.positions.append(positions)
        self.alive.append(alive[: len(positions)].copy())

    def traces(self, steps: IntArray) -> tuple[RunTrajectory, ...]:
        """The ways up to the steps (R,) at which runs ended."""
        positions, alive = np.stack(self.positions, axis=1), np.stack(self.alive, axis=1)
        leaders = np.array(self.leaders, np.int64).reshape(len(self.leaders), len(positions)).T
        return tuple(
            RunTrajectory(
                positions[run, : steps[run] + 1],
                alive[run, : steps[run] + 1],
                leaders[run, : steps[run]],
            )
            for run in range(len(positions))
        )
