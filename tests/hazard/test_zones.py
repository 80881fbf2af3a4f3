"""Zones: rates by geometry in every evaluator, bounds, known answers, and all parts with them."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest
from hazard_cases import symbolic
from hypothesis import given, settings
from hypothesis import strategies as st
from scaled_scenarios import scaled
from small_scenarios import Array, image, small

import casswarm as csw
from casswarm.envs import SwarmVectorEnv
from casswarm.errors import ScenarioError
from casswarm.hazard import LocalRates, Saturation, Zone, blocked, compiled_rates, set_rates
from casswarm.hazard.zones import zone_rates_below

DISC = {"center": [1.2, 0.1], "radius": 0.25, "rate": 6.0, "edge": 0.2}
TRIANGLE = {"vertices": [[1.8, 0.4], [2.4, 0.5], [2.0, 1.1]], "rate": 9.0, "edge": 0.3}
STARTS = [(0.0, 0.0), (0.2, 0.3), (-0.3, -0.2)]
ONE = small(STARTS, (3.0, 0.0), [(1.5, 0.9)], 7, hazard__zone=[DISC, TRIANGLE])
OPEN = ONE.replace(hazard={"zone": []})


def profile(distance: Array, zone: dict) -> Array:
    """Rate at a distance, as the integral of a density: 30 u^2 (1 - u)^2."""
    u = np.clip(distance / zone["edge"], 0.0, 1.0)
    return zone["rate"] * (1 - (10 * u**3 - 15 * u**4 + 6 * u**5))


def by_geometry(points: Array) -> Array:
    """Rates of both zones at points (m, 2), with the triangle's distance by fine sampling."""
    to_disc = np.maximum(np.hypot(*(points - DISC["center"]).T) - DISC["radius"], 0.0)
    a, b, c = np.array(TRIANGLE["vertices"])
    weights = np.linalg.solve(
        np.array([[*v, 1.0] for v in (a, b, c)]).T, np.c_[points, np.ones(len(points))].T
    )
    part = np.linspace(0, 1, 4001)[:, None]
    rim = np.vstack([p + part * (q - p) for p, q in ((a, b), (b, c), (c, a))])
    near = np.array([np.hypot(*(rim - x).T).min() for x in points])
    inside = (weights >= 0).all(axis=0)
    return profile(to_disc, DISC) + profile(np.where(inside, 0.0, near), TRIANGLE)


def states(seed: int, count: int) -> tuple[Array, np.ndarray]:
    rng = np.random.default_rng(seed)
    return rng.uniform([0.5, -0.5], [2.8, 1.4], (count, 3, 2)), rng.random((count, 3)) < 0.8


def test_rates_are_those_of_radars_and_of_geometry() -> None:
    x, alive = states(1, 200)
    points = x.reshape(-1, 2)
    zones = by_geometry(points)
    assert zones.max() > 8
    single = ONE.hazard.single_agent_rates(points) - OPEN.hazard.single_agent_rates(points)
    np.testing.assert_allclose(single, zones, atol=1e-5)
    pairs = ((x[:, :, None] - x[:, None]) ** 2).sum(-1)
    density = (alive[:, None] / (1 + 4.0 * pairs)).sum(-1)
    expected = OPEN.hazard.rates(x, alive) + alive * 4.0 * zones.reshape(-1, 3) / (
        1 + 3.0 * density
    )
    np.testing.assert_allclose(ONE.hazard.rates(x, alive), expected, atol=1e-5)


def test_all_evaluators_agree() -> None:
    hazard = ONE.hazard
    assert isinstance(hazard, Saturation)
    x, alive = states(2, 64)
    rates, by_code = hazard.rates(x, alive), np.empty((64, 3))
    compiled = compiled_rates(hazard, 3)
    assert compiled is not None
    assert compiled(x, alive, by_code)
    np.testing.assert_allclose(by_code, rates, atol=1e-12)
    function = symbolic(hazard, 3)
    local = LocalRates.of(hazard, blocked(x))
    everyone = np.ones((1, 3), bool)
    sets = set_rates(hazard, blocked(x), everyone)
    for k in range(64):
        value, jacobian, _ = (np.array(part) for part in function(x[k].T, alive[k].astype(float)))
        np.testing.assert_allclose(value.ravel() * alive[k], rates[k], atol=1e-12)
        assert np.isfinite(jacobian).all()
        block, lane = divmod(k, sets.shape[-1])
        whole = hazard.rates(x[k])
        np.testing.assert_allclose(sets[block, 0, :, lane], whole, atol=1e-12)
        np.testing.assert_allclose(local.rates[block, -1, 0, :, lane], whole, atol=1e-12)
        step = 1e-6
        for axis in (0, 1):
            shift = step * np.eye(2)[axis]
            there, back = (hazard.single_agent_rates(x[k] + s * shift) * 4.0 for s in (1, -1))
            slope = (there - back) / (2 * step)  # in units of the sum over radars
            np.testing.assert_allclose(
                local.radars[block, :, axis, lane], slope, rtol=1e-4, atol=1e-4
            )


