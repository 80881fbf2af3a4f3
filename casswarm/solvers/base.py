"""Interface of all solvers: options are checked when a solver is made, answers when it ends.

A field that is annotated with one of the types below, with any ``Annotated[type, Allowed(...)]``
or with a ``Literal`` is checked when the solver is made.
"""

from __future__ import annotations

import time
import tomllib
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, fields, replace
from functools import cache
from math import inf
from pathlib import Path
from types import NoneType
from typing import Annotated, Any, ClassVar, Literal, TypeVar, get_args, get_origin, get_type_hints

import numpy as np
from numpy.typing import ArrayLike

from .._util.interrupts import interruptible
from .._util.text import shown
from .._util.user_code import USER_ERRORS
from ..errors import CasswarmError, SolverError
from ..nlp.program import Instances, Nlp
from ..nlp.residuals import invalid_value, kkt_residuals
from ..nlp.solution import BatchSolution, Residuals, Solution, Status
from ..typing import FloatArray, IntArray


@dataclass(frozen=True)
class Allowed:
    """Condition on an option's value, and its wording in messages."""

    condition: Callable[[Any], bool]
    text: str


Positive = Annotated[float, Allowed(lambda value: value > 0, "above zero")]
PositiveFinite = Annotated[float, Allowed(lambda value: 0 < value < inf, "above zero, finite")]
NonNegative = Annotated[float, Allowed(lambda value: value >= 0, "zero or above")]
PositiveInt = Annotated[int, Allowed(lambda value: value >= 1, "whole numbers from 1")]
Flag = Annotated[bool, Allowed(lambda value: isinstance(value, bool), "True or False")]
NonNegativeInt = Annotated[int, Allowed(lambda value: value >= 0, "zero or above")]


def check_options(solver: Any) -> None:
    """Raise SolverError, with what is allowed, for the first option that is out of range."""
    for option, allowed in _conditions(type(solver)):  # type: ignore[arg-type]
        value = getattr(solver, option)
        if not allowed.condition(value):
            message = f"{solver.name}: {option} = {shown(value)}; allowed: {allowed.text}"
            raise SolverError(message, solver=solver.name, option=option, value=value)


@cache
def _conditions(kind: Any) -> tuple[tuple[str, Allowed], ...]:
    """Every option that has a condition, with the condition."""
    try:
        hints = get_type_hints(kind, include_extras=True)
    except NameError:  # a user's class inside a function, whose annotations cannot be evaluated
        return ()
    names = [field.name for field in fields(kind)]
    return tuple((name, allowed) for name in names for allowed in _allowed(hints[name]))


def _allowed(hint: Any) -> Iterator[Allowed]:
    if get_origin(hint) is Annotated:
        yield from (entry for entry in hint.__metadata__ if isinstance(entry, Allowed))
    elif get_origin(hint) is Literal:
        yield Allowed(get_args(hint).__contains__, " or ".join(map(repr, get_args(hint))))
    elif NoneType in get_args(hint):
        for inner in _allowed(next(part for part in get_args(hint) if part is not NoneType)):
            yield Allowed(lambda v, c=inner.condition: v is None or c(v), f"{inner.text}, or None")  # type: ignore[misc]


_ALL = 50
"""Number of the first iterates that are all kept."""

_RATIO = 1.05
"""Ratio of the numbers of later iterates that are kept."""


@dataclass(frozen=True, eq=False)
class Iterates:
    """Points that a solver visits in one solve: the first ones, some of the later ones, the last.

    Parameters
    ----------
    numbers : (K,)
        Of the iterations, increasing; 0 is the initial guess, as the solver starts from it.
    seconds : (K,)
        When each was reported, since the beginning of the solve. Recording takes some of it.
    x : (K, nx)
    """

    numbers: IntArray
    seconds: FloatArray
    x: FloatArray


