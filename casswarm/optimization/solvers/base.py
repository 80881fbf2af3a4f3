"""What every solver offers, and the one place where answers are judged."""

from __future__ import annotations

import time
from abc import ABC, abstractmethod
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from typing import ClassVar, Literal

import numpy as np

from ...errors import CasswarmError, SolverError
from ...typing import FloatArray
from ..kkt import judge
from ..problem import Instances, Nlp
from ..solution import BatchSolution, Residuals, Solution, Status

VIOLATION = 1e-6
"""An answer that violates its constraints by more is never a success, whatever its solver says."""


@dataclass(frozen=True, eq=False)
class Answer:
    """What a backend says of one instance, before it is judged.

    `multipliers` are those of the bounds and of g; None where the backend has none.
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
    """What a solver can do, for tables and for those who choose.

    Parameters
    ----------
    problems : {"any", "product sets", "paths"}
        Any `Nlp`, or only those whose constraints are a product of boxes and discs, or limits of
        paths over some steps.
    batch : bool
        Whether thousands of instances advance together.
    multipliers : bool
        Whether its answers have multipliers; the judge estimates them otherwise.
    time_limit : bool
        Whether a solve can be given a limit of time.
    """

    problems: Literal["any", "product sets", "paths"] = "any"
    batch: bool = False
    multipliers: bool = False
    time_limit: bool = False


class Solver(ABC):
    """A solver holds its own options and nothing else; it can be shared, hashed and pickled."""

    name: ClassVar[str]
    summary: ClassVar[str]
    capabilities: ClassVar[Capabilities] = Capabilities()

    @classmethod
    def unavailable(cls) -> str:
        """Why this solver cannot run in this installation; empty where it can."""
        return ""

    @abstractmethod
    def _build(self, nlp: Nlp) -> None:
        """Compile the problem for this backend, once; raise SolverError where it cannot."""

    @abstractmethod
    def _run(self, nlp: Nlp, instances: Instances) -> Sequence[Answer]:
        """Solve every instance; failures are answers, not exceptions.

        An exception is a bug of a backend, and costs the instance that raises it alone.
        """

    def solve(self, nlp: Nlp, instances: Instances) -> list[Solution]:
        """Solve every instance, and judge every answer by the problem itself.

        Parameters
        ----------
        nlp : Nlp
        instances : Instances
            B of them.

        Returns
        -------
        list of B Solution
            In order. Failure is returned, never raised and never dropped: an answer that is not
            finite, or violates a constraint by more than `VIOLATION`, has the status failed
            whatever the backend says, whose own words stay in `message`. So has an instance on
            which the backend raises an exception, with the exception as the message.

        Raises
        ------
        SolverError
            The backend cannot take this kind of problem at all, or does not answer every instance.
        """
        started = time.perf_counter()
        with suppress(Exception):  # raised again below, where it is dealt with
            self._build(nlp)
        build = time.perf_counter() - started
        return [
            self._judged(nlp, instances[i : i + 1], answer, build)
            for i, answer in enumerate(self._answers(nlp, instances))
        ]

    def solve_batch(self, nlp: Nlp, instances: Instances) -> BatchSolution:
        """Like `solve`, for thousands of instances: arrays instead of objects."""
        return BatchSolution.of(self.solve(nlp, instances), instances.scale)

    def _answers(self, nlp: Nlp, instances: Instances) -> Sequence[Answer]:
        try:
            self._build(nlp)
        except CasswarmError:
            raise
        except Exception as error:
            return failed(instances, f"building raised {told(error)}")
        return self._tried(nlp, instances)

    def _tried(self, nlp: Nlp, instances: Instances) -> Sequence[Answer]:
        """What `_run` gives; after an exception every instance alone, and then as failed."""
        try:
            answers = [_checked(answer) for answer in self._run(nlp, instances)]
        except CasswarmError:
            raise
        except Exception as error:
            if "KeyboardInterrupt" in str(error):  # which CasADi makes a RuntimeError of
                raise KeyboardInterrupt from error
            if len(instances) <= 1:
                return failed(instances, f"raised {told(error)}")
            each = (self._tried(nlp, instances[i : i + 1]) for i in range(len(instances)))
            return [answer for answers in each for answer in answers]
        if len(answers) != len(instances):
            raise SolverError(f"{self.name} gave {len(answers)} answers for {len(instances)} tasks")
        return answers

    def _judged(self, nlp: Nlp, instance: Instances, answer: Answer, build: float) -> Solution:
        shape = np.shape(answer.x)
        if shape != instance.x0.shape[1:]:
            answer = failed(instance, f"gave x of shape {shape}: {answer.message}")[0]
        residuals = judge(nlp, instance, answer.x, answer.multipliers)
        return Solution(
            x=answer.x,
            objective=float(nlp.evaluate(answer.x, instance.p[0])[0]),
            status=_trusted(answer.status, residuals),
            message=answer.message,
            solver=self.name,
            residuals=residuals,
            iterations=answer.iterations,
            evaluations=answer.evaluations,
            build_seconds=build,
            solve_seconds=answer.seconds,
        )


def _checked(answer: object) -> Answer:
    if not isinstance(answer, Answer):
        raise TypeError(f"the backend gave a {type(answer).__name__} instead of an Answer")
    return answer


def failed(instances: Instances, message: str, seconds: float = 0.0) -> list[Answer]:
    """Failed answers to all of the instances, with no x: not a number."""
    nothing = np.full(instances.x0.shape[1], np.nan)
    return [Answer(nothing, Status.FAILED, message, 0, 0, seconds) for _ in range(len(instances))]


def told(error: BaseException) -> str:
    """An exception as words."""
    return f"{type(error).__name__}: {error}".removesuffix(": ")


def require(solver: Solver, option: str, fulfilled: bool, allowed: str) -> None:
    """Raise SolverError with what is allowed, unless an option's condition is fulfilled."""
    if not fulfilled:
        value = getattr(solver, option)
        raise SolverError(f"{solver.name}: {option} = {value!r}; allowed: {allowed}")


def _trusted(status: Status, residuals: Residuals) -> Status:
    return Status.FAILED if status.success and not residuals.violation <= VIOLATION else status
