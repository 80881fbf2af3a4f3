"""Trajectories of runs: positions, living members and leaders at every step."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..policies.base import Policy
from ..policies.decision import policy_call
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


class TrajectoryRecorder:
    """Snapshots of runs at every step, from their initial states (R)."""

    def __init__(self, states: States) -> None:
        self.runs = len(states)
        self.positions, self.alive = [states.positions], [states.alive]
        self.leaders: list[IntArray] = []

    def record(
        self,
        policy: Policy,
        step: int,
        rows: IntArray,
        states: States,
        following: FloatArray,
        alive: BoolArray,
    ) -> None:
        """Append a step: of the runs `rows`, their states before it, and what follows.

        The destroyed stay where they are, and so do all members of other runs.
        """
        positions, survivors = self.positions[-1].copy(), self.alive[-1].copy()
        leaders = np.full(self.runs, -1)
        if rows.size:
            with policy_call(policy.name, step):
                leaders[rows] = policy.leaders(
                    step, states.positions, states.previous_velocities, states.alive
                )
        living = states.alive[..., None]
        positions[rows] = np.where(living, following, positions[rows])
        survivors[rows] = alive
        self.positions.append(positions)
        self.alive.append(survivors)
        self.leaders.append(leaders)

    def trajectories(self, steps: IntArray) -> tuple[RunTrajectory, ...]:
        """Trajectories up to the steps (R,) at which runs ended."""
        positions, alive = np.stack(self.positions, axis=1), np.stack(self.alive, axis=1)
        leaders = np.array(self.leaders, np.int64).reshape(len(self.leaders), self.runs).T
        return tuple(
            RunTrajectory(positions[k, : end + 1], alive[k, : end + 1], leaders[k, :end])
            for k, end in enumerate(steps[: self.runs])
        )
