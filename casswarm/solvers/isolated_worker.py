"""The child process of an isolated solver."""

from __future__ import annotations

import atexit
import os
import pickle
import signal
import threading
from contextlib import suppress
from multiprocessing import get_context
from multiprocessing.connection import Connection
from multiprocessing.process import BaseProcess
from pathlib import Path
from typing import Any

from .._util.child import packed
from .._util.files import temporary_file
from .._util.interrupts import begin_child, deferred
from .._util.user_code import USER_ERRORS
from ..errors import CasswarmError, SolverError
from ..nlp.program import Instances, Nlp
from ..nlp.solution import Status
from .base import Answer, Iterates, Solver, error_text, failed

_START_SECONDS = 60.0
_WARM_UP_SECONDS = 30.0
_MAX_OUTPUT = 500  # characters in which the last line that a process printed is looked for
_MAX_PROGRAMS = 64  # that a process keeps
_GUARD = "a script must call this under `if __name__ == '__main__':`, and not be standard input"


class WorkerEndedError(Exception):
    """The process ended, or was ended, before it answered."""

    def __init__(self, status: Status, message: str) -> None:
        super().__init__(message)
        self.status = status


class Worker:
    """A child process that solves what it receives; started when needed, replaced when it ended.

    Not an executor: those of `concurrent.futures` have no time limit and do not report exit codes.
    """

    def __init__(self, solver: Solver) -> None:
        self.solver = solver
        self._child: BaseProcess | None = None
        self._connection: Connection[Any, Any] | None = None
        self._programs: dict[Nlp, int] = {}  # those that the child has
        self._lock = threading.Lock()  # one request at a time
        self._output = temporary_file(".log")  # what the child prints
        self._first: tuple[Nlp, Instances] | None = None  # what every child solves first
        atexit.register(self.end)

    def solve(
        self, nlp: Nlp, instances: Instances, time_limit: float
    ) -> tuple[float, list[Answer]]:
        """Seconds of preparing, and answers; WorkerEndedError if the child crashed or was slow."""
        build, answers = self._reply("timed_answers", nlp, instances, time_limit)
        return build, answers

    def iterates(self, nlp: Nlp, instance: Instances, time_limit: float) -> Iterates | None:
        """Iterates of a solve; WorkerEndedError as in `solve`."""
        reply = self._reply("iterates", nlp, instance, time_limit)
        return reply if isinstance(reply, Iterates) else None

    def warm_up(self, nlp: Nlp, instances: Instances) -> None:
        """See `Isolated.warm_up`."""
        with self._lock:
            self._first = nlp, instances
            if self._alive():
                self._solve_first()

    def start(self) -> None:
        """Start the child, unless there is one alive; SolverError if that is impossible."""
        with self._lock:
            self._ensure_started()

    def close(self) -> None:
        """End the child, and forget what is solved first."""
        self._first = None
        self.end()

    def _reply(self, method: str, nlp: Nlp, instances: Instances, time_limit: float) -> Any:
        """What a method of the solver in the child returns."""
        with self._lock:
            if len(self._programs) >= _MAX_PROGRAMS:
                self.end()
            self._ensure_started()
            reply = self._call(method, nlp, instances, time_limit)
        if isinstance(reply, SolverError):
            raise reply
        return reply

    def _ensure_started(self) -> None:
        if not self._alive():
            self._start()
            self._solve_first()

    def _alive(self) -> bool:
        return self._child is not None and self._child.is_alive()

    def _solve_first(self) -> None:
        """Solve what is solved first; in vain if the solver cannot, and never again if it ends."""
        if self._first is None:
            return
        try:
            self._call("timed_answers", *self._first, _WARM_UP_SECONDS)
        except WorkerEndedError:
            self._first = None
            self._start()

    def _start(self) -> None:
        self.end()
        solver = _pickled(f"solver {self.solver.name}", self.solver)
        context = get_context("spawn")  # CasADi's solvers do not survive a fork of their threads
        self._connection, theirs = context.Pipe()
        arguments = theirs, solver, str(self._output)
        self._child = context.Process(target=_serve, args=arguments, daemon=True)
        try:
            with deferred():
                self._child.start()
            theirs.close()
            refusal = self._request(None, _START_SECONDS)
            if refusal is not None:
                raise refusal
        except (OSError, AssertionError, WorkerEndedError) as error:
            self.end()
            raise SolverError(
                f"no process could be started for {self.solver.name} ({error}): {_GUARD}"
            ) from error
        except BaseException:
            self.end()
            raise

    def end(self) -> None:
        """End the child, whatever it is doing."""
        if self._child is not None:
            if self._child.pid is not None:  # else it was never started
                self._child.kill()
                self._child.join()
            self._child.close()
        if self._connection is not None:
            self._connection.close()
        self._child = self._connection = None
        self._programs.clear()

    def _call(self, method: str, nlp: Nlp, instances: Instances, seconds: float) -> Any:
        """What a method of the solver in the child, which is alive, returns or raises."""
        try:
            program = None if nlp in self._programs else _pickled(nlp.name, nlp)
            key = self._programs.setdefault(nlp, len(self._programs))
            return self._request((method, key, program, instances), seconds)
        except BaseException:  # on Ctrl-C too, or the answer would be that to the next request
            self.end()
            raise

    def _request(self, request: Any, seconds: float) -> Any:
        """Send a request, if there is one, and wait for the reply."""
        assert self._child is not None
        assert self._connection is not None
        try:
            if request is not None:
                self._connection.send(request)
            if self._connection.poll(seconds):
                return self._connection.recv()
        except (EOFError, OSError):
            self._child.join(_START_SECONDS)
            message = _exit_description(self._child.exitcode, self._output)
            raise WorkerEndedError(Status.FAILED, message) from None
        message = f"no answer within {seconds:g} s, so its process was ended"
        raise WorkerEndedError(Status.TIME_LIMIT, message)


