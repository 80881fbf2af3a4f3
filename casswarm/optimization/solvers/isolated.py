"""Any solver in a process of its own, so that a crash or a hang is a failed answer."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import ClassVar

import numpy as np

from ...errors import SolverError
from ..problem import Instances, Nlp
from ..solution import Solution
from ._worker_process import EndedError, Process
from .base import Answer, Solver, failed, require

CHUNK = 64
"""Instances that are sent together at the most."""

PATIENCE = 3
"""Crashes and time limits in a row after which the rest of a chunk counts as failed, untried."""


@dataclass(frozen=True)
class Isolated(Solver):
    """A solver that runs in a process of its own, with a time limit; answers are judged here.

    The process starts at the first solve (about a second), stays for the next ones, and is
    replaced after a crash or a hang. What happened to it is the answer's message, such as ``its
    process ended with exit code -11 (SIGSEGV)``. Where a batch ends so, each of its instances is
    tried alone, until `PATIENCE` of them in a row end so too.

    Parameters
    ----------
    solver : Solver
        It must pickle, and its class must be importable: defined in a module or a script, not in a
        notebook's cell.
    seconds : float
        For building and solving a chunk of up to `CHUNK` instances, or one of them alone. Beyond,
        the answers have the status time limit.
    """

    solver: Solver
    seconds: float = 60.0

    name: ClassVar[str] = "isolated"
    summary: ClassVar[str] = "another solver in a process of its own, with a time limit"

    def __post_init__(self) -> None:
        if not isinstance(self.solver, Solver):
            raise SolverError(f"isolated: solver = {self.solver!r}; allowed: a Solver")
        require(self, "seconds", 0 < self.seconds < np.inf, "above zero, finite")

    def _build(self, nlp: Nlp) -> None:
        """Nothing: the process builds what it is sent."""

    def _run(self, nlp: Nlp, instances: Instances) -> Sequence[Answer]:
        return self.answers(nlp, instances)[1]

    def answers(self, nlp: Nlp, instances: Instances) -> tuple[float, list[Answer]]:
        """Seconds that the process spent on building, and its answers, before they are judged.

        Raises
        ------
        SolverError
            The solver cannot take the problem, or one of them cannot be sent to a process.
        """
        build, answers = 0.0, list[Answer]()
        for first in range(0, len(instances), CHUNK):
            seconds, some = self._chunk(nlp, instances[slice(first, first + CHUNK)])
            build, answers = build + seconds, answers + some
        return build, answers

    def solve(self, nlp: Nlp, instances: Instances) -> list[Solution]:
        """See `Solver.solve`; the solver's name is that of the solver inside."""
        build, answers = self.answers(nlp, instances)
        judged = (
            self._judged(nlp, instances[i : i + 1], answer, build)
            for i, answer in enumerate(answers)
        )
        return [replace(solution, solver=self.solver.name) for solution in judged]

    def start(self) -> None:
        """Start the process now, if there is none; otherwise the first solve does.

        Raises
        ------
        SolverError
            None can be started, or the solver cannot be sent to it.
        """
        _process(self).start()

    def close(self) -> None:
        """End the process, if there is one; the next solve starts another."""
        _process(self).end()

    def _chunk(self, nlp: Nlp, instances: Instances) -> tuple[float, list[Answer]]:
        process = _process(self)
        try:
            return process.ask(nlp, instances, self.seconds)
        except EndedError as end:
            if len(instances) == 1:
                return 0.0, _ended(instances, end)
        build, answers, row, ends = 0.0, list[Answer](), 0, 0
        while row < len(instances):
            try:
                seconds, some = process.ask(nlp, instances[row : row + 1], self.seconds)
                build, ends = build + seconds, 0
            except EndedError as end:
                some, ends = _ended(instances[row : row + 1], end), ends + 1
                if ends == PATIENCE:
                    untried = EndedError(end.status, f"not tried after {ends} in a row: {end}")
                    some = some + _ended(instances[row + 1 :], untried)
            answers += some
            row += len(some)
        return build, answers


def _ended(instances: Instances, end: EndedError) -> list[Answer]:
    return [replace(answer, status=end.status) for answer in failed(instances, str(end))]


@lru_cache(maxsize=64)
def _process(solver: Isolated) -> Process:
    """Equal solvers share a process."""
    return Process(solver.solver)
