"""The session: history, refused changes, and answers about earlier states; no process."""

from __future__ import annotations

import numpy as np
import pytest
from small_scenarios import three_members

import casswarm as csw
from casswarm.exploration import session as session_module
from casswarm.exploration.answers import Answer, HazardMap
from casswarm.exploration.session import Session
from casswarm.exploration.view import View


class Answerless:
    """In place of the worker: notes the questions."""

    def __init__(self, receive):
        self.receive, self.questions, self.closed = receive, [], 0

    def ask(self, question):
        self.questions.append(question)

    def close(self):
        self.closed += 1


@pytest.fixture
def worker(monkeypatch):
    made = []

    def make(receive):
        made.append(Answerless(receive))
        return made[-1]

    monkeypatch.setattr(session_module, "Worker", make)
    return lambda: made[-1]


@pytest.fixture
def session(worker):  # noqa: ARG001  (replaces the process)
    return Session(three_members())


def test_radar_in_time_moves_with_its_path(worker):  # noqa: ARG001
    patrol = csw.load_scenario("patrol")
    session, track = Session(patrol), patrol.hazard_table.radar[0]
    assert session.move("radar", 0, (track.start[0] + 0.5, track.start[1] - 0.25))
    (moved, *rest) = session.scenario.hazard_table.radar
    assert tuple(rest) == patrol.hazard_table.radar[1:]
    for time in (0.0, 0.7, 2.0):
        shift = np.subtract(moved.track.position_at(time), track.track.position_at(time))
        np.testing.assert_allclose(shift, (0.5, -0.25), atol=1e-12)


@pytest.fixture(scope="module")
def guide():
    return csw.plan(three_members(), certify=False)


def test_moves_change_one_point_and_are_undone(session):
    before = session.scenario
    assert session.move("radar", 0, (1.0, 1.0))
    assert session.scenario.hazard_table.radars == ((1.0, 1.0),)
    assert session.move("member", 1, (0.4, 0.2))
    assert session.scenario.swarm.positions[1] == (0.4, 0.2)
    assert session.move("target", 0, (3.1, 0.1))
    assert session.scenario.target.center == (3.1, 0.1)
    after = session.scenario
    for _ in range(3):
        session.undo()
    assert session.scenario == before
    assert not session.history.can_undo
    for _ in range(5):
        session.redo()
    assert session.scenario == after
    session.reset()
    assert session.scenario == before
    session.undo()
    assert session.scenario == after


def test_changes_of_a_gesture_are_one_step(session):
    before = session.scenario
    for x in (1.1, 1.2, 1.3):
        session.move("radar", 0, (x, 1.0), gesture="drag 1")
    session.move("radar", 0, (1.4, 1.0), gesture="drag 2")
    session.undo()
    assert session.scenario.hazard_table.radars == ((1.3, 1.0),)
    session.undo()
    assert session.scenario == before


def test_change_after_undo_replaces_what_was_undone(session):
    session.change({"swarm.v_max": 1.9})
    session.undo()
    session.change({"swarm.v_max": 1.8})
    assert not session.history.can_redo
    assert session.scenario.swarm.v_max == 1.8


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        (lambda s: s.move("radar", 0, (0.0, 0.0)), "on hazard.radars[0]"),
        (lambda s: s.move("target", 0, (90.0, 0.0)), "out of reach"),
        (lambda s: s.change({"swarm.v_max": -1.0}), "swarm.v_max"),
        (lambda s: s.choose_policy("leadr"), "did you mean 'leader'"),
    ],
)
def test_impossible_change_says_why_and_changes_nothing(session, change, reason):
    session.change({"swarm.a_max": 0.4})
    before = session.scenario
    assert not change(session)
    assert reason in session.problem
    assert (session.scenario, session.policy) == (before, "leader")
    assert session.change({"swarm.a_max": 0.45})
    assert session.problem == ""


def test_number_of_members_is_a_parameter(session):
    assert session.change({"n": 6})
    assert session.scenario.n == 6


def test_questions_are_asked_only_while_somebody_listens(session, worker):
    session.change({"swarm.a_max": 0.4})
    assert worker().questions == []
    end = session.subscribe(lambda: None)
    assert [q.scenario for q in worker().questions] == [session.scenario]
    session.choose_policy("naive")
    assert worker().questions[-1].policy == "naive"
    end()
    end()
    assert worker().closed
    count = len(worker().questions)
    session.undo()
    assert len(worker().questions) == count


def test_answer_about_earlier_state_is_shown_until_there_is_a_newer_one(session, worker, guide):
    session.subscribe(lambda: None)
    first = worker().questions[-1]
    session.move("radar", 0, (1.2, 1.0))
    second = worker().questions[-1]
    worker().receive(Answer(first, guide=guide))
    assert session.answer is None
    assert session.last_good.question is first
    worker().receive(Answer(second, guide=guide))
    worker().receive(Answer(first, guide=guide, done=True))
    assert session.answer.question is session.last_good.question is second