@pytest.mark.parametrize("table", [DISC, TRIANGLE], ids=["disc", "polygon"])
@pytest.mark.parametrize("spacing", [0.02, 0.09, 0.4])
def test_bounds_are_below_rates(table: dict, spacing: float) -> None:
    zone = ONE.replace(hazard={"zone": [table]}).hazard_table.zone[0].zone
    rate = ca.Function("r", [e := ca.SX.sym("e"), n := ca.SX.sym("n")], [zone.rates(e, n)])
    rng = np.random.default_rng(3)
    axes = [first + spacing * np.arange(int(2.5 / spacing)) for first in (0.4, -0.7)]
    sharp = zone.rates_below(*axes, spacing)
    safe = zone_rates_below([zone], (*axes, spacing), np.zeros((len(axes[0]), len(axes[1]))))
    assert safe.min() >= 0 or spacing < 0.1
    for _ in range(3000):
        at = rng.integers(0, [len(axes[0]) - 1, len(axes[1]) - 1])
        s, t = rng.random(2) if rng.random() < 0.8 else rng.integers(0, 2, 2)
        weights = np.outer([1 - s, s], [1 - t, t])
        point = [axis[k] + part * spacing for axis, k, part in zip(axes, at, (s, t), strict=True)]
        true = float(rate(*point))
        for nodes in (sharp, safe):
            cell = nodes[at[0] : at[0] + 2, at[1] : at[1] + 2]
            assert (weights * cell).sum() <= true + 1e-12
    error = 10 / 3**0.5 / 8 * table["rate"] * (spacing / table["edge"]) ** 2
    exact = np.array([[float(rate(e, n)) for n in axes[1]] for e in axes[0]])
    assert (exact - sharp).max() <= error + 1e-9


@given(st.integers(0, 2**32 - 1))
@settings(max_examples=40, deadline=None)
def test_least_rate_of_a_box_is_not_above_any_rate_in_it(seed: int) -> None:
    rng = np.random.default_rng(seed)
    low = rng.uniform(-0.5, 2.5, 2)
    high = low + rng.exponential(0.3, 2)
    points = rng.uniform(low, high, (300, 2))
    least = ONE.hazard.single_agent_lower_bound(low, high)
    assert least is not None
    assert least <= ONE.hazard.single_agent_rates(points).min() + 1e-12


def test_zones_that_are_far_or_double_are_as_none_or_one() -> None:
    far = ONE.replace(hazard={"zone": [{**DISC, "center": [50.0, 50.0]}]})
    guide, plain = csw.plan(far), csw.plan(OPEN)
    assert guide.survival == pytest.approx(plain.survival, abs=1e-9)
    assert guide.survival_bound == pytest.approx(plain.survival_bound, rel=2e-3)
    half = {**DISC, "rate": 3.0}
    once, twice = (OPEN.replace(hazard={"zone": z}) for z in ([DISC], [half, half]))
    x, alive = states(4, 50)
    np.testing.assert_allclose(
        once.hazard.rates(x, alive), twice.hazard.rates(x, alive), rtol=1e-12
    )


def test_a_zone_is_flown_around_and_alone_is_a_hazard() -> None:
    wall = {"center": [1.5, 0.1], "radius": 0.4, "rate": 40.0, "edge": 0.1}
    single = small([(0.0, 0.0)], (3.0, 0.0), [(1.5, 0.9)], 9, swarm__a_max=4.0)
    only = single.replace(hazard={"radars": [], "zone": [wall]})
    guide = csw.plan(only)
    assert guide.survival > 1 - 1e-6
    assert np.hypot(*(guide.positions - wall["center"]).T).min() > 0.49
    assert csw.simulate(only, ["leader"], 20, seed=1, guide=guide).summary.success[0] == 1.0
    assert csw.evaluate(only, "leader", guide=guide).success.low > 1 - 1e-6


