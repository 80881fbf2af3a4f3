"""The default: the batch solver proposes, every answer is judged, Ipopt solves what is left."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import ClassVar

import numpy as np

from ...typing import FloatArray
from ..problem import Instances, Nlp
from ..solution import BatchSolution
from .base import Answer, Capabilities, Solver
from .batch.engine import BatchRun, BatchSolver
from .batch.interior_point import InteriorPoint
from .batch.spg import SpectralProjectedGradient
from .ipopt import Ipopt


@dataclass(frozen=True)
class Auto(Solver):
    """The batch solver that applies, and `Ipopt` for everything else.

    What counts is an answer's recomputed residuals, not what the batch solver says of it: one that
    is above tolerance is solved again by Ipopt from there, and counted as resolved. Problems that
    the batch solver cannot take go to Ipopt whole.

    Parameters
    ----------
    stationarity : float
        Residual up to which an answer of the batch solver is accepted.
    batch : SpectralProjectedGradient
    paths : Barrier
        The batch solver of problems over paths.
    fallback : Ipopt
    """

    stationarity: float = 1e-6
    batch: SpectralProjectedGradient = field(default_factory=SpectralProjectedGradient)
    paths: InteriorPoint = field(default_factory=InteriorPoint)
    fallback: Ipopt = field(default_factory=Ipopt)

    name: ClassVar[str] = "auto"
    summary: ClassVar[str] = "spectral, every answer judged, the rest solved again by ipopt"
    capabilities: ClassVar[Capabilities] = Capabilities(batch=True)

    def prepare(self, nlp: Nlp) -> None:
        """Nothing: each of the two builds what it needs when it is needed."""

    def run(self, nlp: Nlp, instances: Instances) -> Sequence[Answer]:
        """See `Solver.run`."""
        batch = self._batch(nlp, instances)
        if batch is None:
<<<<<<< HEAD
            return self.fallback.timed_answers(nlp, instances)[1]
=======
            return self.judge._answers(nlp, instances)
>>>>>>> 93b68db (Make kernels ordinary Numba functions that take the objective as an argument)
        run = batch.run_batch(nlp, instances)
        found = self._accepted(run)
        answers = run.answers()
        for i in np.flatnonzero(~found.success):
            again = _restarted(instances[i : i + 1], answers[i].x[None])
            (answers[i],) = self.fallback.timed_answers(nlp, again)[1]
        return answers

    def solve_batch(self, nlp: Nlp, instances: Instances) -> BatchSolution:
        """Solve every instance; `BatchSolution.used_fallback` tells which needed Ipopt."""
        batch = self._batch(nlp, instances)
        if batch is None:
<<<<<<< HEAD
            return self.fallback.solve_batch(nlp, instances)
=======
            return self.judge.solve_batch(nlp, instances)
>>>>>>> 93b68db (Make kernels ordinary Numba functions that take the objective as an argument)
        found = self._accepted(batch.run_batch(nlp, instances))
        left = np.flatnonzero(~found.success)
        if not left.size:
            return found
        again = self.fallback.solve_batch(nlp, _restarted(instances[left], found.x[left]))
        return found.with_rows(left, replace(again, used_fallback=np.ones(left.size, bool)))

    def _batch(self, nlp: Nlp, instances: Instances) -> BatchSolver | None:
        """The batch solver that can take the problem, None where none can."""
        if self.batch.can_take(nlp, instances):
            return self.batch
        return self.paths if self.paths.can_take(nlp, instances) else None

    def _accepted(self, run: BatchRun) -> BatchSolution:
        """The batch's answers, a success where the residuals are small, whatever it says."""
        return run.solution(run.verified[:, 2] <= self.stationarity)


def _restarted(instances: Instances, x: FloatArray) -> Instances:
    """The instances from x, or from their own start where x is not finite."""
    usable = np.isfinite(x).all(axis=1, keepdims=True)
    return instances.with_x0(np.where(usable, x, instances.x0))