class IterateLog:
    """Records the points with which it is called, as a callback of a solver.

    Where there are many, later ones are recorded more and more seldom, so that the memory grows
    with the logarithm of their number.
    """

    def __init__(self) -> None:
        self.count = 0
        self._kept: list[tuple[int, float, FloatArray]] = []
        self._last: tuple[int, float, FloatArray] | None = None  # if it is not kept
        self._started = time.perf_counter()

    def __call__(self, x: ArrayLike, *_: object) -> None:
        """Record x; what else a solver passes to its callback is not used."""
        number, self.count = self.count, self.count + 1
        seconds = time.perf_counter() - self._started
        point = number, seconds, np.array(x, dtype=float).ravel()
        if number < _ALL or number >= _RATIO * self._kept[-1][0]:
            self._kept.append(point)
            self._last = None
        else:
            self._last = point

    def iterates(self, x0: FloatArray, scale: float = 1.0) -> Iterates | None:
        """Return the recorded points, in units of `scale`, after x0 if no start was reported.

        Parameters
        ----------
        x0 : (nx,)
            The initial guess; empty if the first point that was reported is the start.
        scale : float

        Returns
        -------
        Iterates or None
            None if no point was reported.
        """
        if not self.count:
            return None
        kept = self._kept if self._last is None else [*self._kept, self._last]
        numbers, seconds, points = zip(*kept, strict=True)
        at, when, x = np.array(numbers), np.array(seconds), scale * np.array(points)
        if x0.size:
            at, when, x = np.r_[0, at + 1], np.r_[0.0, when], np.vstack([x0, x])
        return Iterates(at, when, x)


VIOLATION = 1e-6
"""Constraint violation above which an answer is never a success, whatever its solver reports."""


@dataclass(frozen=True, eq=False)
class Answer:
    """Answer of a backend on one instance, before verification.

    Parameters
    ----------
    x : (nx,)
    status : Status
        As the backend reports it.
    message : str
    iterations, evaluations : int
        As the backend counts them; evaluations are those of the objective.
    seconds : float
        Time of the solve.
    multipliers : (nx,), (ng,), optional
        Of the bounds and of g; None if the backend has none.
    """

    x: FloatArray
    status: Status
    message: str
    iterations: int
    evaluations: int
    seconds: float
    multipliers: tuple[FloatArray, FloatArray] | None = None

    def in_units(self, length: float, value: float) -> Answer:
        """The same answer, which is given in units of x and f."""
        if self.multipliers is None:
            return replace(self, x=length * self.x)
        bounds, rows = self.multipliers
        return replace(self, x=length * self.x, multipliers=(value / length * bounds, value * rows))


@dataclass(frozen=True)
class Capabilities:
    """Features that a solver supports.

    Parameters
    ----------
    problems : {"any", "product sets", "paths"}
        Any `Nlp`, or only those whose constraints are a product of boxes and discs, or limits of
        paths over some steps.
    batch : bool
        Whether thousands of instances advance together.
    multipliers : bool
        Whether answers have multipliers; otherwise they are estimated for verification.
    time_limit : bool
        Whether the solver can limit the time of a solve.
    fixed_iterations : bool
        Whether the method ends after a number of iterations by design: its answer is that iterate,
        wherever it is.
    """

    problems: Literal["any", "product sets", "paths"] = "any"
    batch: bool = False
    multipliers: bool = False
    time_limit: bool = False
    fixed_iterations: bool = False


