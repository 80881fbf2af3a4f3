"""SciPy's SLSQP, with exact derivatives and a time limit."""

from __future__ import annotations

import time
import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from ..._util.threads import one_at_a_time
from ...typing import FloatArray
from ..problem import Instances, Nlp
from ..solution import Status
from .base import Answer, Capabilities, Solver, error_text
from .options import Positive, PositiveInt


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
    # by OptimizeResult.message; an incompatible quadratic subproblem proves nothing
    statuses: ClassVar[dict[str, Status]] = {
        "Optimization terminated successfully": Status.SOLVED,
        "Iteration limit reached": Status.ITERATION_LIMIT,
    }

    def prepare(self, nlp: Nlp) -> None:
        """See `Solver.prepare`."""
        _ = nlp.evaluate, nlp.gradient, nlp.jacobian

    def run(self, nlp: Nlp, instances: Instances) -> Sequence[Answer]:
        """See `Solver.run`."""
        return [self._solve(nlp, instances[i : i + 1]) for i in range(len(instances))]

    @one_at_a_time  # filters of warnings are the process's
    def _solve(self, nlp: Nlp, instance: Instances) -> Answer:
        # slow to import, and seldom needed
        from scipy.optimize import Bounds, NonlinearConstraint, minimize

        started = time.perf_counter()
        functions = _Functions(nlp, instance, started + self.time_limit)

        def answer(x: FloatArray, status: Status, message: str, iterations: int = 0) -> Answer:
            seconds = time.perf_counter() - started
            return Answer(x, status, message, iterations, functions.evaluations, seconds)

        if not (instance.lbx <= instance.ubx).all() or not np.isfinite(functions.x0).all():
            message = "bounds cross, or bounds or start are not finite"
            return answer(functions.last, Status.FAILED, message)
        rows = NonlinearConstraint(
            functions.rows, instance.lbg[0], instance.ubg[0], functions.jacobian
        )
        try:
            with warnings.catch_warnings(), np.errstate(all="ignore"):
                warnings.simplefilter("ignore")  # the answer's status reports what they warn of
                result = minimize(
                    functions.objective,
                    functions.x0,
                    method="SLSQP",
                    jac=functions.gradient,
                    bounds=Bounds(instance.lbx[0], instance.ubx[0]),
                    constraints=[rows] if instance.lbg.size else [],
                    options={"ftol": self.tolerance, "maxiter": self.max_iter},
                )
        except _OutOfTimeError:
            message = f"no answer in {self.time_limit:g} s"
            return answer(functions.last, Status.TIME_LIMIT, message)
        except (ValueError, ArithmeticError, np.linalg.LinAlgError) as error:
            return answer(functions.last, Status.FAILED, error_text(error))
        status = self.statuses.get(result.message, Status.FAILED)
        return answer(np.asarray(result.x, float), status, str(result.message), int(result.nit))


class _OutOfTimeError(Exception):
    """Raised in an evaluation and caught around the minimiser, which has no time limit."""


class _Functions:
    """The functions of a single instance; f and g are evaluated together, once at a point.

    After the deadline, an evaluation of the objective raises `_OutOfTimeError`.
    """

    def __init__(self, nlp: Nlp, instance: Instances, deadline: float) -> None:
        self.nlp, self.instance = nlp, instance
        self.x0 = np.clip(instance.x0[0], instance.lbx[0], instance.ubx[0])
        self.last = self.x0
        self.evaluations = 0
        self._deadline = deadline
        self._values: Any = None

    def objective(self, x: FloatArray) -> float:
        """Value of f at x."""
        if time.perf_counter() > self._deadline:
            raise _OutOfTimeError
        return float(self._evaluate(x)[0])

    def gradient(self, x: FloatArray) -> FloatArray:
        """Gradient of f at x, (nx,)."""
        return np.asarray(self.nlp.gradient(x, self.instance.p[0])[1]).ravel()

    def rows(self, x: FloatArray) -> FloatArray:
        """Values of g at x, (ng,)."""
        return np.asarray(self._evaluate(x)[1]).ravel()

    def jacobian(self, x: FloatArray) -> FloatArray:
        """Jacobian of g at x, (ng, nx)."""
        return np.asarray(self.nlp.jacobian(x, self.instance.p[0]))

    def _evaluate(self, x: FloatArray) -> Any:
        if self._values is None or not np.array_equal(x, self.last):
            self.evaluations += 1
            self.last = np.array(x)
            self._values = self.nlp.evaluate(x, self.instance.p[0])
        return self._values
