"""The process that answers: the newest question, its end, and what happens when it dies."""

from __future__ import annotations

import os
import signal
import time

import pytest
from small_scenarios import three_members

from casswarm.exploration import answers
from casswarm.exploration.session import Session

pytestmark = pytest.mark.slow  # a process starts in some seconds


@pytest.fixture
def session():
    session = Session(three_members())
    yield session
    session.close()


def process_of(session):
    return session._worker._child.process


def has_ended(process, seconds=60):
    """Return True if a process ends in time.

    Not by `join`: where another thread has just waited for the process, but not yet noted its exit
    code, `join` returns at once and `is_alive` is still true.
    """
    end = time.monotonic() + seconds
    while process.is_alive() and time.monotonic() < end:
        time.sleep(0.05)
    return not process.is_alive()


def test_present_objects_follow_changes_and_newest_question_is_answered(session):
    first = session.guide
    assert first.arrives
    for x in (1.0, 1.2, 1.4, 1.6):
        session.move("radar", 0, (x, -0.3))
    answer = session.wait(120)
    assert answer.question.scenario == session.scenario
    assert answer.guide is session.guide
    assert session.study.scenario == session.scenario
    assert session.guide.positions[:, 1].max() > first.positions[:, 1].max()


def test_end_of_last_listener_ends_the_process_and_next_one_starts_it(session):
    end = session.subscribe(lambda: None)
    session.wait(120)
    process = process_of(session)
    end()
    assert not process.is_alive()
    session.change({"swarm.a_max": 0.4})
    assert session.wait(120).failure == ""
    assert process_of(session) is not process


def test_process_that_dies_is_reported_and_started_again(session):
    session.subscribe(lambda: None)
    session.wait(120)
    os.kill(process_of(session).pid, signal.SIGSTOP)  # so that it cannot answer
    session.choose_policy("naive")
    os.kill(process_of(session).pid, signal.SIGKILL)
    assert "ended unexpectedly" in session.wait(120).failure
    session.choose_policy("leader")
    assert session.wait(120).failure == ""


def test_idle_process_ends_and_next_change_starts_another(session, monkeypatch):
    monkeypatch.setattr(answers, "IDLE", 0.2)
    session.subscribe(lambda: None)
    assert session.wait(120).failure == ""
    process = process_of(session)
    assert has_ended(process)
    assert session.wait(1).failure == ""  # the answer stays
    session.change({"swarm.a_max": 0.4})
    assert session.wait(120).failure == ""
    assert process_of(session) is not process


def test_work_that_does_not_make_way_is_ended(monkeypatch):
    monkeypatch.setattr(answers, "GRACE", 0.2)
    session = Session(three_members())
    session.subscribe(lambda: None)
    assert session.guide.arrives
    process = process_of(session)
    os.kill(process.pid, signal.SIGSTOP)  # as compiled code that does not look for questions
    session._worker._latest = session.answer  # not `done` even if the last answer came meanwhile
    session.change({"swarm.a_max": 0.4})
    try:
        assert has_ended(process)
        assert session.wait(120).question.scenario == session.scenario
    finally:
        session.close()
