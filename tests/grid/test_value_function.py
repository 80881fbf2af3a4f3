"""The value function: its two bounds, the risk of following it, and unreachable states."""

from __future__ import annotations

import math
import tracemalloc
from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from small_scenarios import DT, V_MAX, image, patrolled, small

from casswarm import PlanningError, Scenario, load_scenario, plan
from casswarm.grid import CostToGoMap, StageCosts, ValueFunction, box_extremum, rounding
from casswarm.guide import plan_from

SCENARIO = small(
    [(0.0, 0.0)], (5.0, 3.0), [(2.0, 2.0), (3.5, 0.5)], 14, guide__acceleration_limited=False
)
VALUE = ValueFunction.from_scenario(SCENARIO, 1_500_000)


def followed(scenario: Scenario, value: ValueFunction, position: np.ndarray, step: int) -> float:
    """Risk of following the feedback guide from a state on; infinite without arrival."""
    risk = 0.0
    for t in range(step, scenario.n_steps):
        velocity = value.velocities(t, position)
        assert np.abs(velocity).max() <= V_MAX * (1 + 1e-12)
        position = position + DT * velocity
        risk += DT * float(scenario.hazard.single_agent_rates(position))
        if scenario.target.contains(position):
            return risk
    return math.inf


def test_bounds_at_start_enclose_guide() -> None:
    low, high = VALUE.bounds(0, [0.0, 0.0])
    guide = plan(SCENARIO, gap=1e-4)
    assert low <= guide.risk <= high * (1 + 1e-6)
    assert guide.risk_bound <= high
    assert high - low < 0.02 * high


@given(st.integers(0, 2**32 - 1))
@settings(max_examples=25, deadline=None)
def test_upper_bound_is_attained_by_feedback_guide(seed: int) -> None:
    rng = np.random.default_rng(seed)
    position, step = rng.uniform(-2, 7, 2), int(rng.integers(0, 9))
    low, high = VALUE.bounds(step, position)
    assert low <= high
    if np.isfinite(high) and high > 0:
        assert followed(SCENARIO, VALUE, position, step) <= high * (1 + 1e-6)


@pytest.mark.parametrize("v_max", [1.0, 2.0])
@pytest.mark.parametrize("target", [(3.0, 0.0), (3.0, 1.0), (5.0, 3.0)])
@pytest.mark.parametrize("dt", [0.1, 0.2, 0.3])
def test_feedback_guide_arrives_where_nodes_lie_on_the_rim(
    dt: float, target: tuple[float, float], v_max: float
) -> None:
    values = {"time.dt": dt, "time.t_f": 8.0, "swarm.v_max": v_max, "target.center": target}
    scenario = load_scenario("single-agent").with_values(values)
    value = ValueFunction.from_scenario(scenario, 100_000, certified=False)
    position = scenario.positions[0]
    for step in range(scenario.n_steps):
        position = position + dt * value.velocities(step, position)
        if scenario.target.contains(position):
            return
    pytest.fail(f"{scenario.target.distances(position) - scenario.target.radius} outside")


@pytest.mark.parametrize(("step", "position"), [(3, (1.0, -1.0)), (5, (1.0, 3.0)), (0, (3.0, 3.5))])
def test_bounds_enclose_guide_from_other_state(step: int, position: tuple[float, float]) -> None:
    remaining = SCENARIO.with_values({"time.t_f": (SCENARIO.n_steps - step) * DT * (1 + 1e-9)})
    guide = plan_from(remaining, position, search="global")
    low, high = VALUE.bounds(step, position)
    assert low <= guide.risk <= high * (1 + 1e-6)
    assert high - low < 0.05 * high


def test_bounds_in_target_are_zero_and_out_of_reach_infinite() -> None:
    inside, outside = (5.0, 3.2), (5.0, 8.0)
    for step in (0, 7, 14):
        assert [float(bound) for bound in VALUE.bounds(step, inside)] == [0.0, 0.0]
        assert VALUE.velocities(step, inside).tolist() == [0.0, 0.0]
    assert [float(bound) for bound in VALUE.bounds(9, outside)] == [math.inf, math.inf]
    assert [float(bound) for bound in VALUE.bounds(14, outside)] == [math.inf, math.inf]
    velocity = VALUE.velocities(9, outside)  # straight on, for want of better
    assert velocity[1] == pytest.approx(-V_MAX)


def test_upper_bound_is_nondecreasing_in_time() -> None:
    positions = np.random.default_rng(1).uniform(-2, 7, (200, 2))
    highs = np.array([VALUE.bounds(step, positions)[1] for step in range(0, 14, 3)])
    finite = np.isfinite(highs).all(axis=0)
    assert finite.sum() > 20
    assert (np.diff(highs[:, finite], axis=0) >= -1e-12).all()


def test_shapes_follow_positions() -> None:
    positions = np.random.default_rng(0).uniform(0, 4, (3, 5, 2))
    low, high = VALUE.bounds(2, positions)
    assert low.shape == high.shape == (3, 5)
    assert VALUE.velocities(2, positions).shape == (3, 5, 2)
    assert VALUE.to_go(2, positions).shape == VALUE.after(2, positions).shape == (3, 5)
    assert float(VALUE.bounds(2, positions[1, 2])[1]) == high[1, 2]


