"""The gradient of the success is that of differences, and the success that of `evaluate`."""

from __future__ import annotations

import math

import casadi as ca
import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from parametric_cases import (
    START,
    STARTS,
    STEPS,
    assert_equals_differences,
    gradient,
    guide,
    scene,
    scene_with_collisions,
    steered,
)
from small_scenarios import DT, patrolled, single_agent_rate_by_hand, small

import casswarm as csw


@pytest.mark.parametrize("n", [1, 2, 3, 4])
@pytest.mark.parametrize("smoothing", [0.0, 0.3])
def test_gradient_equals_central_differences(n, smoothing):
    scenario = scene(n)
    found = gradient(scenario, steered(scenario), arrival_smoothing=smoothing)
    assert np.abs(found.gradient).max() > 1e-3
    assert_equals_differences(scenario, steered(scenario), START, arrival_smoothing=smoothing)


parameters = st.lists(st.floats(-0.25, 0.25, width=32), min_size=len(START), max_size=len(START))


@pytest.mark.slow
@settings(max_examples=15, deadline=None)
@given(parameters, st.sampled_from([1, 2, 3]), st.booleans(), st.booleans())
def test_gradient_equals_central_differences_anywhere(offsets, n, collisions, smooth):
    scenario = scene_with_collisions(n) if collisions else scene(n)
    options = {"arrival_smoothing": 0.5 if smooth else 0.0}
    assert_equals_differences(scenario, steered(scenario), START + offsets, assume, **options)


def test_gradient_with_custom_rates_equals_central_differences():
    scenario = scene(2).with_hazard(patrolled, radars=[(1.0, 0.8)])
    assert_equals_differences(scenario, steered(scenario), START)


def test_gradient_of_external_function_equals_that_of_expression():
    """A function that cannot be expanded to scalar operations is mapped instead."""
    grid = np.linspace(-4.0, 4.0, 41)
    table = ca.interpolant("table", "bspline", [grid.tolist()], np.sin(2 * grid).tolist())

    def tabulated(_step, positions, *others):
        p = others[-1]
        column = table(ca.vec(positions).T)
        return p[0] * ca.reshape(column, positions.shape) + p[1]

    scenario = scene(2)
    policy = csw.ParametricPolicy(tabulated, [0.3, 0.9], scenario)
    assert_equals_differences(scenario, policy, np.array([0.3, 0.9]))


def test_gradient_of_single_agent_is_that_of_its_risk():
    """One member on a straight line: success is exp(-risk), known by hand."""
    radar = (1.0, 0.8)
    scenario = small([(0.0, 0.0)], (2.0, 0.0), [radar], 5, swarm__velocity=[1.2, 0.0])

    def straight(*state):
        return ca.horzcat(state[-1][0], 0)

    def success(speed):
        points = [speed * DT * k for k in range(1, 6)]
        arrival = next(k for k, x in enumerate(points) if abs(x - 2.0) <= 0.5)
        rates = [single_agent_rate_by_hand(x, 0.0, [radar]) for x in points[: arrival + 1]]
        return math.exp(-DT * sum(rates))

    policy = csw.ParametricPolicy(straight, [1.2], scenario)
    found = gradient(scenario, policy)
    assert found.objective == pytest.approx(success(1.2), rel=1e-12)
    difference = (success(1.2 + 1e-5) - success(1.2 - 1e-5)) / 2e-5
    assert found.gradient == pytest.approx([difference], rel=1e-7)


@pytest.mark.parametrize("n", [1, 3, 4])
def test_success_equals_that_of_evaluate(n):
    scenario = scene_with_collisions(n)
    found = gradient(scenario, steered(scenario), arrival_smoothing=0.2)
    exact = csw.evaluate(
        scenario, steered(scenario), 0.0, guide=guide(scenario), aggregation_tol=0.0
    )
    assert found.success.low == pytest.approx(exact.success.low, abs=1e-13)
    assert found.success.width == found.residual_mass == exact.residual_mass == 0.0
    assert found.objective < found.success.low


@pytest.mark.slow
def test_bounds_with_tolerance_hold_success():
    scenario = scene(4)
    exact = gradient(scenario, steered(scenario)).success.low
    for tolerance in (1e-3, 1e-2, 0.1):
        found = gradient(scenario, steered(scenario), tolerance=tolerance)
        assert found.residual_mass <= tolerance
        assert found.complete
        assert found.success.low <= exact <= found.success.high


def test_bounds_and_gradient_of_exhausted_budget_are_those_of_probable_histories():
    scenario = scene(4)
    exact = gradient(scenario, steered(scenario))
    assert exact.advice == ""
    lows = []
    for max_states in (5, 20, 60, 120):
        with pytest.warns(csw.CasswarmWarning, match=r"did not suffice for tolerance = 0.0001: .*"):
            few = gradient(scenario, steered(scenario), tolerance=1e-4, max_states=max_states)
        assert few.states <= max_states
        assert not few.complete
        assert few.advice in str(few)
        assert 0.0 < few.objective == few.success.low <= exact.success.low <= few.success.high
        assert (few.gradient != 0.0).any()
        lows.append(few.success.low)
    assert lows == sorted(lows)


