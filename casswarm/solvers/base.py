"""What every solver offers, and the one place where answers are judged."""

from __future__ import annotations

import time
from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

from ..arrays import Floats
from ..errors import SolverError
from ..nlp import Instances, Nlp
from ..residuals import judge
from ..solution import BatchSolution, Residuals, Solution, Status

VIOLATION = 1e-6
"""An answer that violates its constraints by more is never a success, whatever its solver says."""


@dataclass(frozen=True, eq=False)
class Answer:
    """What a backend says of one instance, before it is judged.

    `multipliers` are those of the bounds and of g; None where the backend has none.
    """

    x: Floats
    status: Status
    message: str
    iterations: int
    evaluations: int
    seconds: float
    multipliers: tuple[Floats, Floats] | None = None


class Solver(ABC):
    """A solver holds its own options and nothing else; it can be shared, hashed and pickled."""

    name: ClassVar[str]
    summary: ClassVar[str]

    @abstractmethod
    def _build(self, nlp: Nlp) -> None:
        """Compile the problem for this backend, once; raise SolverError where it cannot."""

    @abstractmethod
    def _run(self, nlp: Nlp, instances: Instances) -> Sequence[Answer]:
        """Solve every instance; failures are answers, not exceptions."""

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
            whatever the backend says, whose own words stay in `message`.

        Raises
        ------
        SolverError
            The backend cannot take this kind of problem at all, or does not answer every instance.
        """
        started = time.perf_counter()
        self._build(nlp)
        build = time.perf_counter() - started
        return [
            self._judged(nlp, instances[i : i + 1], answer, build)
            for i, answer in enumerate(self._answers(nlp, instances))
        ]

    def solve_batch(self, nlp: Nlp, instances: Instances) -> BatchSolution:
        """Like `solve`, for thousands of instances: arrays instead of objects."""
        return BatchSolution.of(self.solve(nlp, instances))

    def _answers(self, nlp: Nlp, instances: Instances) -> Sequence[Answer]:
        self._build(nlp)
        answers = self._run(nlp, instances)
        if len(answers) != len(instances):
            raise SolverError(f"{self.name} gave {len(answers)} answers for {len(instances)} tasks")
        return answers

    def _judged(self, nlp: Nlp, instance: Instances, answer: Answer, build: float) -> Solution:
        residuals = judge(nlp, instance, answer.x, answer.multipliers)
        return Solution(
            x=answer.x,
            objective=float(nlp.evaluate(answer.x, instance.parameters[0])[0]),
            status=_trusted(answer.status, residuals),
            message=answer.message,
            solver=self.name,
            residuals=residuals,
            iterations=answer.iterations,
            evaluations=answer.evaluations,
            build_seconds=build,
            solve_seconds=answer.seconds,
        )


def require(solver: Solver, option: str, fulfilled: bool, allowed: str) -> None:
    """Raise SolverError with what is allowed, unless an option's condition is fulfilled."""
    if not fulfilled:
        value = getattr(solver, option)
        raise SolverError(f"{solver.name}: {option} = {value!r}; allowed: {allowed}")


def _trusted(status: Status, residuals: Residuals) -> Status:
    return Status.FAILED if status.success and not residuals.violation <= VIOLATION else status
