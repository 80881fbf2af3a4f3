"""The default: the batch solver proposes, every answer is judged, Ipopt solves what is left."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import ClassVar

import numpy as np

from ..nlp import Instances, Nlp
from ..solution import BatchSolution
from .base import VIOLATION, Answer, Solver
from .ipopt import Ipopt
from .spectral import SpectralProjectedGradient


@dataclass(frozen=True)
class Auto(Solver):
    """`SpectralProjectedGradient` where it applies, and `Ipopt` for everything else.

    An answer whose recomputed residuals are above tolerance is solved again by Ipopt from there,
    and counted as resolved. Problems that the batch solver cannot take go to Ipopt whole.

    Parameters
    ----------
    stationarity : float
        Residual up to which an answer of the batch solver is accepted.
    batch : SpectralProjectedGradient
    judge : Ipopt
    """

    stationarity: float = 1e-6
    batch: SpectralProjectedGradient = field(default_factory=SpectralProjectedGradient)
    judge: Ipopt = field(default_factory=Ipopt)

    name: ClassVar[str] = "auto"
    summary: ClassVar[str] = "spectral, every answer judged, the rest solved again by ipopt"

    def _build(self, nlp: Nlp) -> None:
        """Nothing: each of the two builds what it needs when it is needed."""

    def _run(self, nlp: Nlp, instances: Instances) -> Sequence[Answer]:
        if not self.batch.can_take(nlp, instances):
            return self.judge._answers(nlp, instances)
        answers = self.batch._answers(nlp, instances)
        return [
            answer
            if answer.status.success
            else self.judge._answers(nlp, instances[i : i + 1].restarted(answer.x[None]))[0]
            for i, answer in enumerate(answers)
        ]

    def solve_batch(self, nlp: Nlp, instances: Instances) -> BatchSolution:
        """Solve every instance; `BatchSolution.resolved` tells which needed Ipopt."""
        if not self.batch.can_take(nlp, instances):
            return self.judge.solve_batch(nlp, instances)
        found = self.batch.solve_batch(nlp, instances)
        accepted = found.success | (
            (found.stationarity <= self.stationarity) & (found.violation <= VIOLATION)
        )
        left = np.flatnonzero(~accepted)
        found = replace(found, success=accepted)
        if not left.size:
            return found
        usable = np.isfinite(found.x[left]).all(axis=1, keepdims=True)
        start = np.where(usable, found.x[left], instances.start[left])
        again = self.judge.solve_batch(nlp, instances[left].restarted(start))
        return found.with_rows(left, replace(again, resolved=np.ones(left.size, bool)))
