"""SciPy's SLSQP and functions like SciPy's minimize, with exact derivatives and a time limit."""

from __future__ import annotations

import time
import warnings
from abc import abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import wraps
from typing import Any, ClassVar

import numpy as np
from typing_extensions import override

from .._util.threads import one_at_a_time
from ..nlp.program import Instances, Nlp
from ..nlp.solution import Status
from ..typing import FloatArray
from .base import (
    Answer,
    Capabilities,
    IterateLog,
    Iterates,
    Positive,
    PositiveInt,
    Solver,
    described,
    error_text,
    settings,
)
from .external import InstanceFunctions


class ScipySolver(Solver):
    """Base of solvers that take functions of arrays, as in `scipy.optimize`."""

    time_limit: float
    capabilities: ClassVar[Capabilities] = Capabilities(time_limit=True)

    @abstractmethod
    def minimise(self, functions: Functions, bounds: Any) -> Any:
        """Result of a solve, as a `scipy.optimize.OptimizeResult`.

        Parameters
        ----------
        functions : Functions
        bounds : scipy.optimize.Bounds
        """

    def status(self, result: Any) -> Status:
        """Status of a result."""
        return Status.SOLVED if result.success else Status.FAILED

    @override
    def prepare(self, nlp: Nlp) -> None:
        _ = nlp.evaluate, nlp.gradient, nlp.jacobian

    @override
    def run(self, nlp: Nlp, instances: Instances) -> Sequence[Answer]:
        return [self._solve(nlp, instances[i : i + 1]) for i in range(len(instances))]

    @override
    def iterates(self, nlp: Nlp, instance: Instances) -> Iterates | None:
        """Points with which the function calls its ``callback``."""
        log = IterateLog()
        self._solve(nlp, instance, log)
        return log.iterates(np.clip(instance.x0[0], instance.lbx[0], instance.ubx[0]))

    @one_at_a_time  # filters of warnings are the process's
    def _solve(self, nlp: Nlp, instance: Instances, log: IterateLog | None = None) -> Answer:
        from scipy.optimize import Bounds  # slow to import, and seldom needed

        started = time.perf_counter()
        functions = Functions(nlp, instance, started + self.time_limit, log)

        def answer(x: FloatArray, status: Status, message: str, iterations: int = 0) -> Answer:
            seconds = time.perf_counter() - started
            return Answer(x, status, message, iterations, functions.evaluations, seconds)

        if not (instance.lbx <= instance.ubx).all() or not np.isfinite(functions.x0).all():
            message = "bounds cross, or bounds or start are not finite"
            return answer(functions.last, Status.FAILED, message)
        bounds = Bounds(functions.lower, functions.upper)
        try:
            with warnings.catch_warnings(), np.errstate(all="ignore"):
                warnings.simplefilter("ignore")  # the answer's status reports what they warn of
                result = self.minimise(functions, bounds)
        except _OutOfTimeError:
            message = f"no answer in {self.time_limit:g} s"
            return answer(functions.last, Status.TIME_LIMIT, message)
        except (ValueError, ArithmeticError, np.linalg.LinAlgError) as error:
            return answer(functions.last, Status.FAILED, error_text(error))
        message = getattr(result, "message", "")
        message = message.decode(errors="replace") if isinstance(message, bytes) else str(message)
        iterations = int(getattr(result, "nit", 0))
        return answer(np.asarray(result.x, float), self.status(result), message, iterations)


@described
@dataclass(frozen=True)
class Slsqp(ScipySolver):
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

    statuses: ClassVar[Mapping[str, Status]]

    @override
    def minimise(self, functions: Functions, bounds: Any) -> Any:
        from scipy.optimize import NonlinearConstraint, minimize  # slow to import

        lower, upper = functions.instance.lbg[0], functions.instance.ubg[0]
        rows = NonlinearConstraint(functions.constraints, lower, upper, functions.dense_jacobian)
        return minimize(
            functions.objective,
            functions.x0,
            method="SLSQP",
            jac=functions.gradient,
            bounds=bounds,
            constraints=[rows] if lower.size else [],
            callback=functions.log,
            options=settings(self),
        )

    @override
    def status(self, result: Any) -> Status:
        return self.statuses.get(result.message, Status.FAILED)