@pytest.mark.slow
def test_numbers_of_all_parts_fit_together() -> None:
    guide = csw.plan(ONE)
    assert guide.gap is not None
    assert guide.gap < 0.03
    bound = csw.success_bound(ONE, max_work=1e6).value
    barrier = {"vertices": [[1, -9], [2, -9], [2, 9], [1, 9]], "rate": 2.0, "edge": 0.2}
    closed = OPEN.replace(hazard={"zone": [barrier]})
    assert csw.success_bound(closed, max_work=1e6).value < bound - 0.01
    for name in ("naive", "leader", "constrained", "leader-feedback", "leader-mpc-2"):
        law = csw.evaluate(ONE, name, 1e-9, guide=guide).success
        assert law.high <= bound
        runs = csw.simulate(ONE, [name], 2000, seed=2, guide=guide).summary
        error = np.sqrt(law.low * (1 - law.low) / 2000)
        assert abs(runs.success[0] - law.low) < 4.5 * error + 1e-9
    plan = csw.plan_swarm(ONE)
    assert plan.success.low > csw.evaluate(ONE, "leader", 1e-9, guide=guide).success.low
    assert csw.evaluate(ONE, "joint", 1e-9).success.low == pytest.approx(plan.success.low, abs=1e-8)
    runs = csw.simulate(ONE, ["leader"], 60, seed=7, guide=guide).runs
    env = SwarmVectorEnv(ONE, 60, guide=guide)
    assert env.reset(seed=7)[0].shape[0] == 60
    assert runs["success"].sum() > 0


@pytest.mark.slow
def test_plan_does_not_depend_on_axes_or_units() -> None:
    guide = csw.plan(ONE)
    mirrored = csw.plan(image(ONE, np.diag([1.0, -1.0])))
    np.testing.assert_array_equal(mirrored.positions, guide.positions * [1.0, -1.0])
    assert mirrored.survival_bound == guide.survival_bound
    other = csw.plan(scaled(ONE, 100.0, 0.1))
    assert other.survival == pytest.approx(guide.survival, abs=1e-8)
    assert other.survival_bound == pytest.approx(guide.survival_bound, abs=1e-8)


MISTAKES = {
    "zone[0] contains swarm.positions[1]": {**DISC, "center": [0.2, 0.4]},
    "zone[0].radius is missing": {"center": [1.0, 0.0], "rate": 1.0, "edge": 0.1},
    "zone[0].center and hazard.zone[0].vertices are both given": {**TRIANGLE, "center": [1.0, 0.0]},
    "not those of a convex polygon": {
        **TRIANGLE,
        "vertices": [[1, 1], [2, 1], [1.2, 1.2], [1, 2]],
    },
    "without three on a line": {**TRIANGLE, "vertices": [[1, 1], [2, 1], [3, 1]]},
    "zone[0].edge is 0": {**DISC, "edge": 0},
    "zone[0].vertices is": {**TRIANGLE, "vertices": [[1, 1], [2, 1]]},
}


@pytest.mark.parametrize("message", MISTAKES)
def test_wrong_zones_are_refused_by_their_keys(message: str) -> None:
    with pytest.raises(ScenarioError) as caught:
        ONE.replace(hazard={"zone": [MISTAKES[message]]})
    assert message in str(caught.value)
    assert "hazard.zone" in str(caught.value)


def test_star_is_no_convex_polygon() -> None:
    angles = 2 * np.pi * np.array([0, 2, 4, 1, 3]) / 5
    star = {**TRIANGLE, "vertices": np.c_[np.cos(angles) + 2, np.sin(angles) + 2]}
    with pytest.raises(ScenarioError, match="not those of a convex polygon"):
        ONE.replace(hazard={"zone": [star]})


def test_custom_rates_have_no_zones() -> None:
    with pytest.raises(ScenarioError, match=r"hazard\.zone is not a key of a 'module:function'"):
        ONE.replace(hazard={"kind": len, "zone": [DISC]})


def test_orientation_of_a_polygon_does_not_matter() -> None:
    turned = {**TRIANGLE, "vertices": TRIANGLE["vertices"][::-1]}
    zones = [OPEN.replace(hazard={"zone": [z]}).hazard_table.regions[0] for z in (TRIANGLE, turned)]
    assert all(isinstance(zone, Zone) for zone in zones)
    assert set(zones[0].vertices) == set(zones[1].vertices)
    points = states(5, 40)[0].reshape(-1, 2)
    for one, other in zip(*(z.least_rates(points, points) for z in zones), strict=True):
        assert one == pytest.approx(other, abs=1e-12)