def test_failure_keeps_last_good_answer(session, worker, guide):
    session.subscribe(lambda: None)
    worker().receive(Answer(worker().questions[-1], guide=guide))
    session.move("radar", 0, (1.2, 1.0))
    worker().receive(Answer(worker().questions[-1], failure="no guide found", done=True))
    assert session.last_good.guide is guide
    with pytest.raises(csw.PlanningError, match="no guide found"):
        _ = session.guide


def test_waiting_too_long_raises(session):
    with pytest.raises(TimeoutError, match=r"0\.01 s"):
        session.wait(0.01)


def test_save_writes_new_file_and_then_the_same(session, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "small-explored.toml").write_text("")
    session.move("radar", 0, (1.2, 1.0))
    path = session.save()
    assert path.name == "small-explored-2.toml"
    assert csw.load_scenario(path) == session.scenario
    session.undo()
    assert session.save() == path
    assert csw.load_scenario(path) == session.scenario


@pytest.mark.usefixtures("worker")
def test_wrong_arguments_are_refused_at_once():
    with pytest.raises(TypeError, match="load it first"):
        Session("paper-1")
    with pytest.raises(csw.PolicyError, match="leadr"):
        Session(three_members(), "leadr")


# --- what a page gets


@pytest.fixture
def page(session):
    messages = []
    view = View(session, messages.append)
    view.receive({"type": "open"})
    return view, messages


def test_page_gets_scene_first_and_then_what_changes(session, page, worker, guide):
    view, messages = page
    scene = messages[0]["scene"]
    assert scene["members"] == session.scenario.swarm.positions
    assert {item["key"] for item in scene["parameters"]} >= {"n", "swarm.v_max", "hazard.alpha_1"}
    assert messages[0]["busy"]
    messages.clear()
    hazard_map = HazardMap.around(session.scenario, guide)
    worker().receive(Answer(worker().questions[-1], hazard_map=hazard_map, guide=guide))
    (message,) = messages
    assert message["guide"]["positions"] == guide.positions.tolist()
    assert "scene" not in message
    messages.clear()
    view.receive({"type": "move", "point": "radar", "index": 0, "position": [0, 0], "number": 7})
    assert "on hazard.radars[0]" in messages[0]["problem"]
    assert messages[-1] == {"handled": 7}
    view.receive({"type": "copy"})
    assert messages[-1] == {"toml": session.scenario.to_toml()}


@pytest.fixture
def cloud(worker):  # noqa: ARG001
    return Session(csw.load_scenario("cloud"))


def test_ambiguity_is_a_state_that_is_undone(cloud):
    for share in (0.2, 0.4):
        assert cloud.choose_ambiguity(share, gesture="drag 1")
    cloud.move("radar", 0, (3.4, -1.4))
    assert cloud.ambiguity == 0.4
    cloud.undo()
    cloud.undo()
    assert (cloud.ambiguity, cloud.history.can_undo) == (0.0, False)
    for wrong in (-0.1, 1.1, float("nan")):
        assert not cloud.choose_ambiguity(wrong)
        assert "ambiguity = " in cloud.problem


def test_page_of_cases_has_their_radars_and_a_slider(cloud):
    messages = []
    view = View(cloud, messages.append)
    view.receive({"type": "open"})
    scene = messages[0]["scene"]
    assert scene["clouds"] == [0] * 9
    assert scene["cases"] == [(k,) for k in range(9)]
    assert sum(scene["prior"]) == pytest.approx(1.0)
    assert scene["parameters"][0]["key"] == "ambiguity"
    view.receive({"type": "change", "key": "ambiguity", "value": 1})
    assert cloud.ambiguity == 1.0
    assert messages[-1]["scene"]["parameters"][0]["value"] == 1.0
    for wrong in ("much", None, 2):
        view.receive({"type": "change", "key": "ambiguity", "value": wrong})
    assert cloud.ambiguity == 1.0


def test_known_hazard_has_no_mixture(session, page):
    _, messages = page
    assert "ambiguity" not in {item["key"] for item in messages[0]["scene"]["parameters"]}
    assert messages[0]["scene"]["prior"] == [1.0]
    with pytest.raises(csw.PlanningError, match="the hazard is known"):
        _ = session.mixture


@pytest.mark.parametrize(
    "message",
    [
        None,
        [],
        {},
        {"type": "remove"},
        {"type": "move", "point": "sun", "index": 0, "position": [0, 0]},
        {"type": "move", "point": "radar", "index": 9, "position": [0, 0]},
        {"type": "move", "point": "radar", "index": 0, "position": "far"},
        {"type": "change"},
    ],
)
def test_page_that_sends_nonsense_is_told_so(session, page, message):
    before = session.scenario
    view, messages = page
    messages.clear()
    view.receive(message)
    assert "load it again" in messages[0]["notice"]
    assert session.scenario == before


def test_last_page_that_closes_ends_the_work(page, worker):
    view, _ = page
    view.receive({"type": "open"})
    view.receive({"type": "close"})
    assert not worker().closed
    view.receive({"type": "close"})
    assert worker().closed
