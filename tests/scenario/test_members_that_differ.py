"""Kinds of members: rates, motion, arrivals and leaders, bounds, and what is wrong in a table."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from brute_force import commanded, law_by_hand, success_of
from numpy.typing import NDArray
from parametric_cases import START, assert_equals_differences, scene, steered
from small_scenarios import BESIDE, abreast, colliding, pair, small

import casswarm as csw
from casswarm.errors import ScenarioError
from casswarm.formation.task import LEADER_SELECTION
from casswarm.guide.agent import initial_velocities
from casswarm.motion import Motion, Step
from casswarm.policies.formation_policies import LeaderPolicy
from casswarm.scenario.variations import with_parameters

COMPANION = {"exposure": 2.0, "density": 3.0, "counts": False}
KINDS: dict[str, object] = {
    "swarm.kind": ["carrier", "companion", "slow"],
    "swarm.kinds.companion": COMPANION | {"v_max": 2.5, "a_max": 1.0},
    "swarm.kinds.slow": {"v_max": 1.8, "a_max": 0.3, "exposure": 0.5},
}


def three(**values: object) -> csw.Scenario:
    """A carrier, a companion that does not count, and a slow member."""
    return abreast(3, **values).with_values(KINDS)


def all_of(kind: dict[str, object], scenario: csw.Scenario) -> csw.Scenario:
    """The scenario with all members of one kind."""
    return scenario.with_values({"swarm.kind": ["one"] * scenario.n, "swarm.kinds.one": kind})


# --- what does not change


@pytest.mark.parametrize("name", ["leader", "constrained", "naive"])
def test_kinds_without_differences_change_nothing(name: str) -> None:
    plain = abreast(3)
    same = plain.with_values({"swarm.kind": ["a", "b", "a"], "swarm.kinds.b": {"exposure": 1.0}})
    results = [csw.evaluate(one, name, 1e-7) for one in (plain, same)]
    assert results[0].success == results[1].success


@pytest.mark.parametrize(
    "name", [pytest.param("leader", marks=pytest.mark.slow), "constrained", "naive"]
)
@pytest.mark.parametrize("collide", [False, True])
def test_members_of_one_kind_are_those_of_scaled_constants(name: str, collide: bool) -> None:
    """A rate e S / (1 + c alpha_2 D) is that of e alpha_1 and c alpha_2; a zone's rate follows."""
    zone = [{"center": [1.0, -0.6], "radius": 0.2, "rate": 3.0, "edge": 0.3}]
    plain = abreast(3, hazard__zone=zone)
    plain = colliding(plain) if collide else plain
    kind: dict[str, object] = {"exposure": 1.7, "density": 0.4, "v_max": 1.9, "a_max": 0.6}
    share = 1.7 * (1 + 3.0) / (1 + 0.4 * 3.0)
    scaled = plain.with_values(
        {
            "swarm.v_max": 1.9,
            "swarm.a_max": 0.6,
            "hazard.alpha_1": 1.7 * 4.0,
            "hazard.alpha_2": 0.4 * 3.0,
            "hazard.zone": [zone[0] | {"rate": 3.0 * share}],
        }
    )
    one = all_of(kind, plain)
    low, high = (csw.evaluate(each, name, 1e-7).success.low for each in (one, scaled))
    assert low == pytest.approx(high, rel=1e-6)
    risks = [csw.plan(each, certify=False).risk for each in (one, scaled)]
    assert risks[0] == pytest.approx(risks[1], rel=1e-9)


def test_units_of_length_and_time_do_not_matter() -> None:
    plain = three()
    length, time = 3.0, 0.5
    speed = length / time
    table = plain.hazard_table
    values: dict[str, object] = {
        "swarm.positions": (length * plain.positions).tolist(),
        "swarm.v_max": speed * plain.swarm.v_max,
        "swarm.a_max": speed**2 * plain.swarm.a_max,
        "target.center": (length * np.array(plain.target.center)).tolist(),
        "target.radius": length * plain.target.radius,
        "time.dt": time * plain.time.dt,
        "time.t_f": time * plain.time.t_f,
        "hazard.radars": (length * np.array(table.radars)).tolist(),
        "hazard.alpha_1": length**2 / time * 4.0,
        "hazard.alpha_3": 4.0 / length**2,
        "formation.rho": length**2 * plain.formation.rho,
    }
    for name, kind in plain.swarm.kinds.items():
        values[f"swarm.kinds.{name}.v_max"] = speed * (kind.v_max or 0.0)
        values[f"swarm.kinds.{name}.a_max"] = speed**2 * (kind.a_max or 0.0)
    results = [
        csw.evaluate(one, "leader", 1e-6).success for one in (plain, plain.with_values(values))
    ]
    assert results[0].low == pytest.approx(results[1].low, abs=1e-5)


