"""Any solver in a process of its own, so that a crash or a hang is a failed answer."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import Annotated, ClassVar

from .._util.threads import locked_cache
from ..nlp.program import Instances, Nlp
from ..nlp.solution import Solution
from .base import Allowed, Answer, Iterates, PositiveFinite, Solver, failed
from .isolated_worker import Worker, WorkerEndedError

CHUNK = 64
"""Largest number of instances that are sent together."""

MAX_FAILURES = 3
"""Crashes and time limits in a row after which the rest of a chunk counts as failed, untried."""

AnySolver = Annotated[Solver, Allowed(lambda value: isinstance(value, Solver), "a Solver")]


@dataclass(frozen=True)
class Isolated(Solver):
    """A solver that runs in a process of its own, with a time limit; answers are verified here.

    The process starts at the first solve (about a second), stays for the next ones, and is
    replaced after a crash or a hang, which the answer's message describes, such as ``its process
    ended with exit code -11 (SIGSEGV)``. If a batch ends so, each of its instances is solved by
    itself, until `MAX_FAILURES` of them in a row end so too.

    Parameters
    ----------
    solver : Solver
        It must pickle. Its class may be defined in a notebook's cell.
    time_limit : float
        Seconds for building and solving a chunk of up to `CHUNK` instances, or a single one.
        Answers that take longer have the status time limit.
    """

    solver: AnySolver
    time_limit: PositiveFinite = 60.0

    name: ClassVar[str] = "isolated"
    summary: ClassVar[str] = "another solver in a process of its own, with a time limit"

    def run(self, nlp: Nlp, instances: Instances) -> Sequence[Answer]:
        """See `Solver.run`."""
        return self.timed_answers(nlp, instances)[1]

    def timed_answers(self, nlp: Nlp, instances: Instances) -> tuple[float, list[Answer]]:
        """Seconds that the process spent on preparing, and its answers, not verified.

        Raises
        ------
        SolverError
            The solver cannot solve this kind of problem, or cannot be sent to a process.
        """
        seconds, answers = 0.0, list[Answer]()
        for first in range(0, len(instances), CHUNK):
            build, chunk = self._chunk(nlp, instances[slice(first, first + CHUNK)])
            seconds, answers = seconds + build, answers + chunk
        return seconds, answers

    def verified(
        self, nlp: Nlp, instance: Instances, answer: Answer, build_seconds: float = 0.0
    ) -> Solution:
        """See `Solver.verified`; the solver's name is that of the solver inside."""
        solution = super().verified(nlp, instance, answer, build_seconds)
        return replace(solution, solver=self.solver.name)

    def iterates(self, nlp: Nlp, instance: Instances) -> Iterates | None:
        """See `Solver.iterates`; None, too, if the process ends before it has them."""
        with suppress(WorkerEndedError):
            return _worker(self).iterates(nlp, instance, self.time_limit)
        return None

    def start(self) -> None:
        """Start the process now, if there is none; raise SolverError if that is impossible."""
        _worker(self).start()

    def warm_up(self, nlp: Nlp, instances: Instances) -> None:
        """Solve these first, untimed, in the process and in each that replaces it, until `close`.

        What a process does once, such as imports and compilation, then never counts towards the
        time limit. If the solver cannot solve them, or does not survive it, nothing is solved
        first.
        """
        _worker(self).warm_up(nlp, instances)

    def close(self) -> None:
        """End the process, if there is one; the next solve starts another, without a warm-up."""
        _worker(self).close()

    def _chunk(self, nlp: Nlp, instances: Instances) -> tuple[float, list[Answer]]:
        """Seconds of preparing, and answers; one by one if the process ends on all together."""
        parts, seconds, answers, failures = [instances], 0.0, list[Answer](), 0
        while parts:
            part = parts.pop(0)
            try:
                build, solved = _worker(self).solve(nlp, part, self.time_limit)
                seconds, answers, failures = seconds + build, answers + solved, 0
            except WorkerEndedError as end:
                if len(part) > 1:
                    parts = [part[i : i + 1] for i in range(len(part))]
                    continue
                answers += failed(part, str(end), end.status)
                failures += 1
                if failures == MAX_FAILURES:
                    message = f"not tried after {failures} in a row: {end}"
                    return seconds, answers + failed(instances[len(answers) :], message, end.status)
        return seconds, answers


@locked_cache(maxsize=64)
def _worker(solver: Isolated) -> Worker:
    """The process of a solver; equal solvers share one."""
    return Worker(solver.solver)
