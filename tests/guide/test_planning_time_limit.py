"""Planning as a whole ends at its time limit: with the best guide so far, or an error."""

from __future__ import annotations

import time

import pytest
from commands import casswarm

from casswarm import (
    PlanningError,
    SolverError,
    ValueFunction,
    load_scenario,
    plan,
    plan_baseline,
)
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


@pytest.mark.slow
def test_map_beyond_the_time_limit_costs_no_guide(tmp_path) -> None:
    options = ("--time-limit", 1000, "--map")
    done = casswarm(tmp_path, "plan", "single-agent", *options, code=1, failing=("map", "late"))
    assert "the map failed (PlanningError: the value function is not complete after 1000 s" in (
        done.stderr
    )
    assert (tmp_path / "results" / "plan-single-agent" / "guide.png").exists()


value_function = ValueFunction.from_scenario


def baseline(scenario, **options):
    return plan_baseline(scenario, plan(scenario, certify=False), **options)


@pytest.mark.parametrize(
    ("call", "options", "error", "words"),
    [
        (plan, {"time_limit": 1e-9}, PlanningError, "s ended the search before its first solve"),
        (baseline, {"time_limit": 1e-9}, PlanningError, "before its first solve"),
        (value_function, {"time_limit": 1e-9}, PlanningError, "not complete after 1e-09 s"),
        (plan, {"gap": 0.0}, ValueError, "gap = .*allowed"),
        (plan, {"gap": 1.0}, ValueError, "gap = .*allowed"),
        (plan, {"time_limit": 0.0}, ValueError, "time_limit = .*allowed"),
        (plan, {"search": "everywhere"}, SolverError, "'local', 'global'"),
    ],
)
def test_planning_within_impossible_limits_raises(call, options, error, words):
    with pytest.raises(error, match=words) as caught:
        call(SCENARIO, **options)
    if error is PlanningError:
        assert caught.value.time_limit == 1e-9
        assert "1e-09 s" in str(caught.value)
