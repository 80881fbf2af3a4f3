"""Answers in stages: their order, their agreement with the library, and how they end early."""

from __future__ import annotations

import pickle
import threading
import time
from itertools import pairwise

import pytest
from small_scenarios import small, three_members

import casswarm as csw
from casswarm.exploration import answers
from casswarm.exploration.answers import Answer, Inquiry, Question, Superseded


def told(scenario, policy="leader", previous=None, interrupt=lambda: None):
    """Every published answer."""
    published: list[Answer] = []
    Inquiry(Question(1, scenario, policy), published.append, interrupt).run(previous)
    return published


@pytest.mark.slow
def test_stages_come_in_order_and_agree_with_library():
    scenario = three_members()
    published = told(scenario)
    first, last = published[0], published[-1]
    assert first.guide is not None
    assert first.guide.risk_bound is first.study is first.distribution is None
    assert [answer.done for answer in published] == [False] * (len(published) - 1) + [True]
    assert last.failure == ""
    guide = csw.plan(scenario)
    assert last.guide.risk == pytest.approx(guide.risk, rel=1e-6)
    assert last.guide.risk_bound <= guide.risk
    exact = csw.evaluate(scenario, "leader", 1e-6, guide=last.guide).success
    interval, proven = last.success
    assert proven
    assert interval.low <= exact.high
    assert exact.low <= interval.high
    assert interval.width <= answers.TOLERANCE
    assert len(last.study.runs) == answers.RUNS[0]
    assert len(last.study.trajectories["leader"]) == answers.SAVED_RUNS


def test_bounds_become_narrower(monkeypatch):
    monkeypatch.setattr(answers, "_PUBLISH", 0.0)
    published = told(three_members())
    intervals = [a.distribution.success for a in published if a.distribution is not None]
    assert len(intervals) > 5
    for wider, narrower in pairwise(intervals):
        assert wider.low <= narrower.low + 1e-12
        assert narrower.high <= wider.high + 1e-12


@pytest.mark.slow
def test_slow_enumeration_is_followed_by_more_runs(monkeypatch):
    monkeypatch.setattr(answers, "MAX_STATES", 20)
    monkeypatch.setattr(answers, "RUNS", (50, 100, 200))
    published = told(three_members())
    runs = [len(answer.study.runs) for answer in published if answer.study is not None]
    assert sorted(set(runs)) == [50, 100, 200]
    interval, proven = published[-1].success
    assert not proven
    exact = csw.evaluate(three_members(), "leader", 1e-6).success
    assert interval.low < exact.midpoint < interval.high


def test_search_near_previous_guide_answers_first_and_full_search_decides():
    scenario = small([(0.0, 0.0)], (6.0, 0.0), [(3.0, 0.6)], 20)
    previous = csw.plan(scenario, certify=False)
    below = previous.positions[:, 1].min()
    assert below < 0 < 0.6
    moved = scenario.with_values({"hazard.radars": [[3.0, -0.6]]})  # the mirror image
    asked = Question(0, scenario, "leader")
    published = told(moved, previous=Answer(asked, guide=previous))
    near, full = published[0].guide, published[-1].guide
    assert len(near.candidates) < len(csw.plan(moved, certify=False).candidates)
    assert full.risk == pytest.approx(previous.risk, rel=1e-6)
    assert full.risk <= near.risk
    assert full.positions[:, 1].max() == pytest.approx(-below, rel=1e-3)


@pytest.mark.parametrize("changes", [{"time.dt": 0.3}, {"guide.search": "local"}])
def test_guide_of_other_steps_or_search_is_not_near(changes):
    scenario = three_members()
    previous = csw.plan(scenario, certify=False)
    assert answers.is_near(scenario, previous)
    assert not answers.is_near(scenario.with_values(changes), previous)


def test_work_is_interrupted_only_after_first_guide():
    published: list[Answer] = []

    def interrupt():
        raise Superseded

    with pytest.raises(Superseded):
        Inquiry(Question(1, three_members(), "leader"), published.append, interrupt).run()
    assert [answer.guide is not None for answer in published] == [True]


