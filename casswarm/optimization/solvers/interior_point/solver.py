"""The interior-point method as a solver."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache, partial
from typing import Any, ClassVar

from ...problem import Instances, Nlp
from ..base import Answer, Capabilities, Solver
from ..options import NonNegativeInt, Positive
from .engine import minimise
from .iterates import Options, Results
from .problems import CasadiProblems

_ENTRIES = 1 << 22  # of the matrices of instances that are solved together


@dataclass(frozen=True)
class FilterInteriorPoint(Solver):
    """Primal-dual interior point with a filter line search; all instances advance together.

    The method of Ipopt (Waechter, Biegler, Math. Program. 106(1), 2006), without its scaling and
    restoration phase, with exact second derivatives and dense matrices: for programs of up to some
    hundred variables.

    Parameters
    ----------
    tolerance : float
        Of the optimality conditions, relative to large multipliers.
    constraint_tolerance : float
        Largest violation of a constraint.
    max_iter : int
    mu_init : float
        Initial barrier parameter: a smaller one stays nearer to a good guess.
    bound_push : float
        Relative distance by which the initial guess is moved away from its bounds.
    """

    tolerance: Positive = 1e-8
    constraint_tolerance: Positive = 1e-8
    max_iter: NonNegativeInt = 500
    mu_init: Positive = 0.1
    bound_push: Positive = 0.01

    name: ClassVar[str] = "interior-point"
    summary: ClassVar[str] = "interior point over batches, exact derivatives; any problem"
    capabilities: ClassVar[Capabilities] = Capabilities(batch=True, multipliers=True)

    def run(self, nlp: Nlp, instances: Instances) -> Sequence[Answer]:
        """Solve batches of instances whose matrices fit in a cache."""
        size = max(1, _ENTRIES // max(1, nlp.sizes[0]) ** 2)
        answers: list[Answer] = []
        with _blas_threads().limit(limits=1, user_api="blas"):
            for first in range(0, len(instances), size):
                answers += self._answers(nlp, instances[first : first + size])
        return answers

    def _answers(self, nlp: Nlp, instances: Instances) -> list[Answer]:
        started = time.perf_counter()
        problems = (nlp.numeric or partial(CasadiProblems, nlp))(instances.p)
        options = Options(
            self.tolerance,
            self.constraint_tolerance,
            self.mu_init,
            self.bound_push,
            self.max_iter,
        )
        results = minimise(problems, instances, options)
        seconds = (time.perf_counter() - started) / len(instances)
        return [self._answer(results, i, seconds) for i in range(len(instances))]

    @staticmethod
    def _answer(results: Results, i: int, seconds: float) -> Answer:
        return Answer(
            results.x[i],
            results.status[i],
            results.message[i],
            int(results.iterations[i]),
            int(results.evaluations[i]),
            seconds,
            (results.lam_x[i], results.lam_g[i]),
        )


@cache
def _blas_threads() -> Any:
    """The thread pools of BLAS: several would wait for each other on a busy machine."""
    from threadpoolctl import ThreadpoolController

    return ThreadpoolController()
