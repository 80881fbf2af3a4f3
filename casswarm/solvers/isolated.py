"""Any solver in a process of its own, so that a crash or a hang is a failed answer."""

from __future__ import annotations

import atexit
import pickle
import threading
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import partial
from typing import Annotated, Any, ClassVar

from typing_extensions import override

from .._util.child import Channel, Child, ChildEndedError, ChildTimeoutError, packed
from .._util.files import temporary_file
from .._util.threads import locked_cache
from .._util.user_code import USER_ERRORS
from ..errors import CasswarmError, SolverError
from ..nlp.program import Instances, Nlp
from ..nlp.solution import Solution, Status
from .base import Allowed, Answer, Iterates, PositiveFinite, Solver, error_text, failed

CHUNK = 64
"""Largest number of instances that are sent together."""

MAX_FAILURES = 3
"""Crashes and time limits in a row after which the rest of a chunk counts as failed, untried."""

_START_SECONDS = 60.0
_WARM_UP_SECONDS = 30.0
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

    @override
    def run(self, nlp: Nlp, instances: Instances) -> Sequence[Answer]:
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

    @override
    def verified(
        self, nlp: Nlp, instance: Instances, answer: Answer, build_seconds: float = 0.0
    ) -> Solution:
        """The solution, with the name of the solver inside."""
        solution = super().verified(nlp, instance, answer, build_seconds)
        return replace(solution, solver=self.solver.name)

    @override
    def iterates(self, nlp: Nlp, instance: Instances) -> Iterates | None:
        """Points that the solver visits; None, too, if the process ends before it has them."""
        reply = None
        with suppress(ChildEndedError):
            reply = _worker(self).reply("iterates", nlp, instance, self.time_limit)
        return reply if isinstance(reply, Iterates) else None

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
                build, solved = _worker(self).reply("timed_answers", nlp, part, self.time_limit)
                seconds, answers, failures = seconds + build, answers + solved, 0
            except ChildEndedError as end:
                if len(part) > 1:
                    parts = [part[i : i + 1] for i in range(len(part))]
                    continue
                slow = isinstance(end, ChildTimeoutError)
                status = Status.TIME_LIMIT if slow else Status.FAILED
                answers += failed(part, str(end), status)
                failures += 1
                if failures == MAX_FAILURES:
                    message = f"not tried after {failures} in a row: {end}"
                    return seconds, answers + failed(instances[len(answers) :], message, status)
        return seconds, answers


class _Worker:
    """The process of a solver; started when needed, replaced when it ended."""

    def __init__(self, solver: Solver) -> None:
        self._solver = solver
        self._child: Child | None = None
        self._programs: dict[Nlp, int] = {}  # those that the child has
        self._lock = threading.Lock()  # one request at a time
        self._output = temporary_file(".log")  # what the child prints
        self._first: tuple[Nlp, Instances] | None = None  # what every child solves first
        atexit.register(self.end)

    def reply(self, method: str, nlp: Nlp, instances: Instances, seconds: float) -> Any:
        """Return a solver method's result; ChildEndedError if the child crashed or was slow."""
        with self._lock:
            if len(self._programs) >= _MAX_PROGRAMS:
                self.end()
            self._ensure_started()
            reply = self._call(method, nlp, instances, seconds)
        if isinstance(reply, SolverError):
            raise reply
        return reply

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

    def end(self) -> None:
        """End the child, whatever it is doing."""
        if self._child is not None:
            self._child.end()
        self._child = None
        self._programs.clear()

    def _alive(self) -> bool:
        return self._child is not None and self._child.process.is_alive()

    def _ensure_started(self) -> None:
        if not self._alive():
            self._start()
            self._solve_first()

    def _start(self) -> None:
        self.end()
        solver = _pickled(f"solver {self._solver.name}", self._solver)
        try:
            self._child = Child(partial(_solve_requested, solver), self._output)
            refusal = self._ask(b"", _START_SECONDS)
        except (OSError, AssertionError, ChildEndedError) as error:
            raise SolverError(
                f"no process could be started for {self._solver.name} ({error}): {_GUARD}",
                solver=self._solver.name,
            ) from error
        if refusal is not None:
            self.end()
            raise refusal

    def _solve_first(self) -> None:
        """Solve what is solved first; in vain if the solver cannot, and never again if it ends."""
        if self._first is None:
            return
        try:
            self._call("timed_answers", *self._first, _WARM_UP_SECONDS)
        except ChildEndedError:
            self._first = None
            self._start()

    def _call(self, method: str, nlp: Nlp, instances: Instances, seconds: float) -> Any:
        """Call a method of the solver in the child, which is alive; return its result."""
        program = None if nlp in self._programs else _pickled(nlp.name, nlp)
        key = self._programs.setdefault(nlp, len(self._programs))
        return self._ask(pickle.dumps((method, key, program, instances)), seconds)

    def _ask(self, request: bytes, seconds: float) -> Any:
        """Answer of the child, which is ended if there is none."""
        assert self._child is not None
        try:
            return pickle.loads(self._child.ask(request, seconds))
        except BaseException:  # on Ctrl-C too, or the answer would be that to the next request
            self.end()
            raise


@locked_cache(maxsize=64)
def _worker(solver: Isolated) -> _Worker:
    """The process of a solver; equal solvers share one."""
    return _Worker(solver.solver)


def _pickled(what: str, value: Nlp | Solver) -> bytes:
    try:
        return packed(value)
    except Exception as error:  # any that a user's class raises
        raise SolverError(
            f"{what} cannot be sent to another process ({error_text(error)}): it holds something "
            "that does not pickle",
            value=what,
        ) from error


def _solve_requested(pickled_solver: bytes, channel: Channel) -> None:
    """Solve, in the child, what it is sent."""
    try:
        solver: Solver = pickle.loads(pickled_solver)
    except Exception as error:  # any that a user's class raises
        message = f"the solver cannot be restored in another process: {error_text(error)}"
        channel.send(pickle.dumps(SolverError(message)))
        return
    channel.send(pickle.dumps(None))  # ready
    programs: dict[int, Nlp] = {}
    for request in channel.requests():
        method, key, program, instances = pickle.loads(request)
        if program is not None:
            programs[key] = pickle.loads(program)
        try:
            reply: Any = getattr(solver, method)(programs[key], instances)
        except CasswarmError as error:
            reply = SolverError(str(error), **vars(error))
        except USER_ERRORS as error:  # of a user's `iterates`
            reply = SolverError(error_text(error))
        try:
            answer = pickle.dumps(reply)
        except Exception as error:  # an answer of a user's solver that does not pickle
            message = f"its answer cannot be sent: {error_text(error)}"
            answer = pickle.dumps((0.0, failed(instances, message)))
        channel.send(answer)
