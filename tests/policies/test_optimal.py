"""The policy of two members that follows their best known plan."""

from __future__ import annotations

import pytest
from commands import casswarm
from policy_cases import guide, policy, scenario

import casswarm as csw

SCENARIO = scenario("optimal")


def test_pair_off_plan_succeeds_more_often_than_straight_lines():
    """From a disturbed start, members return to the plan."""
    moved = SCENARIO.with_values({"swarm.positions": [[0.1, -0.3], [-0.2, 0.1]]})
    found = csw.evaluate(moved, policy("optimal"), 0.0, guide=guide("optimal")).success
    naive = csw.evaluate(moved, "naive", 0.0).success
    assert found.low > naive.high


@pytest.mark.slow
def test_optimal_is_at_least_as_good_as_every_other_policy():
    laws = {
        name: csw.evaluate(SCENARIO, name, 1e-6, guide=guide("optimal")).success
        for name in ("naive", "leader", "leader-feedback", "joint", "joint-replanning")
    }
    best = csw.evaluate(SCENARIO, policy("optimal"), 0.0, guide=guide("optimal")).success
    assert best.low >= max(law.low for law in laws.values()) - 1e-9
    assert best.width < 1e-9


def test_exchanged_members_have_the_same_law():
    fixed = SCENARIO.with_values({"swarm.velocity": [1.0, 0.5]})
    exchanged = fixed.with_values({"swarm.positions": fixed.positions[::-1]})
    first, second = (csw.evaluate(s, "optimal", 0.0).success for s in (fixed, exchanged))
    assert abs(first.low - second.low) < 1e-5


def test_command_line_refuses_five_members(tmp_path):
    done = casswarm(tmp_path, "evaluate", "gauntlet", "--policy", "optimal", code=2)
    assert "two members" in done.stderr
    assert "Traceback" not in done.stderr
