"""What the compiled batch solvers share: outcomes, and answers from arrays."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ....typing import BoolArray, FloatArray, IntArray
from ...problem import Instances, Nlp
from ...solution import BatchSolution, Status
from ..base import VIOLATION, Answer, Solver
from .outcome_kernels import CONVERGED, EXHAUSTED, NO_INTERIOR, NOT_FINITE, STALLED

_MESSAGES = {
    CONVERGED: (Status.SOLVED, "stationary to tolerance"),
    EXHAUSTED: (Status.ITERATION_LIMIT, "iterations exhausted"),
    STALLED: (Status.FAILED, "no decrease along the search direction"),
    NOT_FINITE: (Status.FAILED, "objective, gradient or step not finite"),
    NO_INTERIOR: (Status.FAILED, "no point strictly within the limits"),
}


class Results(NamedTuple):
    """What a kernel writes for B instances.

    Parameters
    ----------
    x : (B, ...)
    verified : (B, 3)
        Objective, violation and stationarity, recomputed from the problem alone.
    outcome : (B,)
    counts : (B, 2)
        Iterations and evaluations.
    """

    x: FloatArray
    verified: FloatArray
    outcome: IntArray
    counts: IntArray

    @classmethod
    def empty(cls, shape: tuple[int, ...]) -> Results:
        """Arrays to be written, for x of this shape."""
        batch = shape[0]
        outcome, counts = np.empty(batch, np.int64), np.zeros((batch, 2), np.int64)
        return cls(np.empty(shape), np.empty((batch, 3)), outcome, counts)


@dataclass(frozen=True, eq=False)
class BatchRun:
    """The answers of one batch: results with x as (B, nx), and the time they took."""

    results: Results
    seconds: float

    def solution(self, success: BoolArray) -> BatchSolution:
        """The answers as arrays; one that violates its constraints is never a success."""
        objective, violation, stationarity = self.results.verified.T
        return BatchSolution(
            x=self.results.x,
            objective=objective,
            success=success & (violation <= VIOLATION),
            violation=violation,
            stationarity=stationarity,
            used_fallback=np.zeros(len(success), bool),
            seconds=self.seconds,
            messages=np.full(len(success), "", dtype=object),
        )

    def answers(self) -> list[Answer]:
        """The answers one by one."""
        x, _, outcome, counts = self.results
        return [
            Answer(
                x[i],
                *_MESSAGES[int(outcome[i])],
                iterations=int(counts[i, 0]),
                evaluations=int(counts[i, 1]),
                seconds=self.seconds / len(x),
                multipliers=self.multipliers(i),
            )
            for i in range(len(x))
        ]

    def multipliers(self, i: int) -> tuple[FloatArray, FloatArray] | None:  # noqa: ARG002
        """Multipliers of the bounds and of g of an instance, where the method has them."""
        return None


class BatchSolver(Solver):
    """A solver that advances all instances together, for compiled objectives only."""

    @staticmethod
    @abstractmethod
    def can_take(nlp: Nlp, instances: Instances) -> bool:
        """Whether the objective is compiled and the feasible set is of the solver's kind."""

    @abstractmethod
    def run_batch(self, nlp: Nlp, instances: Instances) -> BatchRun:
        """Solve and verify every instance; SolverError where `can_take` is False."""

    def prepare(self, nlp: Nlp) -> None:
        """See `Solver.prepare`."""
        if nlp.compiled is not None:
            _ = nlp.compiled.evaluate

    def run(self, nlp: Nlp, instances: Instances) -> Sequence[Answer]:
        """See `Solver.run`."""
        return self.run_batch(nlp, instances).answers()

    def solve_batch(self, nlp: Nlp, instances: Instances) -> BatchSolution:
        """Solve every instance; residuals are recomputed from the problem, in its scale."""
        run = self.run_batch(nlp, instances)
        return run.solution(run.results.outcome == CONVERGED)
