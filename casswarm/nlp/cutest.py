"""Problems of the CUTEst collection: those of PyCUTEst, and of S2MPJ's translation to Python."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from .._util.user_code import USER_ERRORS, failure_text
from ..errors import ProblemError
from ..typing import FloatArray
from .black_box import BlackBox, BlackBoxNlp
from .conversion import START, require_solvable
from .program import Instances

INFINITE = 1e20
"""CUTEst's infinity: bounds of at least this size are none."""

Posed = tuple[BlackBoxNlp, dict[str, Instances]]


class PyCutestBox(BlackBox):
    """Functions of a `pycutest.CUTEstProblem`; unpickled, the problem is imported again."""

    def __init__(self, problem: Any) -> None:
        self.problem, self.n, self.m = problem, int(problem.n), int(problem.m)

    def __reduce__(self) -> tuple[Any, ...]:
        problem = self.problem
        options = {
            "sifParams": problem.sifParams or None,
            "sifOptions": problem.sifOptions or None,
            "drop_fixed_variables": problem.drop_fixed_vars,
        }
        return _imported_box, (problem.name, options)

    def values(self, x: FloatArray) -> FloatArray:
        """See `BlackBox.values`."""
        rows = np.ravel(self.problem.cons(x)) if self.m else np.empty(0)
        return np.append(float(self.problem.obj(x)), rows)

    def jacobian(self, x: FloatArray) -> FloatArray:
        """See `BlackBox.jacobian`."""
        gradient = np.atleast_2d(self.problem.obj(x, gradient=True)[1])
        return gradient if not self.m else np.vstack([gradient, self.problem.lagjac(x)[1]])

    def hessian(self, x: FloatArray, weights: FloatArray) -> FloatArray:
        """See `BlackBox.hessian`."""
        if not self.m:
            return np.asarray(weights[0] * self.problem.hess(x))
        lagrangian = self.problem.hess(x, v=np.array(weights[1:]))  # of f + weights g
        if weights[0] == 1.0:
            return np.asarray(lagrangian)
        return np.asarray(lagrangian + (weights[0] - 1.0) * self.problem.ihess(x))


class S2mpjBox(BlackBox):
    """Functions of an instance of a problem's class in S2MPJ."""

    def __init__(self, problem: Any) -> None:
        self.problem, self.n, self.m = problem, int(problem.n), int(problem.m)
        self.has_objective = len(getattr(problem, "objgrps", ())) > 0 or hasattr(problem, "H")

    def values(self, x: FloatArray) -> FloatArray:
        """See `BlackBox.values`."""
        objective = self.problem.fx(x) if self.has_objective else 0.0
        rows = np.ravel(self.problem.cx(x)) if self.m else np.empty(0)
        return np.append(np.ravel(objective), rows)

    def jacobian(self, x: FloatArray) -> FloatArray:
        """See `BlackBox.jacobian`."""
        derivatives = np.zeros((1 + self.m, self.n))
        if self.has_objective:
            derivatives[0] = np.ravel(self.problem.fgx(x)[1])
        if self.m:
            derivatives[1:] = _dense(self.problem.cJx(x)[1])
        return derivatives

    def hessian(self, x: FloatArray, weights: FloatArray) -> FloatArray:
        """See `BlackBox.hessian`."""
        total = np.zeros((self.n, self.n))
        if self.has_objective:
            total += weights[0] * _dense(self.problem.fgHx(x)[2])
        if self.m:
            for weight, hessian in zip(weights[1:], self.problem.cJHx(x)[2], strict=True):
                total += weight * _dense(hessian)
        return total


def from_pycutest(problem: Any, parameters: Mapping[str, Any], name: str | None) -> Posed:
    """Program and start of a problem of PyCUTEst, or of its name.

    Raises
    ------
    ProblemError
        See `casswarm.comparison.Problem.from_pycutest`.
    """
    if isinstance(problem, str):
        problem = _imported(problem, {"sifParams": dict(parameters) or None})
    elif parameters:
        raise ProblemError(f"parameters {', '.join(parameters)} are for the name of a problem")
    _require_attributes(problem, ("obj", "vartype", "bl", "bu", "x0"), "a problem of PyCUTEst")
    name = name or problem.name
    if np.any(problem.vartype):
        raise ProblemError(
            f"problem {name!r} has integer variables; only continuous ones are supported"
        )
    rows = (problem.cl, problem.cu) if problem.m else ((), ())
    return _posed(PyCutestBox(problem), name, (problem.x0, problem.bl, problem.bu, *rows))


def from_s2mpj(problem: Any, name: str | None) -> Posed:
    """Program and start of a problem of S2MPJ.

    Raises
    ------
    ProblemError
        See `casswarm.comparison.Problem.from_s2mpj`.
    """
    names = ("xlower", "xupper", "x0", "pbclass")
    _require_attributes(problem, names, "an instance of a problem's class in S2MPJ, such as HS71()")
    name = name or problem.name
    if not problem.pbclass.startswith("C-"):
        raise ProblemError(
            f"problem {name!r} has the class {problem.pbclass}, with integer variables; "
            "only continuous ones are supported"
        )
    orders = [getattr(problem, "objderlvl", 2), *getattr(problem, "conderlvl", [2])]
    if min(orders) < 2:
        raise ProblemError(f"problem {name!r} has no exact second derivatives")
    rows = (problem.clower, problem.cupper) if problem.m else ((), ())
    return _posed(S2mpjBox(problem), name, (problem.x0, problem.xlower, problem.xupper, *rows))


def _posed(box: BlackBox, name: str, numbers: tuple[Any, ...]) -> Posed:
    """Program and start of a black box, and of x0, lbx, ubx, lbg and ubg."""
    x0, *bounds = (np.asarray(part, dtype=float).reshape(1, -1) for part in numbers)
    lbx, ubx, lbg, ubg = (
        np.where(abs(part) >= INFINITE, np.copysign(np.inf, part), part) for part in bounds
    )
    starts = {START: Instances(x0, np.empty((1, 0)), lbx, ubx, lbg, ubg)}
    nlp = BlackBoxNlp.of(name, box)
    require_solvable(nlp, starts, name)
    return nlp, starts


def _imported_box(name: str, options: dict[str, Any]) -> PyCutestBox:
    return PyCutestBox(_imported(name, options))


def _imported(name: str, options: dict[str, Any]) -> Any:
    """The problem of a name, compiled by PyCUTEst where it has not been."""
    try:
        import pycutest
    except ImportError as error:  # of it, or of CUTEst, which it looks for
        raise ProblemError(
            f"problem {name!r} needs PyCUTEst, with CUTEst and a Fortran compiler: {error}"
        ) from error
    except USER_ERRORS as error:
        raise ProblemError(f"PyCUTEst cannot be imported: {failure_text(error)}") from error
    try:
        return pycutest.import_problem(name, **options)
    except USER_ERRORS as error:
        raise ProblemError(
            f"PyCUTEst cannot import the problem {name!r}: {failure_text(error)}"
        ) from error


def _require_attributes(problem: Any, names: tuple[str, ...], what: str) -> None:
    missing = [name for name in names if not hasattr(problem, name)]
    if missing:
        raise ProblemError(f"{problem!r} is not {what}: it has no attribute {missing[0]}")


def _dense(matrix: Any) -> FloatArray:
    return np.asarray(matrix.toarray() if hasattr(matrix, "toarray") else matrix, dtype=float)
