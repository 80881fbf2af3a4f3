"""The process that answers questions, the newest first; it ends with the process that asks."""

from __future__ import annotations

import pickle
from collections.abc import Callable
from contextlib import suppress
from functools import partial
from threading import RLock, Timer

from .._util.child import Channel, Child, packed
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
        self._child: Child | None = None
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
            if self._child is None:
                self._child, self._latest = Child(_answer_questions), None
                self._child.listen(partial(self._take, self._child))
            with suppress(OSError):  # the process has died: the thread that reads will report it
                self._child.send(content)
        if self._is_late(question):
            _later(GRACE, self._restart_if_late, question)

    def close(self) -> None:
        """End the process, whatever it does; the next question starts another one."""
        with self._lock:
            child, self._child = self._child, None
            self._latest = self._wanted = None
        if child is not None:
            child.end()

    def _take(self, child: Child, content: bytes) -> None:
        """Pass on an answer, or report that the process ended."""
        answer: Answer | None = pickle.loads(content) if content else None
        with self._lock:
            if child is not self._child or self._wanted is None:
                return
            if answer is None:
                self._child = None
                text = "the process that computes ended unexpectedly; any change starts it again"
                answer = Answer(self._wanted, failure=text, done=True)
            else:
                self._latest = answer
        self._receive(answer)
        if content and answer.done:
            _later(IDLE, self._end_if_idle, answer.question.version)

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


def _answer_questions(channel: Channel) -> None:
    """Answer questions, in the other process, until this one ends."""

    def poll() -> None:
        if channel.waiting:
            raise Superseded

    previous: Guide | None = None
    for question in channel.requests():
        if channel.waiting:  # for a newer one
            continue
        inquiry = Inquiry(pickle.loads(question), lambda answer: channel.send(packed(answer)), poll)
        with suppress(Superseded):
            inquiry.run(previous)
        previous = inquiry.answer.guide or previous