class Solver(ABC):
    """Base of all solvers: a frozen dataclass of options that can be shared, hashed and pickled.

    A subclass overrides `run`, and `prepare` if it compiles problems. Options that
    are annotated with `Allowed`, an alias of it such as `Positive`, or a ``Literal`` are checked
    when the solver is made.
    """

    name: ClassVar[str]
    summary: ClassVar[str]
    capabilities: ClassVar[Capabilities] = Capabilities()
    backend_options: ClassVar[dict[str, Any]] = {}

    def __post_init__(self) -> None:
        check_options(self)

    @classmethod
    def unavailable(cls) -> str:
        """Reason why this solver cannot run in this installation; empty if it can."""
        return ""

    def prepare(self, nlp: Nlp) -> None:  # noqa: B027  (not every solver compiles anything)
        """Compile the problem for this backend, once; raise SolverError if that is impossible."""

    def warm(self) -> Solver:
        """The solver for initial guesses that are close to a minimum; by default itself."""
        return self

    def from_feasible_guess(self) -> tuple[Solver, ...]:
        """Solvers that start at a feasible guess, however thin the feasible set, to try in turn."""
        return ()

    @abstractmethod
    def run(self, nlp: Nlp, instances: Instances) -> Sequence[Answer]:
        """Solve every instance; failures are answers, not exceptions.

        An exception is a bug of a backend, and costs only the instance that raises it.
        """

    def iterates(self, nlp: Nlp, instance: Instances) -> Iterates | None:  # noqa: ARG002
        """Points that a solve of a single instance visits; None if the backend reports none."""
        return None

    def solve(self, nlp: Nlp, instances: Instances) -> list[Solution]:
        """Solve every instance, and verify every answer against the problem.

        Parameters
        ----------
        nlp : Nlp
        instances : Instances
            B instances.

        Returns
        -------
        list of B Solution
            In order. Failure is returned, never raised and never dropped: an answer that is not
            finite, or violates a constraint by more than `VIOLATION`, has the status failed
            whatever the backend reports, and keeps the backend's `message`. The same holds for an
            instance on which the backend raises an exception, which becomes the message.

        Raises
        ------
        SolverError
            Instances whose arrays do not fit the program, a kind of problem that the backend cannot
            solve, or an instance that it does not answer.
        """
        return self._solved(nlp, instances)[1]

    def solve_batch(
        self, nlp: Nlp, instances: Instances, *, sensitivities: bool = False
    ) -> BatchSolution:
        """Like `solve`, for thousands of instances: arrays instead of objects.

        With `sensitivities`, the solution has derivatives by the parameters (`Sensitivities`).
        """
        if sensitivities:
            return differentiated(nlp, instances, self.solve_batch(nlp, instances))
        answers, solutions = self._solved(nlp, instances)
        multipliers = _multipliers(answers, instances)
        return BatchSolution.from_solutions(solutions, instances.scale, multipliers)

    def _solved(self, nlp: Nlp, instances: Instances) -> tuple[Sequence[Answer], list[Solution]]:
        """Answers to every instance, and the verified solutions."""
        with interruptible():  # CasADi's calls before and after a solve can lose an interrupt
            seconds, answers = self.timed_answers(nlp, instances)
            return answers, [
                self.verified(nlp, instances[i : i + 1], answer, seconds)
                for i, answer in enumerate(answers)
            ]

    def timed_answers(self, nlp: Nlp, instances: Instances) -> tuple[float, Sequence[Answer]]:
        """Seconds of preparing, and an answer to every instance, not verified.

        An exception of the backend becomes a failed answer.
        """
        instances.require_fit(nlp)
        started = time.perf_counter()
        try:
            self.prepare(nlp)
        except USER_ERRORS as error:
            seconds = time.perf_counter() - started
            return seconds, failed(instances, f"building raised {backend_error(error)}")
        return time.perf_counter() - started, self._run_each(nlp, instances)

    def verified(
        self, nlp: Nlp, instance: Instances, answer: Answer, build_seconds: float = 0.0
    ) -> Solution:
        """Solution of a single instance, with residuals recomputed from the problem."""
        shape = np.shape(answer.x)
        if shape != instance.x0.shape[1:]:
            answer = failed(instance, f"gave x of shape {shape}: {answer.message}")[0]
        residuals = kkt_residuals(nlp, instance, answer.x, answer.multipliers)
        unverified = answer.status.success and not residuals.violation <= VIOLATION
        return Solution(
            x=answer.x,
            objective=float(nlp.evaluate(answer.x, instance.p[0])[0]),
            status=Status.FAILED if unverified else answer.status,
            message=_explained(nlp, instance, answer, residuals),
            solver=self.name,
            residuals=residuals,
            iterations=answer.iterations,
            evaluations=answer.evaluations,
            build_seconds=build_seconds,
            solve_seconds=answer.seconds,
        )

    def _run_each(self, nlp: Nlp, instances: Instances) -> Sequence[Answer]:
        """Answers of `run`; after an exception it runs every instance by itself."""
        try:
            answers = list(self.run(nlp, instances))
            for answer in answers:
                if not isinstance(answer, Answer):
                    kind = type(answer).__name__
                    raise TypeError(f"the backend gave a {kind} instead of an Answer")
        except USER_ERRORS as error:
            message = f"raised {backend_error(error)}"
            if len(instances) <= 1:
                return failed(instances, message)
            return [self._run_each(nlp, instances[i : i + 1])[0] for i in range(len(instances))]
        if len(answers) != len(instances):
            message = (
                f"{self.name} gave {len(answers)} answers for {len(instances)} instances; run has "
                "to return one Answer for each, in order"
            )
            counts = {"value": len(answers), "expected": len(instances)}
            raise SolverError(message, solver=self.name, **counts)
        return answers


