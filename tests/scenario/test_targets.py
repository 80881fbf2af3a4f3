"""Several target zones: a member may arrive in any of them."""

from __future__ import annotations

import numpy as np
import pytest
from brute_force import commanded, law_by_hand, success_of
from small_scenarios import small

import casswarm as csw
from casswarm.bounds.success_bound import CLOCKS
from casswarm.errors import ScenarioError

STARTS = [(0.0, 0.0), (0.2, 0.4), (-0.6, -0.3)]
EAST, NORTH = {"center": [1.6, 0.0], "radius": 0.5}, {"center": [0.0, 1.7], "radius": 0.4}
ONE = small(STARTS, (1.6, 0.0), [(0.9, 0.5)], 4, swarm__a_max=8.0, swarm__velocity=[0.5, 0.0])
BOTH = ONE.replace(target={"other": [NORTH]})
NEAR_EAST = ONE.replace(hazard={"radars": [[1.2, 0.4]]})  # a radar before the first target zone


def toward_both(_step: int, x: np.ndarray, _v: np.ndarray, alive: np.ndarray) -> np.ndarray:
    goals = np.array([EAST["center"], NORTH["center"], EAST["center"]])
    return np.clip(goals - x, -1.9, 1.9) * alive[..., None]


@pytest.mark.parametrize("policy", ["leader", toward_both], ids=["leader", "both"])
def test_law_is_that_of_a_recursion_of_the_equations(policy: object) -> None:
    one = BOTH.replace(swarm={"a_max": 100.0})  # so that no command is changed
    each = csw.make_policy(policy, one) if isinstance(policy, str) else csw.as_policy(policy)
    start = np.tile(one.swarm.velocity, (3, 1))
    expected = success_of(law_by_hand(one, start, commanded(one, each)))
    exact = csw.evaluate(one, each, 0.0, aggregation_tol=0.0).success
    assert exact.low == pytest.approx(expected, abs=1e-9)
    runs = csw.simulate(one, [each], 3000, seed=1).summary.success[0]
    assert abs(runs - expected) < 4.5 * np.sqrt(expected * (1 - expected) / 3000) + 1e-9


def test_guide_leads_to_the_best_zone_and_its_bound_is_of_all() -> None:
    guides = {}
    for name, target in (("east", EAST), ("north", NORTH)):
        guides[name] = csw.plan(NEAR_EAST.replace(target=target))
    both = csw.plan(NEAR_EAST.replace(target={"other": [NORTH]}))
    assert guides["north"].risk < guides["east"].risk
    assert both.risk == pytest.approx(guides["north"].risk, rel=1e-6)
    assert tuple(both.center) == tuple(NORTH["center"])
    bounds = [guide.risk_bound for guide in guides.values()]
    assert both.risk_bound == pytest.approx(min(bounds), rel=0.02)
    assert both.risk_bound <= both.risk
    swapped = csw.plan(
        NEAR_EAST.replace(target={**NORTH, "other": [EAST]}, hazard={"core_radius": 0.01})
    )
    assert swapped.risk == pytest.approx(both.risk, rel=1e-6)


@pytest.mark.slow
def test_a_zone_that_no_guide_reaches_does_not_spoil_the_bound() -> None:
    slow = NEAR_EAST.replace(swarm={"a_max": 0.02, "velocity": [1.9, 0.0]})
    behind = {"center": [-1.9, 0.0], "radius": 0.2}  # in reach, but not with this acceleration
    both, plain = csw.plan(slow.replace(target={"other": [behind]})), csw.plan(slow)
    np.testing.assert_array_equal(both.positions, plain.positions)
    assert both.risk_bound is not None
    assert both.risk_bound <= both.risk


def test_policies_follow_the_guide_to_its_zone() -> None:
    one = NEAR_EAST.replace(target={"other": [NORTH]})
    north = NEAR_EAST.replace(target=NORTH, hazard={"core_radius": 0.01})
    for name in ("naive", "leader", "constrained", "leader-mpc-2"):
        chances = [csw.evaluate(s, name, 1e-9).success.low for s in (one, north)]
        assert chances[0] >= chances[1] - 1e-6


def test_success_bound_is_of_independent_clocks_to_the_nearest_zone() -> None:
    bound = csw.success_bound(BOTH)
    assert bound.method == CLOCKS
    alone = [csw.success_bound(ONE.replace(target=t), max_work=0).risks for t in (EAST, NORTH)]
    np.testing.assert_allclose(bound.risks, np.min(alone, axis=0), rtol=0.02)
    for name in ("naive", "leader", "constrained"):
        assert csw.evaluate(BOTH, name, 1e-9).success.high <= bound.value


def test_a_guide_that_crosses_another_zone_has_arrived_there() -> None:
    between = {"center": [0.8, 0.0], "radius": 0.2}
    far = small([(0.0, 0.0)], (2.4, 0.0), [(1.2, 3.0)], 6, swarm__a_max=8.0)
    guide = csw.plan(far.replace(target={"other": [between]}), certify=False)
    assert far.replace(target=between).target.contains(guide.positions[-1])
    assert len(guide.positions) == len(guide.velocities) + 1 == len(guide.rates) + 1


def test_zones_out_of_reach_do_not_matter() -> None:
    far = {"center": [90.0, 0.0], "radius": 0.5}
    one = ONE.replace(target={"other": [far]})
    guide, plain = csw.plan(one), csw.plan(ONE)
    np.testing.assert_array_equal(guide.positions, plain.positions)
    assert guide.risk_bound == pytest.approx(plain.risk_bound, rel=1e-9)
    swapped = ONE.replace(target={**far, "other": [EAST]}, hazard={"core_radius": 0.01})
    assert csw.plan(swapped).risk == pytest.approx(plain.risk, rel=1e-9)
    with pytest.raises(ScenarioError, match="out of reach"):
        ONE.replace(target={**far, "other": [{**far, "center": [-80.0, 0.0]}]})


def test_files_may_repeat_the_table(tmp_path) -> None:
    table = "[target]\ncenter = [1.6, 0.0]\nradius = 0.5\n"
    text = ONE.to_toml()
    assert table in text
    second = "[[target]]\ncenter = [0.0, 1.7]\nradius = 0.4\n"
    path = tmp_path / "two.toml"
    path.write_text(text.replace(table, table.replace("[target]", "[[target]]") + "\n" + second))
    two = csw.load_scenario(path)
    assert two == BOTH
    csw.save_scenario(two, path, comments=True)
    assert csw.load_scenario(path) == BOTH
    assert "[[target.other]]" in path.read_text()


def test_overlapping_zones_are_refused() -> None:
    with pytest.raises(ScenarioError, match=r"target\.other\[0\] overlaps target;"):
        ONE.replace(target={"other": [{"center": [1.9, 0.0], "radius": 0.3}]})
    with pytest.raises(ScenarioError, match=r"target\.other\[1\] overlaps target\.other\[0\];"):
        ONE.replace(target={"other": [NORTH, NORTH]})
    with pytest.raises(ScenarioError, match="inside the target zone"):
        ONE.replace(target={"other": [{"center": [-0.6, -0.4], "radius": 0.2}]})
