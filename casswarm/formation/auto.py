"""The default: a batch solver where one applies, and Ipopt for the rest."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import ClassVar

import numpy as np
from typing_extensions import override

from ..nlp.program import Instances, Nlp
from ..nlp.solution import BatchSolution
from ..solvers.base import Answer, Capabilities, Iterates, Solver
from ..solvers.casadi_plugins import Ipopt
from ..typing import FloatArray
from .horizon_method import InteriorPoint
from .objective import CompiledObjective
from .projected_gradient import BatchRun, BatchSolver, SpectralProjectedGradient


@dataclass(frozen=True)
class Auto(Solver):
    """The batch solver that applies, and `Ipopt` for everything else.

    An answer of a batch solver is accepted by its recomputed residuals, not by the status that the
    solver reports: an instance above tolerance is solved again by Ipopt from that answer, and
    counted as a fallback. Problems that no batch solver can take go to Ipopt: those whose hazard is
    not composed of kernels.

    Parameters
    ----------
    stationarity : float
        Residual up to which an answer of the batch solver is accepted.
    batch : SpectralProjectedGradient
        For products of planar sets.
    paths : InteriorPoint
        For trajectories.
    fallback : Ipopt
    """

    stationarity: float = 1e-6
    batch: SpectralProjectedGradient = field(default_factory=SpectralProjectedGradient)
    paths: InteriorPoint = field(default_factory=InteriorPoint)
    fallback: Ipopt = field(default_factory=Ipopt)

    name: ClassVar[str] = "auto"
    summary: ClassVar[str] = "spectral or barrier, every answer verified; ipopt for the rest"
    capabilities: ClassVar[Capabilities] = Capabilities(batch=True)

    @override
    def prepare(self, nlp: Nlp) -> None:
        compiled = nlp.attached(CompiledObjective) is not None
        (self.batch if compiled else self.fallback).prepare(nlp)

    @override
    def run(self, nlp: Nlp, instances: Instances) -> Sequence[Answer]:
        batch = self._batch(nlp, instances)
        if batch is None:
            return self.fallback.timed_answers(nlp, instances)[1]
        run = batch.run_batch(nlp, instances)
        answers = run.answers()
        for i in np.flatnonzero(~self._accepted(run).success):
            again = _restarted(instances[i : i + 1], answers[i].x[None])
            (answers[i],) = self.fallback.timed_answers(nlp, again)[1]
        return answers

    def iterates(self, nlp: Nlp, instance: Instances) -> Iterates | None:
        """See `Solver.iterates`; batch solvers report none."""
        alone = self._batch(nlp, instance) is None
        return self.fallback.iterates(nlp, instance) if alone else None

    def solve_batch(
        self, nlp: Nlp, instances: Instances, *, sensitivities: bool = False
    ) -> BatchSolution:
        """Solve every instance; `BatchSolution.used_fallback` marks those that needed Ipopt."""
        if sensitivities:
            return super().solve_batch(nlp, instances, sensitivities=True)
        batch = self._batch(nlp, instances)
        if batch is None:
            return self.fallback.solve_batch(nlp, instances)
        solution = self._accepted(batch.run_batch(nlp, instances))
        left = np.flatnonzero(~solution.success)
        if not left.size:
            return solution
        again = self.fallback.solve_batch(nlp, _restarted(instances[left], solution.x[left]))
        return solution.with_rows(left, replace(again, used_fallback=np.ones(left.size, bool)))

    def located(self, nlp: Nlp, instances: Instances) -> FloatArray:
        """The batch solver's answers (B, nx), or the initial guesses where none applies."""
        batch = self._batch(nlp, instances)
        return instances.x0 if batch is None else batch.run_batch(nlp, instances).results.x

    def _batch(self, nlp: Nlp, instances: Instances) -> BatchSolver | None:
        """The batch solver that applies to the problem; None if none does."""
        if self.batch.can_take(nlp, instances):
            return self.batch
        return self.paths if self.paths.can_take(nlp, instances) else None

    def _accepted(self, run: BatchRun) -> BatchSolution:
        """The answers of the batch, a success where the residuals are small."""
        return run.solution(run.results.verified[:, 2] <= self.stationarity)


def _restarted(instances: Instances, x: FloatArray) -> Instances:
    """The instances from x, or from their own start where x is not finite."""
    usable = np.isfinite(x).all(axis=1, keepdims=True)
    return instances.with_x0(np.where(usable, x, instances.x0))
