"""The joint plan, with the outcome of every start."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from .._util.display import Displayed
from .._util.text import counted
from ..bounds.success_bound import SuccessBound
from ..guide.frame import Frame
from ..motion.step import Motion
from ..nlp.solution import Solution
from ..typing import FloatArray, IntArray, Interval
from .plan_distribution import CasesDistribution, LikelySets, PlanDistribution

DISTANCE_TOL = 1e-4
"""Relative tolerance of the minimum distance, above a solver's."""


@dataclass(frozen=True, eq=False)
class SwarmOutcome:
    """The outcome of one start of the joint plan.

    Parameters
    ----------
    start : str
        Name of the initial guess.
    arrivals : (n,) int
        The prescribed arrival steps, 0 for a member that cannot arrive.
    velocities : (T, n, 2)
        Within the limits of speed and acceleration.
    value : float
        Value of the objective for these velocities: exact, or the mean field's.
    solution : Solution
        Of the solver; its objective is the log-odds of the cost.
    seconds : float
    separated : bool
        Whether the members keep the minimum distance.
    """

    start: str
    arrivals: IntArray
    velocities: FloatArray
    value: float
    solution: Solution
    seconds: float
    separated: bool = True

    def in_scenario(self, frame: Frame) -> SwarmOutcome:
        """The outcome, with its solution, in the scenario of the frame in which it was found."""
        x = self.solution.x.reshape(-1, len(frame.order), 2)
        return replace(
            self,
            start=frame.renamed(self.start),
            arrivals=self.arrivals[np.argsort(frame.order)],
            velocities=frame.members_from(self.velocities),
            solution=replace(self.solution, x=frame.members_from(x).ravel()),
        )

    def as_row(self) -> dict[str, object]:
        """Scalar values, as a table row; the value is NaN if members come too close."""
        steps = [int(step) for step in self.arrivals]
        return {
            "start": self.start,
            "first_arrival": min(filter(None, steps), default=0),
            "last_arrival": max(steps),
            "value": self.value if self.separated else math.nan,
            "separated": self.separated,
        } | self.solution.as_row()


@dataclass(frozen=True, eq=False, repr=False)
class SwarmPlan(Displayed):
    """Trajectories of all members, which those alive follow whichever members are lost.

    Parameters
    ----------
    scenario : str
        Its name.
    objective : {"success", "arrivals", "survivors"}
        The maximised quantity.
    positions : (T+1, n, 2)
        X(0..T): to the last arrival step, or to the horizon if a member does not arrive.
    velocities : (T, n, 2)
        V(0..T-1).
    initial_velocities : (n, 2)
        V(-1), from which a_max bounds the first change.
    motion : Motion
        The limits of a member's step, and dt.
    arrivals : (n,) int
        First step at which each member is in the target, 0 for one that never is.
    value : float
        Value of the objective: exact, or the mean field's.
    distribution : PlanDistribution, CasesDistribution or None
        The exact distribution, of a hazard that is not known for its prior and in every case; None
        for swarms of more than `casswarm.joint.MAX_EXACT` members.
    solution : Solution
        The solve that this plan results from.
    outcomes : tuple of SwarmOutcome
        The outcome of every start, failures included, in the order of the search; without those
        with coarse time steps, from which it starts.
    bound : SuccessBound or None
        Upper bound on the success probability of every policy; None if it was not computed.
    min_distance : float or None
        Required distance of any two members from step 1 on, if any.
    seconds : float
    likely : LikelySets or None
        Bounds on the success of a swarm too large for an exact distribution.
    """

    scenario: str
    objective: str
    positions: FloatArray
    velocities: FloatArray
    initial_velocities: FloatArray
    motion: Motion
    arrivals: IntArray
    value: float
    distribution: PlanDistribution | CasesDistribution | None
    solution: Solution
    outcomes: tuple[SwarmOutcome, ...] = ()
    bound: SuccessBound | None = None
    min_distance: float | None = None
    seconds: float = 0.0
    likely: LikelySets | None = None

    @property
    def n(self) -> int:
        """Number of members."""
        return int(self.positions.shape[1])

    @property
    def steps(self) -> int:
        """T, the last step of the plan."""
        return len(self.velocities)

    @property
    def success(self) -> Interval | None:
        """Proven bounds on the success probability; up to rounding with an exact distribution.

        None for swarms of more members than `likely_sets` takes: use `casswarm.estimate` for those.
        """
        proven = self.distribution or self.likely
        return None if proven is None else proven.success

    @property
    def least_distance(self) -> float:
        """Least distance of any two members at steps 1..T; infinite for one member."""
        return least_distance(self.positions[1:])

    def __repr__(self) -> str:
        value = f"{self.objective}={self.value:.6f}"
        return f"SwarmPlan({self.scenario!r}, n={self.n}, steps={self.steps}, {value})"

    def __str__(self) -> str:
        end = f"to step {self.steps}"
        missing = self.n - int((self.arrivals > 0).sum())
        if missing:
            end += f", {missing} of {counted(self.n, 'member')} DO NOT ARRIVE"
        if self.min_distance is not None:
            least = self.least_distance
            if least < self.min_distance * (1 - DISTANCE_TOL):
                end += f", members COME WITHIN {least:.4g} of each other"
        if self.distribution is None:
            value = f"{self.objective} {self.value:.4f} by the mean field"
            if self.success is not None:
                low, high = self.success
                value = f"success {low:.6f} to {high:.6f} ({value})"
        else:
            failure = self.distribution.failure
            value = f"success {1.0 - failure:.6f} (failure {failure:.3g})"
            if isinstance(self.distribution, CasesDistribution):
                by_case = (f"{1.0 - case.failure:.4f}" for case in self.distribution.cases)
                value += f", by case {', '.join(by_case)}"
            if self.objective != "success":
                value += f", mean number of {self.objective} {self.value:.4f}"
        bound = "" if self.bound is None else f"; {self.bound}"
        return f"joint plan {end}: {value}{bound}"


def least_distance(positions: FloatArray) -> float:
    """Least distance of any two members at the same step of positions (T, n, 2)."""
    i, j = np.triu_indices(positions.shape[1], 1)
    difference = positions[:, i] - positions[:, j]
    return float(np.hypot(difference[..., 0], difference[..., 1]).min(initial=np.inf))
