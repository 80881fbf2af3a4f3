"""What the solvers from SciPy share: exact derivatives from the problem, limits, words."""

from __future__ import annotations

import time
import warnings
from abc import abstractmethod
from collections.abc import Mapping, Sequence
from typing import Any, ClassVar

import numpy as np
from scipy import sparse

from ...typing import FloatArray
from ..problem import Instances, Nlp
from ..solution import Status
from .base import Answer, Solver


class OutOfTimeError(Exception):
    """Raised in an evaluation and caught around the minimiser, which looks at no clock."""


class Functions:
    """The functions of one instance; each is evaluated once at a point, however often it is asked.

    Parameters
    ----------
    nlp : Nlp
    instance : Instances
        One row.
    seconds : float
        Time after which an evaluation of the objective raises `OutOfTimeError`.
    """

    def __init__(self, nlp: Nlp, instance: Instances, seconds: float) -> None:
        self.nlp, self.p = nlp, instance.p[0]
        self.lower, self.upper = instance.lbx[0], instance.ubx[0]
        self.lower_g, self.upper_g = instance.lbg[0], instance.ubg[0]
        self.start = np.clip(instance.x0[0], self.lower, self.upper)
        self.last = self.start
        self.evaluations = 0
        self._deadline = time.perf_counter() + seconds
        self._known: dict[str, tuple[bytes, Any]] = {}

    def objective(self, x: FloatArray) -> float:
        """Value of f at x."""
        if time.perf_counter() > self._deadline:
            raise OutOfTimeError
        return float(self._at("evaluate", x)[0])

    def gradient(self, x: FloatArray) -> FloatArray:
        """Gradient of f at x, (nx,)."""
        return np.asarray(self._at("gradient", x)[1], dtype=float).ravel()

    def rows(self, x: FloatArray) -> FloatArray:
        """Values of g at x, (ng,)."""
        return np.asarray(self._at("evaluate", x)[1], dtype=float).ravel()

    def jacobian(self, x: FloatArray) -> sparse.csr_array:
        """Jacobian of g at x, (ng, nx)."""
        return sparse.csr_array(self._at("jacobian", x).sparse())

    def _at(self, name: str, x: FloatArray) -> Any:
        key = x.tobytes()
        if name not in self._known or self._known[name][0] != key:
            if name == "evaluate":
                self.evaluations += 1
                self.last = np.array(x)
            self._known[name] = key, getattr(self.nlp, name)(x, self.p)
        return self._known[name][1]


class ScipySolver(Solver):
    """A method of `scipy.optimize.minimize`, and a table of its words.

    `max_seconds` is a field of every subclass.
    """

    statuses: ClassVar[Mapping[str, Status]]
    max_seconds: float

    @abstractmethod
    def _minimise(self, functions: Functions) -> Any:
        """SciPy's OptimizeResult."""

    def _build(self, nlp: Nlp) -> None:
        _ = nlp.evaluate, nlp.gradient, nlp.jacobian

    def _run(self, nlp: Nlp, instances: Instances) -> Sequence[Answer]:
        return [self._solve(nlp, instances[i : i + 1]) for i in range(len(instances))]

    def _solve(self, nlp: Nlp, instance: Instances) -> Answer:
        started = time.perf_counter()
        functions = Functions(nlp, instance, self.max_seconds)

        def failure(status: Status, message: str) -> Answer:
            seconds = time.perf_counter() - started
            return Answer(functions.last, status, message, 0, functions.evaluations, seconds)

        if not (instance.lbx <= instance.ubx).all() or not np.isfinite(functions.start).all():
            return failure(Status.FAILED, "bounds cross, or bounds or start are not finite")
        try:
            with warnings.catch_warnings(), np.errstate(all="ignore"):
                warnings.simplefilter("ignore")  # what they warn of, the answer's status tells
                result = self._minimise(functions)
        except OutOfTimeError:
            return failure(Status.TIME_LIMIT, f"no answer in {self.max_seconds:g} s")
        except (ValueError, ArithmeticError, np.linalg.LinAlgError) as error:
            return failure(Status.FAILED, f"{type(error).__name__}: {error}")
        words = str(result.message)
        return Answer(
            x=np.asarray(result.x, dtype=float),
            status=self.statuses.get(words, Status.FAILED),
            message=words,
            iterations=int(result.nit),
            evaluations=functions.evaluations,
            seconds=time.perf_counter() - started,
        )
