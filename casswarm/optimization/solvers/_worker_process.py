"""A child process that solves what it is sent, and what is said of it when it ends."""

from __future__ import annotations

import atexit
import os
import pickle
import signal
import tempfile
import threading
import time
from contextlib import suppress
from multiprocessing import get_context
from multiprocessing.connection import Connection
from multiprocessing.process import BaseProcess
from pathlib import Path
from typing import Any

from ..._util.interrupts import begin_child, deferred
from ...errors import CasswarmError, SolverError
from ..problem import Instances, Nlp
from ..solution import Status
from .base import Answer, Solver, failed, told

_START_SECONDS = 60.0
_LAST_WORDS = 500  # characters
_PROGRAMS = 64  # sent to a process before it is replaced: it keeps them all
_GUARD = (
    "in a script, call this only under `if __name__ == '__main__':`, since the process imports "
    "the script again; and never from standard input"
)


class EndedError(Exception):
    """The process ended, or was ended, before it answered."""

    def __init__(self, status: Status, words: str) -> None:
        super().__init__(words)
        self.status = status


class Process:
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
        EndedError
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
            if self._child.pid is not None:  # else it could not be born
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
            with deferred():
                self._child.start()
            theirs.close()
            refusal = self._exchange(None, _START_SECONDS)
        except (OSError, AssertionError, EndedError) as error:
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
            raise EndedError(Status.FAILED, self._epitaph(self._child.exitcode)) from None
        words = f"no answer within {seconds:g} s, so its process was ended"
        raise EndedError(Status.TIME_LIMIT, words)

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
    begin_child()
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
