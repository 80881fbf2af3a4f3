"""Bounds with limits of acceleration: lemmas, known answers, and paths that are never below."""

from __future__ import annotations

import itertools
import math
import time
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from random_paths import geometry, random_paths, risks
from scipy.ndimage import minimum_filter
from small_scenarios import TWO, Array, Point, bounded_patrol, small

from casswarm import Scenario, load_scenario, plan
from casswarm.bounds import (
    AccelerationBound,
    AccelerationLimits,
    acceleration_limits,
    bound_with_acceleration,
)
from casswarm.bounds.acceleration_bound import DualFunction, Region, _Search
from casswarm.bounds.acceleration_kernels import (
    best_path,
    least_step,
    tilted_costs_to_come,
    tilted_costs_to_go,
)
from casswarm.grid import CellBlock, Relaxation


def agent(target: Point, radars: list[Point], steps: int, **values: object) -> Scenario:
    """One agent from the origin with a limit of acceleration, and no margin."""
    return small([(0.0, 0.0)], target, radars, steps, **{"guide__margin": 0.0} | values)


def bounded(scenario: Scenario, best: float, **options: float) -> AccelerationBound:
    options = {"gap": 0.01, "deadline": time.monotonic() + 20} | options
    task, limits = Relaxation.from_scenario(scenario), acceleration_limits(scenario)
    return bound_with_acceleration(task, limits, best, **options)  # type: ignore[arg-type]


def dual_of(scenario: Scenario, reach: int = 2, steps: int | None = None) -> DualFunction:
    task = Relaxation.from_scenario(scenario)
    region = Region.full(task if steps is None else replace(task, steps=steps), reach)
    assert region is not None
    return DualFunction(region, acceleration_limits(scenario), 1.0)


def random_multipliers(dual: DualFunction, seed: int) -> Array:
    rng = np.random.default_rng(seed)
    multipliers = rng.normal(0, 10 ** rng.uniform(-2, 0.5), dual.count)
    multipliers[rng.random(dual.count) < 0.2] = 0.0
    multipliers[-1] = abs(multipliers[-1])
    return multipliers


# --- compiled steps


@given(st.integers(0, 2**32 - 1))
@settings(max_examples=40, deadline=None)
def test_tilted_costs_match_filters(seed: int) -> None:
    rng = np.random.default_rng(seed)
    steps, reach = int(rng.integers(1, 5)), int(rng.integers(1, 4))
    windows = np.column_stack([rng.integers(-4, 3, (steps, 2)), rng.integers(2, 9, (steps, 2))])
    offsets = np.concatenate([[0], np.cumsum(windows[:, 2] * windows[:, 3])])
    costs = rng.uniform(size=offsets[-1])
    costs[rng.random(offsets[-1]) < 0.2] = np.inf
    tilts, size = rng.normal(size=(steps, 2)), 40
    terminal = rng.normal(size=windows[-1, 2] * windows[-1, 3])
    index = np.arange(-size, size + 1)

    def embedded(values: Array, window: Array) -> Array:
        full = np.full((2 * size + 1, 2 * size + 1), np.inf)
        rows, columns = window[0] + size, window[1] + size
        full[rows : rows + window[2], columns : columns + window[3]] = values.reshape(window[2:])
        return full

    def visit(t: int) -> Array:
        tilt = tilts[t, 0] * index[:, None] + tilts[t, 1] * index[None]
        return embedded(costs[offsets[t] : offsets[t + 1]], windows[t]) + tilt

    def within(values: Array) -> Array:
        return minimum_filter(values, 2 * reach + 1, mode="constant", cval=np.inf)

    to_go, to_come = np.empty((2, offsets[-1]))
    tilted_costs_to_go(costs, windows, offsets, tilts, terminal, reach, to_go)
    tilted_costs_to_come(costs, windows, offsets, tilts, reach, to_come)
    expected = visit(steps - 1) + embedded(terminal, windows[-1])
    for t in reversed(range(steps)):
        if t < steps - 1:
            expected = visit(t) + within(expected)
        found = embedded(to_go[offsets[t] : offsets[t + 1]], windows[t])
        np.testing.assert_allclose(found, expected, rtol=1e-12, atol=1e-12)
    least = within(expected)[size, size]
    path = np.zeros((steps, 2), np.int64)
    assert best_path(to_go, windows, offsets, reach, path) == pytest.approx(least, rel=1e-12)
    if np.isfinite(least):
        assert np.abs(np.diff(np.vstack([[0, 0], path]), axis=0)).max() <= reach
        for t in range(steps):
            part = slice(offsets[t], offsets[t + 1])
            assert (to_go[part] + to_come[part]).min() == pytest.approx(least, rel=1e-9, abs=1e-9)


