"""Trajectories of runs: positions, living members and leaders at every step."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from ..policies.base import Policy
from ..typing import BoolArray, FloatArray, IntArray
from .states import States


@dataclass(frozen=True, eq=False)
class RunTrajectory:
    """Trajectory of one run.

    Parameters
    ----------
    positions : (T+1, n, 2)
        Positions X(0..T); the destroyed stay where they were destroyed.
    alive : (T+1, n) bool
    leaders : (T,) int
        Index of the leader from step t to t + 1, -1 where the policy has no leader.
    """

    positions: FloatArray
    alive: BoolArray
    leaders: IntArray

    def last_steps(self) -> IntArray:
        """Step (n,) at which every member was destroyed, or the last step."""
        steps = len(self.alive) - 1
        return np.where(self.alive[-1], steps, np.argmin(self.alive, axis=0))


@dataclass
class TrajectoryRecorder:
    """Snapshots of the first R runs of a batch.

    Parameters
    ----------
    positions : list of (R, n, 2)
    alive : list of (R, n) bool
    leaders : list of (R,) int
    """

    positions: list[FloatArray]
    alive: list[BoolArray]
    leaders: list[IntArray] = field(default_factory=list)

    @classmethod
    def start(cls, states: States, runs: int) -> TrajectoryRecorder:
        """Recorder of the first `runs` of the runs that start in `states`."""
        return cls([states.positions[:runs].copy()], [states.alive[:runs].copy()])

    def record_leaders(self, active: IntArray, policy: Policy, step: int, states: States) -> None:
        """Append the leaders of the active runs; `states` are those before the step."""
        rows = active[active < len(self.positions[0])]
        leaders = np.full(len(self.positions[0]), -1)
        if rows.size:
            leaders[rows] = policy.leaders(
                step, states.positions[rows], states.previous_velocities[rows], states.alive[rows]
            )
        self.leaders.append(leaders)

    def record_positions(self, active: IntArray, following: FloatArray, alive: BoolArray) -> None:
        """Append the positions of the active runs; the destroyed stay where they are."""
        positions, moved = self.positions[-1].copy(), self.alive[-1]
        recorded = active < len(positions)
        rows = active[recorded]
        positions[rows] = np.where(moved[rows, :, None], following[recorded], positions[rows])
        self.positions.append(positions)
        self.alive.append(alive[: len(positions)].copy())

    def trajectories(self, steps: IntArray) -> tuple[RunTrajectory, ...]:
        """Trajectories up to the steps (R,) at which runs ended."""
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