def test_scenario_without_guide_says_why():
    scenario = small([(0.0, 0.0)], (3.0, 0.0), [(1.5, 0.8)], 6, swarm__velocity=[-2.0, 0.0])
    (answer,) = told(scenario)
    assert answer.done
    assert answer.guide is None
    assert "no guide found" in answer.failure


def test_policy_that_does_not_apply_says_why_and_keeps_guide():
    answer = told(three_members(), "optimal")[-1]
    assert "two members" in answer.failure or "pair" in answer.failure
    assert answer.guide.arrives
    assert answer.success is None


UNKNOWN = small(
    [(0.0, 0.0)],
    (6.0, 0.0),
    [(3.0, 3.0)],
    20,
    hazard__case=[{"radars": [[3.0, -0.8]]}, {"radars": [[3.0, 0.8]]}],
)


@pytest.mark.slow
def test_guides_for_an_unknown_hazard_are_mixed_and_bounded():
    published = []
    Inquiry(Question(1, UNKNOWN, "leader", 1.0), published.append, lambda: None).run()
    drawn = [answer.drawn for answer in published]
    assert drawn == sorted(drawn)
    assert not drawn[0]  # the guide of the mean rates alone
    last = published[-1]
    assert last.failure == ""
    worst = csw.plan(UNKNOWN, ambiguity="worst")
    assert last.mixture.value.low == pytest.approx(worst.value.low, rel=1e-4)
    assert worst.value.low <= last.mixture.value.high < 1
    exact = csw.evaluate(UNKNOWN, "leader", 1e-6, guide=last.guide)
    assert last.success[0].low <= exact.success.high
    assert exact.success.low <= last.success[0].high
    for (_, ours), (_, theirs) in zip(last.distribution.cases, exact.cases, strict=True):
        assert ours.success.low <= theirs.success.high + 1e-12
        assert theirs.success.low <= ours.success.high + 1e-12


@pytest.mark.slow
def test_near_mixture_answers_before_work_makes_way():
    first = told(UNKNOWN)[-1]
    moved = UNKNOWN.with_values({"hazard.case": [{"radars": [[3.2, y]]} for y in (-0.7, 0.9)]})
    published: list[Answer] = []

    def interrupt():
        raise Superseded

    with pytest.raises(Superseded):
        Inquiry(Question(1, moved, "leader"), published.append, interrupt).run(first)
    assert [answer.mixture is not None for answer in published] == [False, True]
    full = csw.plan(moved, ambiguity="mean", certify=False)
    assert published[-1].mixture.value.low == pytest.approx(full.value.low, rel=1e-3)


def test_mixture_that_is_refused_says_why_and_success_follows():
    zones = UNKNOWN.with_values({"target.other": [{"center": [6.0, 3.0], "radius": 0.5}]})
    answer = told(zones)[-1]
    assert "target.other" in answer.failure
    assert answer.mixture is None
    assert answer.drawn
    assert answer.success[1]


def test_thousands_of_questions_start_one_timer(monkeypatch):
    children = []

    class Child:
        """In place of the process: passes on what `answer` is given."""

        def __init__(self, _serve):
            self.sent, self.ended = [], False
            self.send = self.sent.append
            children.append(self)

        def listen(self, receive):
            self.answer = lambda answer: receive(pickle.dumps(answer))

        def end(self):
            self.ended = True

    monkeypatch.setattr(answers, "Child", Child)
    monkeypatch.setattr(answers, "GRACE", 0.3)
    worker = answers.Worker(lambda _: None)
    worker.ask(Question(0, three_members(), "leader"))
    children[0].answer(Answer(Question(0, three_members(), "leader"), guide="a guide"))
    before = threading.active_count()
    for version in range(1, 500):
        worker.ask(Question(version, "packed quickly", "leader"))
    assert threading.active_count() <= before + 1
    time_limit = time.monotonic() + 20
    while len(children) == 1 and time.monotonic() < time_limit:
        time.sleep(0.02)
    assert children[0].ended
    (newest,) = map(pickle.loads, children[1].sent)
    assert newest.version == 499
