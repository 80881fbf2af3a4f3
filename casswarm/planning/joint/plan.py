"""The joint plan, with every start that was tried."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from ...optimization.solution import Solution
from ...problems.formation import Motion
from ...typing import FloatArray, IntArray
from ..bounds.success_bound import SuccessBound
from .distribution import PlanDistribution

NEARLY = 1 - 1e-4
"""Share of a least distance that counts as it, for what a solver's tolerance leaves."""


@dataclass(frozen=True, eq=False)
class SwarmOutcome:
    """The outcome of one start of the joint plan.

    Parameters
    ----------
    origin : str
        Where the start came from.
    arrivals : (n,) int
        The arrival steps that were asked for, 0 for a member that cannot arrive.
    velocities : (T, n, 2)
        Within the limits of speed and acceleration.
    value : float
        What was maximised, as these velocities attain it: exactly, or by the mean field.
    solution : Solution
        Of the solver; its objective is the log-odds of the cost.
    seconds : float
    apart : bool
        Whether the members keep the distance that was asked for.
    """

    origin: str
    arrivals: IntArray
    velocities: FloatArray
    value: float
    solution: Solution
    seconds: float
    apart: bool = True

    def as_row(self) -> dict[str, object]:
        """Plain values for a table."""
        steps = [int(step) for step in self.arrivals]
        return {
            "origin": self.origin,
            "first_arrival": min(filter(None, steps), default=0),
            "last_arrival": max(steps),
            "value": self.value,
            "apart": self.apart,
        } | self.solution.as_row()


@dataclass(frozen=True, eq=False)
class SwarmPlan:
    """Ways of all members: what the living follow, whoever is lost.

    Parameters
    ----------
    scenario : str
        Its name.
    objective : {"success", "arrivals", "survivors"}
        What was maximised.
    positions : (T+1, n, 2)
        X(0..T): to the last arrival step, or to the horizon where a member does not arrive.
    velocities : (T, n, 2)
        V(0..T-1).
    before : (n, 2)
        V(-1), from which the acceleration of the first step counts.
    motion : Motion
        The limits of a member's step, and dt.
    arrivals : (n,) int
        First step at which each member is in the target, 0 for one that never is.
    value : float
        What was maximised: exact, or the mean field's.
    law : PlanDistribution or None
        The exact law; None for swarms of more than `casswarm.planning.joint.solve.MAX_EXACT` members.
    solution : Solution
        Of the start that this plan came from.
    outcomes : tuple of SwarmOutcome
        Of every start, failures included, in the order in which they were tried.
    bound : SuccessBound or None
        What no policy whatever can exceed.
    min_distance : float or None
        Between any two members from step 1 on, where it was asked for.
    seconds : float
    """

    scenario: str
    objective: str
    positions: FloatArray
    velocities: FloatArray
    before: FloatArray
    motion: Motion
    arrivals: IntArray
    value: float
    law: PlanDistribution | None
    solution: Solution
    outcomes: tuple[SwarmOutcome, ...] = field(default=(), repr=False)
    bound: SuccessBound | None = None
    min_distance: float | None = None
    seconds: float = 0.0

    @property
    def n(self) -> int:
        """Number of members."""
        return int(self.positions.shape[1])

    @property
    def steps(self) -> int:
        """T, the last step of the plan."""
        return len(self.velocities)

    @property
    def success(self) -> tuple[float, float] | None:
        """Bracket of the success probability, as wide as rounding; None for large swarms.

        `casswarm.estimate` tells that of large ones.
        """
        return None if self.law is None else self.law.success

    @property
    def least_distance(self) -> float:
        """Least distance of any two members at steps 1..T; infinite for one member."""
        return least_distance(self.positions[1:])

    def __str__(self) -> str:
        arriving = self.arrivals[self.arrivals > 0]
        end = f"to step {self.steps}"
        if len(arriving) < self.n:
            end += f", {self.n - len(arriving)} of {self.n} members DO NOT ARRIVE"
        if self.min_distance is not None and self.least_distance < self.min_distance * NEARLY:
            end += f", members COME WITHIN {self.least_distance:.4g} of each other"
        if self.law is None:
            told = f"{self.objective} {self.value:.4f} by the mean field"
        else:
            failure = self.law.failure
            told = f"success {1.0 - failure:.6f} (failure {failure:.3g})"
            if self.objective != "success":
                told += f", {self.value:.4f} {self.objective} in the mean"
        bound = "" if self.bound is None else f"; {self.bound}"
        return f"joint plan {end}: {told}{bound}"


def least_distance(positions: FloatArray) -> float:
    """Least distance of any two members at the same step of positions (T, n, 2)."""
    i, j = np.triu_indices(positions.shape[1], 1)
    apart = positions[:, i] - positions[:, j]
    return float(np.hypot(apart[..., 0], apart[..., 1]).min(initial=np.inf))