@given(st.integers(0, 2**32 - 1))
@settings(max_examples=40, deadline=None)
def test_least_step_satisfies_conditions_of_optimality(seed: int) -> None:
    rng = np.random.default_rng(seed)
    slopes, needed = rng.normal(size=(3, 12)), rng.normal(size=3)
    found, weights = least_step(slopes @ slopes.T, needed, 1e-6, 1e9)
    assert found
    step = slopes.T @ weights
    assert (weights >= 0).all()
    assert (slopes @ step >= needed - 1e-5).all()
    violation = weights * (slopes @ step - needed)
    np.testing.assert_allclose(violation, 0, atol=1e-4 * (1 + weights.max()))
    opposite = np.array([[1.0, 0.0], [-1.0, 0.0]])
    assert not least_step(opposite @ opposite.T, np.ones(2), 1e-9, 100.0)[0]


# --- regions


def test_region_parts_halves_and_gaps() -> None:
    task = Relaxation.from_scenario(agent((3.0, 1.0), [(1.5, 0.2)], 8))
    region = Region.full(task, 2)
    assert Region.full(replace(task, steps=3), 2) is None  # too far for three steps
    assert region.size == sum(block.cells.size for block in region.blocks)
    assert region.widest_gap() is None
    first, second = region.parts(3, 1, 4)
    assert first.size + second.size - region.size == sum(
        block.cells.size for t, block in enumerate(region.blocks) if t != 3
    )
    assert region.halved().size == 4 * region.size
    assert region.halved().grid.spacing == region.grid.spacing / 2
    cells = np.ones((6, 9), bool)
    cells[:, 3:7] = False
    apart = replace(region, blocks=(CellBlock((0, 0), cells), *region.blocks[1:]))
    assert apart.widest_gap() == (0, 1, 3)
    assert [part.blocks[0].cells.shape for part in apart.parts(0, 1, 3)] == [(6, 3), (6, 2)]


# --- the dual function


@given(st.integers(0, 2**32 - 1))
@settings(max_examples=10, deadline=None)
def test_dual_function_is_below_risk_of_random_paths(seed: int) -> None:
    scenario = geometry(seed, limited=True)
    paths = random_paths(scenario, 500, seed)
    dual = dual_of(scenario)
    for k in range(4):
        value = dual(random_multipliers(dual, seed + k)).value
        assert value <= risks(scenario, paths).min(initial=math.inf)


@given(st.integers(0, 2**32 - 1))
@settings(max_examples=10, deadline=None)
def test_dual_function_is_below_its_linear_models(seed: int) -> None:
    dual = dual_of(geometry(seed, limited=True))
    points = [random_multipliers(dual, seed + k) for k in range(3)]
    for x, y in itertools.permutations(points, 2):
        at_x, at_y = dual(x), dual(y)
        model = at_x.value + at_x.slope @ (y - x)
        assert at_y.value <= model + 1e-9 * (abs(at_x.value) + abs(at_y.value) + 1)