def _exit_description(code: int | None, output: Path) -> str:
    """Exit code of a child process, and the last line that it printed."""
    text = f"its process ended with exit code {code}"
    if code is not None and code < 0:
        with suppress(ValueError):
            text += f" ({signal.Signals(-code).name})"
    printed = output.read_text(encoding="utf-8", errors="replace")[-_MAX_OUTPUT:].split("\n")
    last = next((line.strip() for line in reversed(printed) if line.strip()), "")
    return f"{text}; the last line that it printed: {last}" if last else text


def _pickled(what: str, value: Nlp | Solver) -> bytes:
    try:
        return packed(value)
    except Exception as error:  # any that a user's class raises
        raise SolverError(
            f"{what} cannot be sent to another process ({error_text(error)}): it holds something "
            "that does not pickle"
        ) from error


# --- the child process


def _serve(connection: Connection[Any, Any], pickled_solver: bytes, output: str) -> None:
    """Answer requests until the parent ends."""
    begin_child()
    file = os.open(output, os.O_WRONLY | os.O_TRUNC)
    os.dup2(file, 1)
    os.dup2(file, 2)
    try:
        solver: Solver = pickle.loads(pickled_solver)
    except Exception as error:  # any that a user's class raises
        message = f"the solver cannot be restored in another process: {error_text(error)}"
        connection.send(SolverError(message))
        return
    connection.send(None)  # ready
    programs: dict[int, Nlp] = {}
    while True:
        try:
            method, key, program, instances = connection.recv()
        except EOFError:
            return
        if program is not None:
            programs[key] = pickle.loads(program)
        try:
            reply: Any = getattr(solver, method)(programs[key], instances)
        except CasswarmError as error:
            reply = SolverError(str(error))
        except USER_ERRORS as error:  # of a user's `iterates`
            reply = SolverError(error_text(error))
        try:
            connection.send(reply)
        except Exception as error:  # an answer of a user's solver that does not pickle
            message = f"its answer cannot be sent: {error_text(error)}"
            connection.send((0.0, failed(instances, message)))
