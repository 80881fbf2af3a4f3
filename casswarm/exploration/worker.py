"""The process that answers questions, the newest first; it ends with the process that asks."""

from __future__ import annotations

import pickle
from collections.abc import Callable
from contextlib import suppress
from multiprocessing import get_context
from multiprocessing.connection import Connection
from threading import Condition, RLock, Thread, Timer

from .._util.child import packed
from .._util.interrupts import begin_child, blocked
from ..guide.guide import Guide
from .answers import Answer, Inquiry, Question, Superseded

GRACE = 2.0
"""Seconds after which work is ended that does not make way for a newer question."""

IDLE = 600.0
"""Seconds after a complete answer until the process ends: a view may go without saying so."""


class Worker:
    """A process that answers the newest question, and drops older ones once their guide is out.

    It starts with the first question, and ends when it is idle. If it dies, the question fails.
    The next question then starts another process.

    Parameters
    ----------
    receive : callable
        Called with every `Answer`, in a thread of its own.
    """

    def __init__(self, receive: Callable[[Answer], None]) -> None:
        self._receive, self._lock = receive, RLock()
        self._connection: Connection | None = None
        self._wanted: Question | None = None
        self._latest: Answer | None = None

    def ask(self, question: Question) -> None:
        """Ask a question, which makes all others obsolete.

        Raises
        ------
        TypeError, AttributeError, PicklingError
            The scenario cannot be sent to another process.
        """
        content = packed(question)
        with self._lock:
            self._wanted = question
            if self._connection is None:
                self._start()
            assert self._connection is not None
            with suppress(OSError):  # the process has died: the thread that reads will report it
                self._connection.send_bytes(content)
        if self._is_late(question):
            _later(GRACE, self._restart_if_late, question)

    def close(self) -> None:
        """End the process, whatever it does; the next question starts another one."""
        with self._lock:
            if self._connection is None:
                return
            self._connection, self._latest, self._wanted = None, None, None
            self._process.kill()
        self._process.join()

    def _start(self) -> None:
        context = get_context("spawn")  # threads of compiled libraries do not survive a fork
        connection, theirs = context.Pipe()
        self._process = context.Process(target=_answer_questions, args=(theirs,), daemon=True)
        with blocked():  # inherited by the process
            self._process.start()
        theirs.close()
        self._connection, self._latest = connection, None
        Thread(target=self._read, args=(connection,), daemon=True).start()

    def _read(self, connection: Connection) -> None:
        """Pass on answers until the process ends."""
        with suppress(EOFError, OSError):
            while True:
                answer = pickle.loads(connection.recv_bytes())
                with self._lock:
                    if connection is not self._connection:
                        break
                    self._latest = answer
                self._receive(answer)
                if answer.done:
                    _later(IDLE, self._end_if_idle, answer.question.version)
        with self._lock:
            lost = self._wanted if connection is self._connection else None
            if connection is self._connection:
                self._connection = None
        connection.close()
        if lost is not None:
            text = "the process that computes ended unexpectedly; any change starts it again"
            self._receive(Answer(lost, failure=text, done=True))

    def _is_late(self, question: Question) -> bool:
        """Whether the process works on an older question although its guide is out."""
        with self._lock:
            latest = self._latest
            return (
                latest is not None
                and latest.guide is not None
                and not latest.done
                and latest.question.version < question.version
            )

    def _restart_if_late(self, question: Question) -> None:
        with self._lock:
            newest = self._wanted
            if newest is None or not self._is_late(question):
                return
            self.close()
        self.ask(newest)

    def _end_if_idle(self, version: int) -> None:
        with self._lock:
            if self._wanted is not None and self._wanted.version == version:
                self.close()


def _later(seconds: float, function: Callable[..., None], *arguments: object) -> None:
    """Call a function in a thread of its own, unless Python ends before."""
    timer = Timer(seconds, function, arguments)
    timer.daemon = True
    timer.start()


def _answer_questions(connection: Connection) -> None:
    """Answer questions until the other process ends."""
    begin_child()
    inbox = _Inbox(connection)
    previous: Guide | None = None
    while True:
        question = inbox.take()
        inquiry = Inquiry(
            question, lambda answer: connection.send_bytes(packed(answer)), inbox.poll
        )
        with suppress(Superseded):
            inquiry.run(previous)
        guide = inquiry.answer.guide
        if guide is not None:
            previous = guide


class _Inbox:
    """The newest question, which a thread reads: who asks never waits for the answers."""

    def __init__(self, connection: Connection) -> None:
        self._connection, self._arrival = connection, Condition()
        self._content = b""
        Thread(target=self._read, daemon=True).start()

    def take(self) -> Question:
        """Wait for a question."""
        with self._arrival:
            self._arrival.wait_for(lambda: self._content)
            content, self._content = self._content, b""
        question: Question = pickle.loads(content)
        return question

    def poll(self) -> None:
        """Raise `Superseded` if a question waits."""
        if self._content:
            raise Superseded

    def _read(self) -> None:
        with suppress(EOFError, OSError):
            while True:
                content = self._connection.recv_bytes()
                with self._arrival:
                    self._content = content
                    self._arrival.notify()
