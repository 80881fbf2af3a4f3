"""Any solver in a process of its own, so that a crash or a hang is a failed answer."""

from __future__ import annotations

import atexit
import os
import pickle
import signal
import threading
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from multiprocessing import get_context
from multiprocessing.connection import Connection
from multiprocessing.process import BaseProcess
from pathlib import Path
from typing import Annotated, Any, ClassVar

from ..._util.interrupts import begin_child, deferred
from ..._util.parallel import packed
from ..._util.temporary import temporary_file
from ..._util.threads import locked_cache
from ..._util.user_code import USER_ERRORS
from ...errors import CasswarmError, SolverError
from ..problem import Instances, Nlp
from ..solution import Solution, Status
from .base import Answer, Solver, error_text, failed
from .iterates import Iterates
from .options import Allowed, PositiveFinite

CHUNK = 64
"""Largest number of instances that are sent together."""

MAX_FAILURES = 3
"""Crashes and time limits in a row after which the rest of a chunk counts as failed, untried."""

_START_SECONDS = 60.0
_WARM_UP_SECONDS = 30.0
_MAX_OUTPUT = 500  # characters in which the last line that a process printed is looked for
_MAX_PROGRAMS = 64  # that a process keeps
_GUARD = "a script must call this under `if __name__ == '__main__':`, and not be standard input"

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
        """Solve without this solver's time limit, so that what is done once does not count later.

        An end of the process is ignored: it may be `nlp` that the solver does not survive.
        """
        with suppress(WorkerEndedError):
            _worker(self).solve(nlp, instances, _WARM_UP_SECONDS)

    def close(self) -> None:
        """End the process, if there is one; the next solve starts another."""
        _worker(self).end()

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


class WorkerEndedError(Exception):
    """The process ended, or was ended, before it answered."""

    def __init__(self, status: Status, message: str) -> None:
        super().__init__(message)
        self.status = status


class _Worker:
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

    def _reply(self, method: str, nlp: Nlp, instances: Instances, time_limit: float) -> Any:
        """What a method of the solver in the child returns."""
        with self._lock:
            try:
                if len(self._programs) >= _MAX_PROGRAMS:
                    self.end()
                self.start()
                program = None if nlp in self._programs else _pickled(nlp.name, nlp)
                key = self._programs.setdefault(nlp, len(self._programs))
                reply = self._request((method, key, program, instances), time_limit)
            except BaseException:  # on Ctrl-C too, or the answer would be that to the next request
                self.end()
                raise
        if isinstance(reply, SolverError):
            raise reply
        return reply

    def start(self) -> None:
        """Start the child, unless there is one alive."""
        if self._child is not None and self._child.is_alive():
            return
        self.end()
        context = get_context("spawn")  # CasADi's solvers do not survive a fork of their threads
        self._connection, theirs = context.Pipe()
        arguments = theirs, _pickled(f"solver {self.solver.name}", self.solver), str(self._output)
        self._child = context.Process(target=_serve, args=arguments, daemon=True)
        try:
            with deferred():
                self._child.start()
            theirs.close()
            refusal = self._request(None, _START_SECONDS)
        except (OSError, AssertionError, WorkerEndedError) as error:
            raise SolverError(
                f"no process could be started for {self.solver.name} ({error}): {_GUARD}"
            ) from error
        if refusal is not None:
            raise refusal

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


@locked_cache(maxsize=64)
def _worker(solver: Isolated) -> _Worker:
    """The process of a solver; equal solvers share one."""
    return _Worker(solver.solver)


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
