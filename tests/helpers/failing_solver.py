"""Ipopt that fails in some instances."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from casswarm.nlp import Instances, Nlp, Status
from casswarm.solvers import Answer, Ipopt, Solver


class Failing(Solver):
    """Ipopt whose answers are replaced by one number where a function of instances says so."""

    name = "failing"

    def __init__(
        self,
        fails: Callable[[Nlp, Instances], list[bool]],
        x: float = np.nan,
        status: Status = Status.DIVERGED,
    ) -> None:
        self.fails, self.x, self.status = fails, x, status

    def run(self, nlp: Nlp, instances: Instances) -> list[Answer]:
        answers = Ipopt().timed_answers(nlp, instances)[1]
        return [
            Answer(np.full_like(answer.x, self.x), self.status, "no mood", 0, 0, 0.0)
            if failed
            else answer
            for answer, failed in zip(answers, self.fails(nlp, instances), strict=True)
        ]