@pytest.mark.slow
def test_order_of_members_does_not_matter() -> None:
    positions = [(0.0, 0.0), (0.4, 0.1), (-0.2, 0.4), (0.1, -0.3)]
    kinds, order = ["carrier", "companion", "slow", "slow"], [3, 2, 0, 1]
    scenario = small(positions, (3.0, 0.2), BESIDE, 8)
    plain = scenario.with_values(KINDS | {"swarm.kind": kinds})
    moved = plain.with_values(
        {
            "swarm.positions": plain.positions[order].tolist(),
            "swarm.kind": [kinds[row] for row in order],
        }
    )
    for name in ("leader", "constrained", "naive"):
        lows = [csw.evaluate(one, name, 1e-6).success.low for one in (plain, moved)]
        assert lows[0] == pytest.approx(lows[1], abs=1e-5)


# --- the chain


@pytest.mark.parametrize("name", ["leader", "constrained", "naive"])
@pytest.mark.parametrize("arrivals", [1, 2])
def test_exact_law_equals_recursion_by_hand(name: str, arrivals: int) -> None:
    scenario = three(steps=6, success__arrivals=arrivals)
    guide = csw.plan(scenario, certify=False)
    policy = csw.make_policy(name, scenario, guide)
    previous = initial_velocities(scenario, guide)
    law = law_by_hand(scenario, previous, commanded(scenario, policy))
    exact = csw.evaluate(scenario, policy, 1e-9, guide=guide, aggregation_tol=0.0)
    assert exact.success.low - 1e-9 <= success_of(law) <= exact.success.high + 1e-9


def test_sampled_frequency_agrees_with_the_law() -> None:
    scenario = three()
    exact = csw.evaluate(scenario, "leader", 1e-6).success
    runs = csw.simulate(scenario, ["leader"], 20_000, seed=7).summary.iloc[0]
    error = 4.0 * np.sqrt(exact.low * (1 - exact.low) / 20_000)
    assert abs(runs.success - exact.low) < error


def test_an_arrival_that_does_not_count_is_no_success() -> None:
    plain = small([(0.0, 0.0), (1.2, 0.0)], (2.4, 0.0), [(9.0, 9.0)], 4)
    kinds = {"swarm.kind": ["far", "near"], "swarm.kinds.near": {"counts": False}}
    counted = plain.with_values(kinds)
    laws = [csw.evaluate(one, "naive", 1e-9).arrival for one in (plain, counted)]
    assert [int(law.argmax()) for law in laws] == [3, 4]


def test_companions_protect() -> None:
    """The same two carriers, alone and with a companion that adds to their density."""
    near = [(0.0, 0.0), (0.2, 0.3), (0.1, 0.1)]
    scenario = small(near, (2.0, 0.4), [(1.3, 0.7), (2.1, -0.9)], 6)
    kinds = {"swarm.kind": ["carrier", "carrier", "companion"]}
    successes = []
    for density in (0.5, 1.0, 3.0, 10.0):
        companion = COMPANION | {"density": density}
        one = scenario.with_values(kinds | {"swarm.kinds.companion": companion})
        successes.append(csw.evaluate(one, "leader", 1e-6).success.low)
    assert np.diff(successes).min() > 0.0


# --- motion


def test_every_member_obeys_its_own_limits() -> None:
    scenario = three()
    limits = [(kind.v_max, kind.a_max) for kind in scenario.swarm.member_kinds]
    runs = csw.simulate(scenario, ["leader", "naive"], 9, seed=1, save_trajectories=9)
    for trajectory in (one for saved in runs.trajectories.values() for one in saved):
        velocities = np.diff(trajectory.positions, axis=0) / scenario.time.dt
        for member, (v_max, a_max) in enumerate(limits):
            alive = trajectory.alive[1:, member]
            own = velocities[alive, member]
            assert v_max is not None
            assert a_max is not None
            assert np.abs(own).max(initial=0.0) <= v_max * (1 + 1e-6)
            changes = (np.diff(own, axis=0) ** 2).sum(axis=-1)
            assert changes.max(initial=0.0) <= a_max * (1 + 1e-5) + 1e-9


def test_slow_members_begin_no_faster_than_they_can() -> None:
    scenario = three()
    guide = csw.plan(scenario, certify=False)
    velocities = initial_velocities(scenario, guide)
    bounds = [kind.v_max for kind in scenario.swarm.member_kinds]
    assert (np.abs(velocities).max(axis=1) <= np.array(bounds, float)).all()
    np.testing.assert_array_equal(velocities[0], guide.velocities[0])