def _multipliers(answers: Sequence[Answer], instances: Instances) -> tuple[FloatArray, FloatArray]:
    """Multipliers of answers, (B, nx) and (B, ng); NaN where a backend has none."""
    lam_x, lam_g = np.full_like(instances.x0, np.nan), np.full(instances.lbg.shape, np.nan)
    for i, answer in enumerate(answers):
        given = answer.multipliers
        if given is not None and tuple(map(np.shape, given)) == (lam_x[i].shape, lam_g[i].shape):
            lam_x[i], lam_g[i] = given
    return lam_x, lam_g


def _explained(nlp: Nlp, instance: Instances, answer: Answer, residuals: Residuals) -> str:
    """Message of an answer; of a failure, with the name of a derivative that is not finite."""
    explicable = not answer.status.success and np.isfinite(answer.x).all()
    if not explicable or np.isfinite(residuals.stationarity):
        return answer.message
    return "; ".join(filter(None, [answer.message, invalid_value(nlp, instance, answer.x)]))


_AnySolver = TypeVar("_AnySolver", bound=Solver)

_BACKENDS = tomllib.loads(Path(__file__).with_name("backends.toml").read_text(encoding="utf-8"))


def described(kind: type[_AnySolver]) -> type[_AnySolver]:
    """Give a class what `backends.toml` says of it, as class variables."""
    entries = dict(_BACKENDS[kind.__name__])
    abilities = {name: entries.pop(name, False) for name in ("multipliers", "time_limit")}
    kind.capabilities = Capabilities(**abilities)
    for name, entry in entries.items():
        words = name in ("statuses", "limits")
        value = {word: Status(status) for word, status in entry.items()} if words else entry
        setattr(kind, "backend_options" if name == "options" else name, value)
    return kind


def settings(solver: Solver) -> dict[str, Any]:
    """Options of a solver of `backends.toml`, with the values of its fields."""
    defaults = {field.name: field.default for field in fields(solver)}  # type: ignore[arg-type]

    def value(entry: Any) -> Any:
        if not (isinstance(entry, str) and entry.startswith("$")):
            return entry
        names = entry[1:].split("|")
        name = next((name for name in names if getattr(solver, name) is not None), names[-1])
        given = getattr(solver, name)
        whole = isinstance(given, int) and not isinstance(defaults[name], int)
        return float(given) if whole else given

    def filled(entries: dict[str, Any]) -> dict[str, Any]:
        pairs = (
            (key, filled(v) if isinstance(v, dict) else value(v)) for key, v in entries.items()
        )
        return {key: setting for key, setting in pairs if setting is not None}

    return filled(solver.backend_options)


def differentiated(nlp: Nlp, instances: Instances, solution: BatchSolution) -> BatchSolution:
    """The solution with its `sensitivities`."""
    from .sensitivity import sensitivities  # seldom needed

    return replace(solution, sensitivities=sensitivities(nlp, instances, solution))


def failed(instances: Instances, message: str, status: Status = Status.FAILED) -> list[Answer]:
    """Answers without a solution (x is NaN) to all of the instances."""
    x = np.full(instances.x0.shape[1], np.nan)
    return [Answer(x, status, message, 0, 0, 0.0) for _ in range(len(instances))]


def error_text(error: BaseException) -> str:
    """Type and message of an exception."""
    return f"{type(error).__name__}: {error}".removesuffix(": ")


def backend_error(error: BaseException) -> str:
    """Text of a backend's exception; errors of casswarm and interrupts are raised again."""
    if isinstance(error, CasswarmError):
        raise error
    if "KeyboardInterrupt" in str(error):  # CasADi makes it a RuntimeError
        raise KeyboardInterrupt from error
    return error_text(error)
