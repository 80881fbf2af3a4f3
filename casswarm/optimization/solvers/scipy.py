"""SciPy's SLSQP, with exact derivatives and a time limit."""

from __future__ import annotations

import time
import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
from scipy import sparse

from ...typing import FloatArray
from ..problem import Instances, Nlp
from ..solution import Status
from .base import Answer, Capabilities, Solver
from .options import Positive, PositiveInt

STATUS = {
    "Optimization terminated successfully": Status.SOLVED,
    "Iteration limit reached": Status.ITERATION_LIMIT,
}
"""Status by OptimizeResult.message; an incompatible quadratic subproblem proves nothing."""


@dataclass(frozen=True)
class Slsqp(Solver):
    """SLSQP (Kraft, DFVLR-FB 88-28, 1988): BFGS and least-squares subproblems, dense.

    Parameters
    ----------
    tolerance : float
        SciPy's ``ftol``: of the objective's change and of the constraints.
    max_iter : int
    time_limit : float
        Wall time of one solve, in seconds.
    """

    tolerance: Positive = 1e-8
    max_iter: PositiveInt = 1000
    time_limit: Positive = 60.0

    name: ClassVar[str] = "slsqp"
    summary: ClassVar[str] = "SciPy's dense SQP with BFGS, exact gradients; any problem"
    capabilities: ClassVar[Capabilities] = Capabilities(time_limit=True)

    def prepare(self, nlp: Nlp) -> None:
        """See `Solver.prepare`."""
        _ = nlp.evaluate, nlp.gradient, nlp.jacobian

    def run(self, nlp: Nlp, instances: Instances) -> Sequence[Answer]:
        """See `Solver.run`."""
        return [self._solve(nlp, instances[i : i + 1]) for i in range(len(instances))]

    def _solve(self, nlp: Nlp, instance: Instances) -> Answer:
        started = time.perf_counter()
        functions = _Functions(nlp, instance, started + self.time_limit)

        def failure(status: Status, message: str) -> Answer:
            seconds = time.perf_counter() - started
            return Answer(functions.last, status, message, 0, functions.evaluations, seconds)

        if not (instance.lbx <= instance.ubx).all() or not np.isfinite(functions.x0).all():
            return failure(Status.FAILED, "bounds cross, or bounds or start are not finite")
        try:
            with warnings.catch_warnings(), np.errstate(all="ignore"):
                warnings.simplefilter("ignore")  # the answer's status reports what they warn of
                result = self._minimize(functions)
        except _OutOfTimeError:
            return failure(Status.TIME_LIMIT, f"no answer in {self.time_limit:g} s")
        except (ValueError, ArithmeticError, np.linalg.LinAlgError) as error:
            return failure(Status.FAILED, f"{type(error).__name__}: {error}")
        message = str(result.message)
        return Answer(
            x=np.asarray(result.x, dtype=float),
            status=STATUS.get(message, Status.FAILED),
            message=message,
            iterations=int(result.nit),
            evaluations=functions.evaluations,
            seconds=time.perf_counter() - started,
        )

    def _minimize(self, functions: _Functions) -> Any:
        from scipy.optimize import Bounds, minimize  # slow to import, and seldom needed

        return minimize(
            functions.objective,
            functions.x0,
            method="SLSQP",
            jac=functions.gradient,
            bounds=Bounds(functions.instance.lbx[0], functions.instance.ubx[0]),
            constraints=_constraints(functions),
            options={"ftol": self.tolerance, "maxiter": self.max_iter},
        )


class _OutOfTimeError(Exception):
    """Raised in an evaluation and caught around the minimiser, which has no time limit."""


class _Functions:
    """The functions of one instance, each evaluated once at a point.

    Parameters
    ----------
    nlp : Nlp
    instance : Instances
        A single instance.
    deadline : float
        Time after which an evaluation of the objective raises `_OutOfTimeError`.
    """

    def __init__(self, nlp: Nlp, instance: Instances, deadline: float) -> None:
        self.nlp, self.instance = nlp, instance
        self.x0 = np.clip(instance.x0[0], instance.lbx[0], instance.ubx[0])
        self.last = self.x0
        self.evaluations = 0
        self._deadline = deadline
        self._cache: dict[str, tuple[bytes, Any]] = {}

    def objective(self, x: FloatArray) -> float:
        """Value of f at x."""
        if time.perf_counter() > self._deadline:
            raise _OutOfTimeError
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
        if name not in self._cache or self._cache[name][0] != key:
            if name == "evaluate":
                self.evaluations += 1
                self.last = np.array(x)
            self._cache[name] = key, getattr(self.nlp, name)(x, self.instance.p[0])
        return self._cache[name][1]


def _constraints(functions: _Functions) -> list[dict[str, Any]]:
    """Equations as c(x) = 0, and every finite side of the other rows as c(x) >= 0."""
    lower, upper = functions.instance.lbg[0], functions.instance.ubg[0]
    equal = lower == upper
    sides = (
        ("eq", 1.0, lower, equal),
        ("ineq", 1.0, lower, ~equal & np.isfinite(lower)),
        ("ineq", -1.0, upper, ~equal & np.isfinite(upper)),
    )
    return [
        {
            "type": kind,
            "fun": lambda x, s=sign, b=bound, r=rows: s * (functions.rows(x) - b)[r],
            "jac": lambda x, s=sign, r=rows: s * functions.jacobian(x).toarray()[r],
        }
        for kind, sign, bound, rows in sides
        if rows.any()
    ]