@given(st.integers(0, 2**32 - 1))
@settings(max_examples=10, deadline=None)
def test_kept_region_holds_every_better_path(seed: int) -> None:
    scenario = geometry(seed, limited=True)
    paths = random_paths(scenario, 300, seed)
    if not len(paths):
        return
    dual, path_risks = dual_of(scenario, reach=4), risks(scenario, paths)
    threshold = float(np.quantile(path_risks, 0.2)) * (1 + 1e-9)
    region = dual.kept(random_multipliers(dual, seed), threshold)
    assert region is not None
    for path in paths[path_risks < threshold]:
        for (low, cells), position in zip(region.blocks, path[1:], strict=True):
            i, j = np.floor(position / region.grid.spacing).astype(int) - low
            assert cells[i, j]


def test_dual_function_without_multipliers_is_bound_without_acceleration() -> None:
    scenario = agent((5.0, 2.0), TWO, 12)
    best = plan(scenario.with_values({"guide.acceleration_limited": False})).certificate.best
    bounds = []
    for reach in (2, 4, 8):
        duals = [dual_of(scenario, reach, steps=steps) for steps in range(8, 13)]
        bounds.append(min(dual(np.zeros(dual.count)).value for dual in duals))
    assert bounds[0] < bounds[1] < bounds[2] <= best
    assert bounds[2] > 0.97 * best


# --- known answers


def test_bound_turning_round_takes_steps_of_one_dimension() -> None:
    """Flying away at full speed, with a uniform rate: the risk is the least number of steps."""
    positions, velocity = [0.0], -2.0
    while len(positions) < 9:
        velocity = min(2.0, velocity + math.sqrt(0.4))
        positions.append(positions[-1] + 0.33 * velocity)
    target = (positions[-1] + 0.47, 0.0)  # the last step is just enough
    assert positions[-2] < target[0] - 0.6
    scenario = agent(
        target, [(50.0, 50.0)], 12, swarm__a_max=0.4, swarm__velocity=[-2.0, 0.0]
    ).with_hazard(bounded_patrol, background=0.3)
    risk = 0.3 * 0.33 * 8
    result = bounded(scenario, risk, first_nodes=20_000)
    assert 0.99 * risk <= result.bound <= risk
    free = bounded(
        scenario.with_values({"swarm.velocity": "guide"}),
        risk,
        first_nodes=20_000,
        deadline=time.monotonic() + 0.5,
    )
    steps = math.ceil((target[0] - 0.5) / 0.66)
    assert free.bound <= 0.3 * 0.33 * steps < 0.9 * risk


@pytest.mark.slow
def test_bound_above_least_risk_is_not_proven() -> None:
    """With a threshold above the least risk, the bound approaches that risk from below."""
    scenario = agent((5.0, 2.0), TWO, 12, swarm__a_max=0.1)
    risk = plan(scenario, certify=False).risk
    deadline = time.monotonic() + 2
    result = bounded(scenario, 1.02 * risk, deadline=deadline, first_nodes=20_000)
    assert 0.99 * risk < result.bound <= risk * (1 + 1e-6)
    assert result.reason != "the gap of 0.01 is reached"


# --- the whole bound


@given(st.integers(0, 2**32 - 1))
@settings(max_examples=3, deadline=None)
def test_bound_is_below_guides_and_random_paths(seed: int) -> None:
    scenario = geometry(seed, limited=True)
    guide = plan(scenario, certify=False, check=False)
    if not guide.arrives:
        return
    result = bounded(scenario, guide.risk, deadline=time.monotonic() + 0.5)
    found = risks(scenario, random_paths(scenario, 2000, seed))
    known = [guide.risk, *(each.risk for each in guide.best_per_homotopy_class())]
    assert result.bound <= min(*known, found.min(initial=math.inf))