@dataclass(frozen=True, eq=False)
class Minimize(ScipySolver):
    """Any function that is called like `scipy.optimize.minimize`.

    Parameters
    ----------
    function : callable
        ``function(fun, x0, jac=..., bounds=..., constraints=..., **options)`` returns an object
        with x and success, and perhaps message and nit. Bounds are a `scipy.optimize.Bounds`,
        and constraints dictionaries with type ("eq" or "ineq"), fun and jac, as in SciPy.
    options : mapping
        Further arguments of the function, such as ``{"method": "COBYQA"}``.
    time_limit : float
        Wall time of one solve, in seconds, after which an evaluation of the objective ends it.

    Examples
    --------
    >>> import casswarm as csw
    >>> from scipy.optimize import minimize
    >>> csw.solvers.Minimize(minimize, {"method": "trust-constr"}).name
    'minimize'
    """

    function: Callable[..., Any]
    options: Mapping[str, Any] = field(default_factory=dict)
    time_limit: Positive = 60.0

    summary: ClassVar[str] = "a function like SciPy's minimize; any problem"

    @property
    def name(self) -> str:  # type: ignore[override]
        """The function's name."""
        return getattr(self.function, "__name__", type(self.function).__name__)

    @override
    def minimise(self, functions: Functions, bounds: Any) -> Any:
        options = dict(self.options)
        if functions.log is not None:
            options["callback"] = _recorded(functions.log, options.get("callback"))
        return self.function(
            functions.objective,
            functions.x0,
            jac=functions.gradient,
            bounds=bounds,
            constraints=functions.dictionaries(),
            **options,
        )


def _recorded(log: IterateLog, callback: Callable[..., Any] | None) -> Callable[..., Any]:
    """A user's callback, if there is one, that also records the iterates."""
    if callback is None:
        return log

    @wraps(callback)  # SciPy chooses the arguments by the names in the signature
    def both(*args: Any, **keywords: Any) -> Any:
        result = keywords.get("intermediate_result")
        log(args[0] if result is None else result.x)
        return callback(*args, **keywords)

    return both


class _OutOfTimeError(Exception):
    """Raised in an evaluation and caught around the minimiser, which has no time limit."""


class Functions(InstanceFunctions):
    """The functions of a single instance, not scaled, and its start within the bounds.

    After the deadline, an evaluation of the objective raises `_OutOfTimeError`. `log` records the
    iterates, if the minimiser has a callback.
    """

    def __init__(
        self, nlp: Nlp, instance: Instances, deadline: float, log: IterateLog | None = None
    ) -> None:
        super().__init__(nlp, replace(instance, scale=np.ones((1, 2))))
        self.x0 = self.last = np.clip(self.x0, self.lower, self.upper)
        self.log, self._deadline = log, deadline

    @override
    def objective(self, x: FloatArray) -> float:
        if time.perf_counter() > self._deadline:
            raise _OutOfTimeError
        return super().objective(x)

    def dense_jacobian(self, x: FloatArray) -> FloatArray:
        """Jacobian of g at x, (ng, nx)."""
        return np.asarray(self.nlp.jacobian(x, self.p))

    def dictionaries(self) -> list[dict[str, Any]]:
        """The constraints as equations and inequalities, in SciPy's older form."""
        lower, upper = self.instance.lbg[0], self.instance.ubg[0]
        equal = lower == upper
        parts = (
            ("eq", 1.0, equal, lower),
            ("ineq", 1.0, ~equal & np.isfinite(lower), lower),
            ("ineq", -1.0, ~equal & np.isfinite(upper), upper),
        )
        return [
            {
                "type": kind,
                "fun": lambda x, s=sign, r=rows, b=bound: s * (self.constraints(x) - b)[r],
                "jac": lambda x, s=sign, r=rows: s * self.dense_jacobian(x)[r],
            }
            for kind, sign, rows, bound in parts
            if rows.any()
        ]