# --- leaders and guides


@pytest.mark.parametrize("rule", LEADER_SELECTION)
def test_leaders_are_among_those_that_count(rule: str) -> None:
    rng, counts = np.random.default_rng(0), np.array([True, False, True])
    scenario = three()
    alive = rng.random((200, 3)) < 0.6
    X = rng.normal(0.0, 0.3, (200, 3, 2))
    state = X, 0 * X, alive, np.zeros((1, 2))
    step = Step(scenario.hazard, Motion.from_scenario(scenario), *state, counts=counts)
    leaders = LEADER_SELECTION[rule](step, np.zeros(2))
    counting = alive & counts
    assert counting[counting.any(axis=1), leaders[counting.any(axis=1)]].all()
    others = ~counting.any(axis=1) & alive.any(axis=1)
    assert alive[others, leaders[others]].all()


def test_guide_starts_at_the_central_member_that_counts_and_is_of_its_kind() -> None:
    positions = [(0.0, 0.0), (3.0, 0.0), (0.1, 0.2), (1.0, 0.0)]
    scenario = small(positions, (5.0, 1.0), [(3.0, 1.5)], 16).with_values(
        {
            "swarm.kind": ["fast", "fast", "fast", "companion"],
            "swarm.kinds.fast": {"v_max": 1.6, "a_max": 0.2},
            "swarm.kinds.companion": COMPANION,
        }
    )
    assert scenario.guide_start.tolist() == [0.1, 0.2]
    assert scenario.guide_a_max == 0.2
    guide = csw.plan(scenario)
    assert np.abs(guide.velocities).max() <= 1.6 * (1 + 1e-9)
    assert guide.risk_bound <= guide.risk
    assert scenario.for_guide.n == 3
    assert scenario.for_guide.arrival_margin == scenario.arrival_margin


# --- gradients


@pytest.mark.parametrize("smoothing", [0.0, 0.2])
def test_gradient_is_that_of_finite_differences(smoothing: float) -> None:
    kinds = {
        "swarm.kind": ["carrier", "companion", "slow"],
        "swarm.kinds.companion": COMPANION | {"a_max": 0.3},
        "swarm.kinds.slow": {"v_max": 1.25, "exposure": 0.5},
    }
    scenario = scene().with_values(kinds)
    assert_equals_differences(scenario, steered(scenario), START, arrival_smoothing=smoothing)


# --- bounds


def test_no_rate_is_below_that_of_the_most_favourable_kind() -> None:
    rng = np.random.default_rng(1)
    for plain in (three(), colliding(three())):
        X, alive = rng.normal(0.0, 1.0, (500, 3, 2)), rng.random((500, 3)) < 0.7
        rates = plain.hazard.rates(X, alive)
        assert (plain.most_favourable.hazard.rates(X, alive) <= rates).all()


def test_success_bound_holds_for_all_policies() -> None:
    scenario = three()
    bound = csw.success_bound(scenario, 20_000, max_work=1e6)
    assert bound.certified
    for name in ("leader", "constrained", "naive"):
        assert csw.evaluate(scenario, name, 1e-6).success.low <= bound.value


def test_members_that_do_not_count_do_not_raise_the_bound_of_clocks() -> None:
    alone = pair(6)
    kinds = {"swarm.kind": ["carrier", "idle"], "swarm.kinds.idle": {"counts": False}}
    one = alone.with_values(kinds)
    bounds = [csw.success_bound(each, 20_000, max_work=0.0).value for each in (one, alone)]
    assert bounds[0] < bounds[1]


# --- some of the members


def test_some_of_the_members_are_as_if_there_were_no_others() -> None:
    scenario = three()
    two = scenario.of_members([2, 0])
    assert two.swarm.kind == ("slow", "carrier")
    assert list(two.swarm.kinds) == ["slow"]
    assert two.positions.tolist() == scenario.positions[[2, 0]].tolist()
    loaded = csw.Scenario.from_data(two.model_dump(by_alias=True, exclude_none=True))
    assert loaded == two
    assert csw.evaluate(two, "leader", 1e-6).success == csw.evaluate(loaded, "leader", 1e-6).success
    assert abreast(3).of_members([1]).n == 1
    assert abreast(3).of_members([0, 1]) == abreast(2)


@pytest.mark.slow
def test_replanning_is_no_worse_and_serves_members_that_cannot_arrive_alone() -> None:
    """After the loss of all others, the slow member could not have come from the start."""
    scenario = three(steps=6).with_values({"swarm.kinds.slow.v_max": 1.3})
    plan = csw.plan_swarm(scenario, certify=False)
    for name in ("joint", "joint-replanning"):
        found = csw.evaluate(scenario, name, 1e-6).success
        assert found.high >= plan.success.low - 1e-9