def test_to_go_is_close_to_bounds() -> None:
    positions = np.random.default_rng(3).uniform((0, 0), (4, 3), (200, 2))
    low, high = VALUE.bounds(1, positions)
    estimate = VALUE.to_go(1, positions)
    assert (estimate >= low).all()
    assert np.median(np.abs(estimate - high) / high) < 0.03


def test_bounds_custom_hazard_has_zero_lower_bound() -> None:
    scenario = SCENARIO.with_hazard(patrolled, radars=[(2.0, 2.0)])
    value = ValueFunction.from_scenario(scenario, 100_000)
    low, high = value.bounds(0, [0.0, 0.0])
    assert low == 0.0
    assert high == pytest.approx(plan(scenario).risk, rel=0.05)


def exact_interpolation(value: ValueFunction, step: int, position: np.ndarray) -> float:
    """Interpolated lower values of the next step, with the position in exact arithmetic."""
    grid = value.grid
    array, block = value.lower[step][0], grid.nodes[step][0]
    least = box_extremum(array, block, block.grown(grid.reach), grid.reach)
    nodes = [
        (Fraction(x) - Fraction(start)) / Fraction(grid.spacing) - first + grid.reach
        for x, start, first in zip(position, grid.task.start, block.first, strict=True)
    ]
    cell = [math.floor(node) for node in nodes]
    u, v = (node - corner for node, corner in zip(nodes, cell, strict=True))
    weights = [(1 - u) * (1 - v), (1 - u) * v, u * (1 - v), u * v]
    corners = least[cell[0] : cell[0] + 2, cell[1] : cell[1] + 2].ravel()
    return float(sum(w * Fraction(c) for w, c in zip(weights, corners, strict=True) if w))


def test_lower_bound_far_from_the_origin_covers_rounding_of_positions() -> None:
    value = ValueFunction.from_scenario(image(SCENARIO, np.eye(2), shift=(1e8, 1e8)), 100_000)
    positions = 1e8 + np.random.default_rng(4).uniform((0, 0), (3, 2), (60, 2))
    low, _ = value.bounds(0, positions)
    assert np.isfinite(low).all()
    for bound, position in zip(low, positions, strict=True):
        assert bound <= exact_interpolation(value, 0, position)
    near, _ = ValueFunction.from_scenario(SCENARIO, 100_000).bounds(0, positions - 1e8)
    np.testing.assert_allclose(low, near, rtol=1e-4)


HUGE = {"target.center": (1e18, 0.0), "target.radius": 1e18 - 1e3, "hazard.core_radius": 0.01}
HUGE |= {"swarm.v_max": 1e3, "guide.margin": 0.0}


@pytest.mark.parametrize(
    ("make", "values", "options", "words"),
    [
        (ValueFunction, {"time.t_f": 2000.0}, {}, r"6060 steps needs [\d,]+ nodes"),
        (ValueFunction, HUGE, {}, r"nodes, more than .*smaller target\.radius"),
        (CostToGoMap, {}, {"time_limit": 1e-9}, "raise the time limit"),
    ],
)
def test_too_many_nodes_or_too_little_time_raise(make, values, options, words) -> None:
    with pytest.raises(PlanningError, match=words):
        make.from_scenario(SCENARIO.with_values(values), **options)


def test_rounding_grows_with_resolution() -> None:
    allowances = [
        rounding(StageCosts(ValueFunction.from_scenario(SCENARIO, nodes).grid), 1.0, interpolated)
        for nodes, interpolated in ((100_000, False), (100_000, True), (1_500_000, True))
    ]
    assert 0 < allowances[0] < allowances[1] < allowances[2] < 1e-11


@pytest.mark.slow
@pytest.mark.parametrize("radius", [0.3, 1e-6])
def test_memory_is_bounded_where_many_nodes_are_within_reach(radius: float) -> None:
    """With one step left, all nodes of the finest grid are; it is fine if the target is small."""
    values: dict[str, object] = {
        "guide__acceleration_limited": False,
        "target__radius": radius,
        "target__center": (0.4 + radius, 0.2),
    }
    scenario = small([(0.0, 0.0)], (0.9, 0.2), [(0.6, 0.1)], 1, **values)
    value = ValueFunction.from_scenario(scenario, 1_000_000)
    assert value.grid.reach >= 256
    positions = np.random.default_rng(0).normal(scale=0.1, size=(128, 2))
    value.velocities(0, positions[:1])
    tracemalloc.start()
    velocities, (low, high) = value.velocities(0, positions), value.bounds(0, positions)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 400e6  # indices and costs of all nodes at once need 128 * 513**2 * 40
    assert (low <= high).all()
    for position, velocity in zip(positions[:4], velocities, strict=False):
        assert np.array_equal(value.velocities(0, position), velocity)


def test_map_of_scenario_covers_its_contents_and_matches_value_function() -> None:
    far = np.array([[9.0, -3.0]])
    costs = CostToGoMap.from_scenario(SCENARIO, [far])
    points = np.vstack([far, SCENARIO.positions, SCENARIO.hazard.radar_positions])
    assert (costs.low < points.min(axis=0)).all()
    assert (points.max(axis=0) < costs.high).all()
    same = CostToGoMap.from_value_function(
        ValueFunction.from_scenario(SCENARIO, certified=False), costs.low, costs.high
    )
    np.testing.assert_array_equal(costs.survival, same.survival)
    np.testing.assert_array_equal(costs.velocities, same.velocities)
