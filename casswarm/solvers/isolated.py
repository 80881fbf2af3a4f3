"""Any solver in a process of its own, so that a crash or a hang is a failed answer."""

from __future__ import annotations

import atexit
import os
import pickle
import signal
import tempfile
import threading
import time
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import lru_cache
from multiprocessing import get_context, parent_process
from multiprocessing.connection import Connection
from multiprocessing.process import BaseProcess
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from ..errors import CasswarmError, SolverError
from ..nlp import Instances, Nlp
from ..solution import Solution, Status
from .base import Answer, Solver, failed, require, told

CHUNK = 64
"""Instances that are sent together at the most."""

PATIENCE = 3
"""Crashes and time limits in a row after which the rest of a chunk counts as failed, untried."""

_START_SECONDS = 60.0
_LAST_WORDS = 500  # characters
_PROGRAMS = 64  # sent to a process before it is replaced: it keeps them all
_GUARD = (
    "in a script, call this only under `if __name__ == '__main__':`, since the process imports "
    "the script again; and never from standard input"
)


@dataclass(frozen=True)
class Isolated(Solver):
    """A solver that runs in a process of its own, with a time limit; answers are judged here.

    The process starts at the first solve (about a second), stays for the next ones, and is
    replaced after a crash or a hang. What happened to it is the answer's message, such as ``its
    process ended with signal 11 (SIGSEGV)``. Where a batch ends so, each of its instances is tried
    alone, until `PATIENCE` of them in a row end so too.

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
        except _EndedError as end:
            if len(instances) == 1:
                return 0.0, _ended(instances, end)
        build, answers, row, ends = 0.0, list[Answer](), 0, 0
        while row < len(instances):
            try:
                seconds, some = process.ask(nlp, instances[row : row + 1], self.seconds)
                build, ends = build + seconds, 0
            except _EndedError as end:
                some, ends = _ended(instances[row : row + 1], end), ends + 1
                if ends == PATIENCE:
                    untried = _EndedError(end.status, f"not tried after {ends} in a row: {end}")
                    some = some + _ended(instances[row + 1 :], untried)
            answers += some
            row += len(some)
        return build, answers


class _EndedError(Exception):
    """The process ended, or was ended, before it answered."""

    def __init__(self, status: Status, words: str) -> None:
        super().__init__(words)
        self.status = status


def _ended(instances: Instances, end: _EndedError) -> list[Answer]:
    return [replace(answer, status=end.status) for answer in failed(instances, str(end))]


@lru_cache(maxsize=64)
def _process(solver: Isolated) -> _Process:
    """Equal solvers share a process."""
    return _Process(solver.solver)


class _Process:
    """A child that solves what it is sent; started when needed, replaced when it has ended."""

    def __init__(self, solver: Solver) -> None:
        self.solver = solver
        self._child: BaseProcess | None = None
        self._connection: Connection[Any, Any] | None = None
        self._programs: dict[Nlp, int] = {}
        self._busy = threading.Lock()  # one question at a time
        handle, name = tempfile.mkstemp(prefix="casswarm-", suffix=".log")
        os.close(handle)
        self._output = Path(name)  # what the child prints, for its last words
        atexit.register(self._leave)

    def ask(self, nlp: Nlp, instances: Instances, seconds: float) -> tuple[float, list[Answer]]:
        """Seconds of building, and answers.

        Raises
        ------
        _EndedError
            The child crashed, or took longer than `seconds` and was ended.
        SolverError
            The solver cannot take the problem, or no child could be started.
        """
        with self._busy:
            try:
                reply = self._asked(nlp, instances, seconds)
            except BaseException:  # Ctrl-C too: an answer that nobody awaits must not come later
                self.end()
                raise
        if isinstance(reply, SolverError):
            raise reply
        build, answers = reply
        return build, answers

    def end(self) -> None:
        """End the child, whatever it is doing."""
        if self._child is not None:
            self._child.kill()
            self._child.join()
            self._child.close()
        if self._connection is not None:
            self._connection.close()
        self._child = self._connection = None
        self._programs.clear()

    def _leave(self) -> None:
        self.end()
        self._output.unlink(missing_ok=True)

    def _asked(self, nlp: Nlp, instances: Instances, seconds: float) -> Any:
        if len(self._programs) >= _PROGRAMS:
            self.end()
        self.start()
        program = None if nlp in self._programs else _pickled(nlp.name, nlp)
        key = self._programs.setdefault(nlp, len(self._programs))
        return self._exchange((key, program, instances), seconds)

    def start(self) -> None:
        """Start the child, unless there is one alive."""
        if self._child is not None and self._child.is_alive():
            return
        self.end()
        context = get_context("spawn")  # CasADi's solvers do not survive a fork of their threads
        solver = _pickled(f"solver {self.solver.name}", self.solver)
        self._connection, theirs = context.Pipe()
        self._child = context.Process(
            target=_serve, args=(theirs, solver, str(self._output)), daemon=True
        )
        try:
            self._child.start()
            theirs.close()
            refusal = self._exchange(None, _START_SECONDS)
        except (OSError, AssertionError, _EndedError) as error:
            raise SolverError(
                f"no process could be started for {self.solver.name} ({error}): {_GUARD}"
            ) from error
        if refusal is not None:
            raise refusal

    def _exchange(self, question: Any, seconds: float) -> Any:
        """Send a question, if there is one, and wait for the reply."""
        assert self._child is not None
        assert self._connection is not None
        try:
            if question is not None:
                self._connection.send(question)
            if self._connection.poll(seconds):
                return self._connection.recv()
        except (EOFError, OSError):
            self._child.join(_START_SECONDS)
            raise _EndedError(Status.FAILED, self._epitaph(self._child.exitcode)) from None
        words = f"no answer within {seconds:g} s, so its process was ended"
        raise _EndedError(Status.TIME_LIMIT, words)

    def _epitaph(self, code: int | None) -> str:
        """How the child ended, and the last line that it printed."""
        words = f"its process ended with exit code {code}"
        if code is not None and code < 0:
            with suppress(ValueError):
                words += f" ({signal.Signals(-code).name})"
        lines = self._output.read_text(encoding="utf-8", errors="replace")[-_LAST_WORDS:].split(
            "\n"
        )
        last = next((line.strip() for line in reversed(lines) if line.strip()), "")
        return f"{words}; the last that it printed: {last}" if last else words


def _pickled(what: str, value: object) -> bytes:
    try:
        return pickle.dumps(value)
    except Exception as error:  # whatever a user's class raises
        raise SolverError(
            f"{what} cannot be sent to another process ({told(error)}): classes and functions "
            "must be defined in a module"
        ) from error


# --- the child


def _serve(connection: Connection[Any, Any], solver: bytes, output: str) -> None:
    """Answer questions until the parent leaves."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is for the parent, which ends its child
    threading.Thread(target=_end_with_parent, daemon=True).start()
    file = os.open(output, os.O_WRONLY | os.O_TRUNC)
    os.dup2(file, 1)
    os.dup2(file, 2)
    try:
        made: Solver = pickle.loads(solver)
    except Exception as error:  # whatever a user's class raises
        connection.send(
            SolverError(
                f"the solver cannot be made again in another process ({told(error)}): "
                "its class must be defined in a module"
            )
        )
        return
    connection.send(None)  # ready
    programs: dict[int, Nlp] = {}
    while True:
        try:
            key, program, instances = connection.recv()
        except EOFError:
            return
        if program is not None:
            programs[key] = pickle.loads(program)
        reply = _reply(made, programs[key], instances)
        try:
            connection.send(reply)
        except Exception as error:  # an answer of the user's that does not pickle
            words = f"its answer cannot be sent: {told(error)}"
            connection.send((0.0, failed(instances, words)))


def _reply(
    solver: Solver, nlp: Nlp, instances: Instances
) -> tuple[float, list[Answer]] | Exception:
    started = time.perf_counter()
    try:
        with suppress(Exception):  # raised again below, where it is dealt with
            solver._build(nlp)
        build = time.perf_counter() - started
        return build, list(solver._answers(nlp, instances))
    except CasswarmError as error:
        return SolverError(str(error))


def _end_with_parent() -> None:
    parent = parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)
