"""Interface of all solvers, and the verification of their answers."""

from __future__ import annotations

import time
from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar, Literal

import numpy as np

from ..._util.interrupts import interruptible
from ..._util.user_code import USER_ERRORS
from ...errors import CasswarmError, SolverError
from ...typing import FloatArray
from ..kkt import kkt_residuals
from ..problem import Instances, Nlp
from ..solution import BatchSolution, Solution, Status
from .iterates import Iterates
from .options import check_options

VIOLATION = 1e-6
"""Constraint violation above which an answer is never a success, whatever its solver reports."""


@dataclass(frozen=True, eq=False)
class Answer:
    """What a backend reports on one instance, before verification.

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


@dataclass(frozen=True)
class Capabilities:
    """What a solver supports.

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

    A subclass overrides `run`, and `prepare` if it compiles problems. Options whose annotations
    state what is allowed (see `casswarm.optimization.solvers.options`) are checked when the solver
    is made.
    """

    name: ClassVar[str]
    summary: ClassVar[str]
    capabilities: ClassVar[Capabilities] = Capabilities()

    def __post_init__(self) -> None:
        check_options(self)

    @classmethod
    def unavailable(cls) -> str:
        """Why this solver cannot run in this installation; empty if it can."""
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
            The backend cannot solve this kind of problem, or does not answer every instance.
        """
        with interruptible():  # CasADi's calls before and after a solve can lose an interrupt
            seconds, answers = self.timed_answers(nlp, instances)
            return [
                self.verified(nlp, instances[i : i + 1], answer, seconds)
                for i, answer in enumerate(answers)
            ]

    def solve_batch(self, nlp: Nlp, instances: Instances) -> BatchSolution:
        """Like `solve`, for thousands of instances: arrays instead of objects."""
        return BatchSolution.from_solutions(self.solve(nlp, instances), instances.scale)

    def timed_answers(self, nlp: Nlp, instances: Instances) -> tuple[float, Sequence[Answer]]:
        """Seconds of preparing, and an answer to every instance, not verified.

        An exception of the backend becomes a failed answer.
        """
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
            message=answer.message,
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
            raise SolverError(f"{self.name} gave {len(answers)} answers for {len(instances)} tasks")
        return answers


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
