"""The value function: its two bounds, what following it costs, and where there is no way."""

from __future__ import annotations

import math
import pickle

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from small_scenarios import DT, V_MAX, patrolled, small

from casswarm import PlanningError, Scenario, plan
from casswarm.planning.bounds.value_function import ValueFunction
from casswarm.planning.plan import plan_from

SCENARIO = small(
    [(0.0, 0.0)], (5.0, 3.0), [(2.0, 2.0), (3.5, 0.5)], 14, guide__acceleration_limited=False
)
VALUE = ValueFunction.from_scenario(SCENARIO, 1_500_000)


def followed(scenario: Scenario, value: ValueFunction, place: np.ndarray, step: int) -> float:
    """Risk of following the feedback guide from a place at a step on; infinite without arrival."""
    risk = 0.0
    for t in range(step, scenario.n_steps):
        velocity = value.velocities(t, place)
        assert np.abs(velocity).max() <= V_MAX * (1 + 1e-12)
        place = place + DT * velocity
        risk += DT * float(scenario.hazard.single_agent_rates(place))
        if scenario.target.contains(place):
            return risk
    return math.inf


def test_bounds_at_the_start_hold_the_best_guide_between_them() -> None:
    low, high = VALUE.bounds(0, [0.0, 0.0])
    guide = plan(SCENARIO, gap=1e-4)
    assert low <= guide.risk <= high * (1 + 1e-6)
    assert guide.risk_bound <= high
    assert high - low < 0.02 * high


@given(st.integers(0, 2**32 - 1))
@settings(max_examples=25, deadline=None)
def test_following_the_feedback_guide_costs_no_more_than_the_upper_bound(seed: int) -> None:
    rng = np.random.default_rng(seed)
    place, step = rng.uniform(-2, 7, 2), int(rng.integers(0, 9))
    low, high = VALUE.bounds(step, place)
    assert low <= high
    if np.isfinite(high) and high > 0:
        assert followed(SCENARIO, VALUE, place, step) <= high * (1 + 1e-6)


@pytest.mark.parametrize(("step", "place"), [(3, (1.0, -1.0)), (5, (1.0, 3.0)), (0, (3.0, 3.5))])
def test_bounds_hold_a_guide_that_starts_elsewhere_and_later(
    step: int, place: tuple[float, float]
) -> None:
    rest = SCENARIO.with_values({"time.t_f": (SCENARIO.n_steps - step) * DT * (1 + 1e-9)})
    guide = plan_from(rest, place, search="global")
    low, high = VALUE.bounds(step, place)
    assert low <= guide.risk <= high * (1 + 1e-6)
    assert high - low < 0.05 * high


def test_risk_to_go_is_zero_in_the_target_and_infinite_out_of_reach() -> None:
    inside, outside = (5.0, 3.2), (5.0, 8.0)
    for step in (0, 7, 14):
        assert [float(bound) for bound in VALUE.bounds(step, inside)] == [0.0, 0.0]
        assert VALUE.velocities(step, inside).tolist() == [0.0, 0.0]
    assert [float(bound) for bound in VALUE.bounds(9, outside)] == [math.inf, math.inf]
    assert [float(bound) for bound in VALUE.bounds(14, outside)] == [math.inf, math.inf]
    velocity = VALUE.velocities(9, outside)  # straight on, for want of better
    assert velocity[1] == pytest.approx(-V_MAX)


def test_risk_to_go_never_falls_as_time_passes() -> None:
    places = np.random.default_rng(1).uniform(-2, 7, (200, 2))
    highs = np.array([VALUE.bounds(step, places)[1] for step in range(0, 14, 3)])
    finite = np.isfinite(highs).all(axis=0)
    assert finite.sum() > 20
    assert (np.diff(highs[:, finite], axis=0) >= -1e-12).all()


def test_shape_of_positions_is_that_of_the_answers() -> None:
    places = np.random.default_rng(0).uniform(0, 4, (3, 5, 2))
    low, high = VALUE.bounds(2, places)
    assert low.shape == high.shape == (3, 5)
    assert VALUE.velocities(2, places).shape == (3, 5, 2)
    assert VALUE.to_go(2, places).shape == VALUE.after(2, places).shape == (3, 5)
    assert float(VALUE.bounds(2, places[1, 2])[1]) == high[1, 2]


def test_interpolated_risks_are_near_the_bounds() -> None:
    places = np.random.default_rng(3).uniform((0, 0), (4, 3), (200, 2))
    low, high = VALUE.bounds(1, places)
    estimate = VALUE.to_go(1, places)
    assert (estimate >= low).all()
    assert np.median(np.abs(estimate - high) / high) < 0.03


def test_users_rates_have_an_upper_bound_alone() -> None:
    scenario = SCENARIO.with_hazard(patrolled, radars=[(2.0, 2.0)])
    value = ValueFunction.from_scenario(scenario, 100_000)
    low, high = value.bounds(0, [0.0, 0.0])
    assert low == 0.0
    assert high == pytest.approx(plan(scenario).risk, rel=0.05)


def test_value_functions_pickle() -> None:
    again = pickle.loads(pickle.dumps(VALUE))
    assert again.bounds(0, [0.0, 0.0])[1] == VALUE.bounds(0, [0.0, 0.0])[1]


def test_too_many_steps_are_an_error_that_says_how_many_nodes() -> None:
    scenario = SCENARIO.with_values({"time.t_f": 2000.0})
    with pytest.raises(PlanningError, match=r"6060 steps needs [\d,]+ nodes"):
        ValueFunction.from_scenario(scenario)