def test_bound_never_decreases_and_stays_below_risk() -> None:
    scenario = agent((5.0, 2.0), TWO, 12, swarm__a_max=0.1)
    risk = plan(scenario, certify=False).risk
    limits, task = acceleration_limits(scenario), Relaxation.from_scenario(scenario)
    search = _Search(limits, 0.999 * risk, risk, math.inf)
    for steps in range(1, task.steps + 1):
        region = Region.full(replace(task, steps=steps), 1)
        if region is not None:
            search.add(0.0, region)
    bounds = [search.bound]
    while search.bound < 0.995 * risk:
        search.advance()
        bounds.append(search.bound)
    assert (np.diff(bounds) >= 0).all()
    assert bounds[-1] <= risk


def test_bound_increases_with_tighter_limit() -> None:
    bounds = []
    for a_max in (0.02, 0.1, 0.5):
        scenario = agent((5.0, 2.0), TWO, 12, swarm__a_max=a_max)
        guide = plan(scenario, gap=0.002)
        certificate = guide.certificate
        assert certificate.bound <= guide.risk_bound <= guide.risk
        assert guide.gap <= 0.002
        bounds.append(guide.risk_bound)
        free = bounded(scenario, certificate.best, gap=0.002)
        assert free.bound <= certificate.best
    assert bounds[0] > bounds[1] > bounds[2]


def test_bound_after_deadline_is_known_one() -> None:
    scenario = agent((5.0, 2.0), TWO, 12)
    result = bounded(scenario, 1.0, deadline=time.monotonic() - 1, known=0.25)
    assert (result.bound, result.regions) == (0.25, 0)
    assert result.reason == "the time limit is reached"


def test_bound_too_many_positions_is_known_one() -> None:
    scenario = agent((5.0, 2.0), TWO, 300)
    result = bounded(scenario, 1.0, known=0.25)
    assert result.bound == 0.25
    assert "too many positions" in result.reason


# --- plans


@pytest.mark.parametrize("name", ["single-agent", "patrol", "blink"])
def test_plan_built_in_scenario_reaches_half_a_percent(name: str) -> None:
    guide = plan(load_scenario(name), gap=0.005)
    assert 0 <= guide.gap <= 0.005
    assert guide.certificate.bound < guide.risk_bound


@pytest.mark.slow
@pytest.mark.parametrize(
    "name", ["alley", "barricade", "crossfire", "gauntlet", "large-swarm", "ring", "wall"]
)
def test_plan_flyable_built_in_scenario_reaches_half_a_percent(name: str) -> None:
    guide = plan(load_scenario(name), gap=0.005, time_limit=60.0)
    assert 0 <= guide.gap <= 0.005


def test_plan_local_search_bound_uses_better_known_path() -> None:
    scenario = load_scenario("paper-1")
    guide = plan(scenario)
    accelerated = guide.certificate.accelerated
    assert accelerated.best < 0.5 * guide.risk
    assert guide.certificate.bound < guide.risk_bound == accelerated.bound
    assert accelerated.gap <= 0.01
    assert guide.risk_bound <= plan(scenario, search="global", certify=False).risk


def test_plan_guide_beyond_limit_has_bound_without_acceleration() -> None:
    scenario = agent((5.0, 2.0), TWO, 12, swarm__a_max=0.02)
    guide = plan(scenario, "projected-gradient", check=False)
    assert guide.arrives
    assert guide.certificate.accelerated is None
    assert guide.risk_bound == guide.certificate.bound


def test_limits_of_first_velocity() -> None:
    free = acceleration_limits(agent((5.0, 2.0), TWO, 12, swarm__a_max=0.16))
    assert free.first == math.inf
    assert free.later == pytest.approx(0.4 * 0.33, rel=1e-9)
    given_velocity = agent((5.0, 2.0), TWO, 12, swarm__velocity=[1.0, -0.5], guide__a_max=0.01)
    limits = acceleration_limits(given_velocity)
    assert isinstance(limits, AccelerationLimits)
    assert limits.first == pytest.approx(math.sqrt(0.5) * 0.33, rel=1e-9)
    assert limits.later == pytest.approx(0.1 * 0.33, rel=1e-9)
    np.testing.assert_allclose(limits.displacement, [0.33, -0.165])