def test_gradient_with_tolerance_is_that_of_what_is_followed():
    """At slightly other parameters the same states are followed, so differences agree, too."""
    scenario = scene(4)
    found = gradient(scenario, steered(scenario), tolerance=1e-2)
    assert found.residual_mass > 1e-3
    assert_equals_differences(scenario, steered(scenario), START, tolerance=1e-2)


def test_gradient_on_lattice_equals_that_without():
    scenario = scene(3)
    exact = gradient(scenario, steered(scenario))
    rounded = gradient(scenario, steered(scenario), aggregation_tol=None)
    assert rounded.objective == pytest.approx(exact.objective, abs=1e-9)
    np.testing.assert_allclose(rounded.gradient, exact.gradient, atol=1e-8)


def waypoints(targets):
    """Every member to its own next waypoint, which parameters shift by the number of the living."""

    def to_waypoint(step, positions, _previous_velocities, alive, p):
        n = positions.shape[0]
        shift = ca.horzcat(0, p[step] * ca.sum1(alive) + p[-1])
        return (ca.DM(targets[step]) + ca.repmat(shift, n, 1) - positions) / DT

    return to_waypoint


def test_states_that_meet_are_one_state_and_share_their_gradient():
    """Members that are lost at different steps meet at waypoints: fewer states, equal gradients."""
    steps, quick = 7, {"swarm__a_max": 100.0, "swarm__velocity": [0.8, 0.0]}
    scenario = small(STARTS, (2.0, 0.0), [(1.0, 0.8)], steps, **quick)
    targets = [np.add(STARTS, [[0.25 * (step + 1), 0.0]]) for step in range(steps)]
    values = np.linspace(-0.02, 0.03, steps + 1)
    policy = csw.ParametricPolicy(waypoints(targets), values, scenario)
    met = gradient(scenario, policy, values, aggregation_tol=None)
    apart = gradient(scenario, policy, values)
    assert met.states < apart.states
    assert met.objective == pytest.approx(apart.objective, abs=1e-9)
    np.testing.assert_allclose(met.gradient, apart.gradient, atol=1e-7)


def test_gradient_does_not_depend_on_order_of_members():
    """Where members are not told apart by the policy, their numbers do not matter."""
    scenario, order = scene(4), [2, 0, 3, 1]
    permuted = scenario.with_values({"swarm.positions": [STARTS[k] for k in order]})
    for tolerance in (0.0, 1e-2):
        one, other = (
            gradient(s, steered(s), tolerance=tolerance, guide=guide(scenario))
            for s in (scenario, permuted)
        )
        assert one.states == other.states
        assert other.objective == pytest.approx(one.objective, rel=1e-12)
        np.testing.assert_allclose(other.gradient, one.gradient, atol=1e-11)


def test_symmetric_states_are_left_out_together():
    """A swarm that is its own mirror image has a gradient without a part that breaks symmetry."""
    starts = [(0.0, 0.3), (0.0, -0.3), (-0.2, 0.3), (-0.2, -0.3)]
    scenario = small(starts, (2.0, 0.0), [(1.0, 0.0)], STEPS, swarm__velocity=[1.2, 0.0])
    values = np.append(START[:5], [0.3, 0.0] * STEPS)
    for tolerance in (0.0, 1e-2, 0.1):
        found = gradient(scenario, steered(scenario), values, tolerance)
        assert np.abs(found.gradient[6::2]).max() < 1e-12 < np.abs(found.gradient[5::2]).max()


def test_smoothing_increases_to_success():
    scenario = scene(3)
    policy = steered(scenario)
    values = [gradient(scenario, policy, arrival_smoothing=w).objective for w in (0.4, 0.1, 0.01)]
    assert values == sorted(values)
    assert values[-1] <= gradient(scenario, policy).success.low


def test_ascent_increases_exact_success():
    scenario = scene(3)
    policy = steered(scenario)
    found = gradient(scenario, policy, arrival_smoothing=0.1)
    better = policy.with_parameters(START + 0.05 * found.gradient)
    options = {"guide": guide(scenario), "tolerance": 0.0}
    before, after = (csw.evaluate(scenario, p, **options).success for p in (policy, better))
    assert after.low > before.high + 1e-4


def test_nobody_arrives_and_gradient_is_zero():
    found = gradient(scene(2), steered(scene(2)), 0.0 * START)
    assert found.success.high == found.objective == 0.0
    assert (found.gradient == 0).all()