def test_guide_waits_within_the_reach_of_its_own_leader() -> None:
    scenario = three(steps=14).with_values(
        {"swarm.kind": ["slow", "companion", "slow"], "swarm.kinds.slow.v_max": 1.2}
    )
    guide = csw.plan(scenario, certify=False)
    policy = csw.make_policy("leader", scenario, guide)
    assert isinstance(policy, LeaderPolicy)
    policy = replace(policy, max_wait=6)
    late = np.tile(guide.reference(1), (1, 3, 1))
    late[:, 1] += 5.0  # the companion is far ahead
    data = policy._data(3, late, 0 * late, np.ones((1, 3), bool))
    way = float(np.hypot(*(data.goals[0, 0] - late[0, 0])))
    assert way == pytest.approx(np.sqrt(2) * 1.2 * scenario.time.dt, rel=1e-5)


# --- wrong tables


@pytest.mark.parametrize(
    ("values", "key", "text"),
    [
        ({"swarm.kind": ["carrier"]}, "swarm.kind", "has 1 name and swarm.positions 3 members"),
        ({"swarm.kinds.other": {}}, "swarm.kinds.other", "is the kind of no member"),
        ({"success.arrivals": 3}, "success.arrivals", r"2 members that count \(swarm.kinds\)"),
        ({"swarm.kind": ["companion"] * 3, "swarm.kinds.slow": None}, "swarm.kind", "counts"),
        ({"swarm.kinds.slow.exposure": 0.0}, "swarm.kinds.slow.exposure", "above 0"),
        ({"swarm.kinds.slow.vmax": 1.0}, "swarm.kinds.slow.vmax", r"did you mean .*\.v_max"),
        ({"swarm.kinds.slow.v_max": -1.0}, "swarm.kinds.slow.v_max", "above 0"),
        ({"swarm.kinds.slow": 3.0}, "swarm.kinds.slow", r"a table for each name"),
        ({"swarm.kinds": {"a-b": {}}}, "swarm.kinds.a-b", "letters, digits and underscores"),
        ({"swarm.kind": [1, 2, 3]}, r"swarm.kind[0]", "a list of names"),
        ({"swarm.velocity": [1.9, 0.0]}, "swarm.velocity", "v_max of a kind = 1.8"),
        (
            {"hazard.alpha_1": 1e20, "swarm.kinds.companion.exposure": 1e3},
            "swarm.kinds.companion.exposure",
            "times hazard.alpha_1",
        ),
    ],
)
def test_wrong_kinds_are_refused_by_key(values: dict[str, object], key: str, text: str) -> None:
    with pytest.raises(ScenarioError, match=text) as caught:
        three().with_values(values)
    assert caught.value.key == key


def test_number_of_members_cannot_be_varied() -> None:
    with pytest.raises(ScenarioError, match="n cannot be varied") as caught:
        with_parameters(three(), {"n": 2})
    assert caught.value.key == "swarm.kind"


def rates_of_users(positions: Any, alive: Any) -> NDArray[np.float64]:  # noqa: ARG001
    return 0.0 * positions[:, 0] + 0.1


def test_factors_of_users_rates_are_theirs() -> None:
    with pytest.raises(ScenarioError, match="whose rates are your own") as caught:
        three().with_hazard(rates_of_users)
    assert caught.value.key == "swarm.kinds.companion.exposure"
    kinds = {"swarm.kinds.companion": {"counts": False}, "swarm.kinds.slow": {"v_max": 1.8}}
    own = (
        abreast(3)
        .with_hazard(rates_of_users)
        .with_values({"swarm.kind": ["carrier", "companion", "slow"], **kinds})
    )
    assert csw.evaluate(own, "leader", 1e-4).success.low > 0.0


def test_file_with_kinds_reads_back(tmp_path: Path) -> None:
    csw.save_scenario(three(), tmp_path / "kinds.toml", comments=True)
    text = (tmp_path / "kinds.toml").read_text()
    assert csw.load_scenario(tmp_path / "kinds.toml") == three()
    assert "[swarm.kinds.companion]" in text
    assert max(map(len, text.splitlines())) <= 80


def test_refined_steps_keep_every_kind_s_acceleration() -> None:
    fine = three().refined(2)
    assert fine.swarm.kinds["slow"].a_max == 0.3 / 4
    assert fine.swarm.kinds["companion"].a_max == 1.0 / 4
