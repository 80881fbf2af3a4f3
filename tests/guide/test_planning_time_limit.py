"""Planning as a whole ends at its time limit: with the best guide so far, or an error."""

from __future__ import annotations

import re
import time

import pytest
from commands import casswarm

from casswarm import PlanningError, ValueFunction, load_scenario, plan
from casswarm.guide import Multistart

SCENARIO = load_scenario("paper-1").with_values({"guide.arrival": "any"})


def test_search_at_its_limit_returns_best_guide_with_note(monkeypatch) -> None:
    solves: list[object] = []
    monkeypatch.setattr(Multistart, "_report_solve", lambda *call: solves.append(call))
    monkeypatch.setattr(Multistart, "expired", property(lambda _: len(solves) >= 2))
    guide = plan(SCENARIO, search="global", time_limit=1000.0)
    assert len(guide.candidates) == 2
    assert guide.arrives
    assert guide.risk_bound is None
    assert guide.note == "the time limit of 1000 s ended the search after 2 solves"
    assert guide.note in str(guide)


def test_limit_before_first_solve_raises_error_with_limit() -> None:
    words = re.escape("the time limit of 1e-09 s ended the search before its first solve")
    with pytest.raises(PlanningError, match=words) as caught:
        plan(SCENARIO, time_limit=1e-9)
    assert caught.value.time_limit == 1e-9


def test_guide_without_time_limit_has_no_note() -> None:
    assert plan(SCENARIO, certify=False).note == ""


def test_proof_takes_what_is_left_of_the_time(monkeypatch) -> None:
    given, started = [], time.monotonic()
    monkeypatch.setattr("casswarm.guide.plan.certify_guide", lambda *a: given.append(a[-1]))
    plan(SCENARIO, time_limit=500.0)
    plan(SCENARIO)
    assert started + 500.0 <= given[0] <= time.monotonic() + 500.0
    assert given[1] is None


@pytest.mark.slow  # it builds a problem of 100,000 steps
def test_command_with_many_steps_ends_at_its_time_limit(tmp_path) -> None:
    options = ("--set", "time.dt=1e-4", "--time-limit", 3)
    done = casswarm(tmp_path, "plan", "paper-1", *options, code=1)
    assert "100000 of at most 100000 steps" in done.stderr
    assert "the time limit of 3 s ended the search" in done.stderr


def test_value_function_at_its_limit_raises_error_with_limit() -> None:
    with pytest.raises(PlanningError, match="not complete after 1e-09 s") as caught:
        ValueFunction.from_scenario(SCENARIO, time_limit=1e-9)
    assert caught.value.time_limit == 1e-9


@pytest.mark.slow
def test_map_beyond_the_time_limit_costs_no_guide(tmp_path) -> None:
    options = ("--time-limit", 1000, "--map")
    done = casswarm(tmp_path, "plan", "single-agent", *options, code=1, failing=("map", "late"))
    assert "the map failed (PlanningError: the value function is not complete after 1000 s" in (
        done.stderr
    )
    assert (tmp_path / "results" / "plan-single-agent" / "guide.png").exists()
