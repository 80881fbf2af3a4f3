"""The proven bound: its lemmas, independent methods, and that no guide ever falls below it."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from random_paths import geometry, random_paths
from scipy.ndimage import maximum_filter, minimum_filter
from small_scenarios import TWO, Array, Point, free, grid_bounds, least_cost_on_grid

from casswarm import Saturation, Scenario, plan
from casswarm.bounds import certify
from casswarm.grid import (
    Grid,
    NodeBlock,
    Relaxation,
    StageCosts,
    box_extremum,
    costs_to_come,
    costs_to_go,
    least_cost,
    node_count,
)

# --- lemmas


@pytest.mark.slow
@given(st.integers(0, 2**32 - 1), st.sampled_from([2, 4]), st.booleans())
@settings(max_examples=240, deadline=None)
def test_box_extremum_matches_scipy(seed: int, axes: int, largest: bool) -> None:
    rng = np.random.default_rng(seed)
    size, pad, away, wide = (20, 80, 30, 30) if axes == 2 else (6, 12, 3, 12)
    k = int(rng.integers(1, size if axes == 2 else 5))
    values = rng.normal(size=tuple(rng.integers(1, size + 1, axes)))
    first, shape = rng.integers(-away, away, axes), rng.integers(1, wide, axes)
    to = NodeBlock(tuple(first.tolist()), tuple(shape.tolist()))
    fill, extremum = (-np.inf, maximum_filter) if largest else (np.inf, minimum_filter)
    padded = np.pad(values, pad, constant_values=fill)
    expected = extremum(padded, 2 * k + 1, mode="constant", cval=fill)
    at = NodeBlock((0,) * axes, values.shape)
    found = box_extremum(values, at, to, k, largest=largest)
    np.testing.assert_array_equal(found, expected[to.within(at.grown(pad))])


@given(st.integers(0, 2**32 - 1), st.integers(1, 4))
@settings(max_examples=40, deadline=None)
def test_blocks_of_nodes_agree_with_sets(seed: int, axes: int) -> None:
    def nodes(block: NodeBlock) -> set[tuple[int, ...]]:
        ranges = (range(i, j + 1) for i, j in zip(block.first, block.last, strict=True))
        return set(itertools.product(*ranges))

    rng = np.random.default_rng(seed)
    one, other = (
        NodeBlock(tuple(rng.integers(-3, 3, axes).tolist()), tuple(rng.integers(0, 4, axes)))
        for _ in range(2)
    )
    assert nodes(one.common(other)) == nodes(one) & nodes(other)
    assert len(nodes(one)) == one.size
    hull = NodeBlock.hull([one, other])
    assert nodes(one) | nodes(other) <= nodes(hull)
    assert nodes(one) <= nodes(one.grown(2))
    values = rng.uniform(size=one.shape)
    embedded = box_extremum(values, one, hull, 0, largest=True)
    np.testing.assert_array_equal(embedded[one.within(hull)], values)
    assert np.count_nonzero(np.isfinite(embedded)) == one.size


@given(st.integers(0, 2**32 - 1), st.floats(-3.5, 0.5))
@settings(max_examples=80, deadline=None)
def test_node_rates_interpolate_below_rate(seed: int, decade: float) -> None:
    rng = np.random.default_rng(seed)
    h = 10.0**decade
    k = int(rng.integers(1, 5))
    radars = rng.uniform(-3, 3, (k, 2)) * h * 10 ** rng.uniform(0, 1.5)
    core_radius = 0.01 if rng.random() < 0.3 else h * 10 ** rng.uniform(-3, 2)
    hazard = Saturation(radars, tuple(rng.uniform(0.1, 3, k)), core_radius=core_radius)
    low = rng.uniform(-3, 3, 2) * h * 10 ** rng.uniform(0, 1.5)
    if rng.random() < 0.5:  # at a radar, where it matters
        low = radars[0] + rng.uniform(-10, 10, 2) * h
    east, north = (start + h * np.arange(3) for start in low)
    nodes = hazard.single_agent_rates_below(east, north, h)
    u, v = rng.uniform(0, 1, (2, 200))
    for i, j in itertools.product((0, 1), (0, 1)):
        corner = nodes[i : i + 2, j : j + 2]
        inside = np.stack([east[i] + h * u, north[j] + h * v], axis=-1)
        weights = [(1 - u) * (1 - v), (1 - u) * v, u * (1 - v), u * v]
        interpolated = sum(s * c for s, c in zip(weights, corner.ravel(), strict=True))
        assert (interpolated <= hazard.single_agent_rates(inside) * (1 + 1e-12)).all()
    assert (nodes > 0).all()


@given(st.integers(0, 2**32 - 1))
@settings(max_examples=60, deadline=None)
def test_lower_bound_over_box_is_below_rate(seed: int) -> None:
    rng = np.random.default_rng(seed)
    radars = rng.uniform(-1, 1, (3, 2)) * 10.0 ** rng.uniform(-3, 0)
    core_radius = 10.0 ** rng.uniform(-4, 0)
    hazard = Saturation(radars, core_radius=core_radius)
    lower = radars[0] + 2 * core_radius * rng.uniform(-1, 1, 2)
    upper = lower + 10.0 ** rng.uniform(-4, 0, 2)
    points = rng.uniform(lower, upper, (300, 2))
    assert hazard.single_agent_lower_bound(lower, upper) <= hazard.single_agent_rates(points).min()


def test_node_rates_converge_quadratically() -> None:
    hazard = Saturation(tuple(TWO))
    missing = []
    for h in (0.1, 0.05, 0.025):
        east, north = np.array([0.0, h]), np.array([1.0, 1.0 + h])
        below = hazard.single_agent_rates_below(east, north, h)[0, 0]
        missing.append(hazard.single_agent_rates(np.array([0.0, 1.0])) - below)
    assert 3.5 < missing[0] / missing[1] < 4.8
    assert 3.8 < missing[1] / missing[2] < 4.4


def explicit_least(task: Relaxation, reach: int) -> float:
    """The recursion over all nodes: every path on the grid, with the costs of the docs."""
    h = task.step / reach
    axis = np.arange(-task.steps * reach - 1, task.steps * reach + 2)
    east, north = (start + h * axis for start in task.start)
    cost = task.dt * task.hazard.single_agent_rates_below(east, north, h)
    near = (
        np.maximum(np.abs(x - c) - h, 0.0) for x, c in zip((east, north), task.center, strict=True)
    )
    arrived = np.hypot(*np.meshgrid(*near, indexing="ij")) <= task.radius
    return least_cost_on_grid(cost, arrived, reach, task.steps)


@pytest.mark.parametrize("reach", [1, 2])
def test_costs_to_go_match_explicit_recursion(reach: int) -> None:
    task = Relaxation.from_scenario(free((1.9, 0.7), [(1.0, 0.5), (0.5, -0.6)], 4))
    stage_costs = StageCosts(Grid.full(task, 1, reach))
    assert least_cost(stage_costs, costs_to_go(stage_costs)) == pytest.approx(
        explicit_least(task, reach), rel=1e-12
    )


def test_costs_to_come_and_to_go_agree_at_every_step() -> None:
    task = Relaxation.from_scenario(free((4.0, 3.0), [(2.0, 1.0)], 12))
    stage_costs = StageCosts(Grid.full(task, 1, 2))
    values = costs_to_go(stage_costs)
    bound = least_cost(stage_costs, values)
    for arriving, going in itertools.islice(
        zip(costs_to_come(stage_costs), values, strict=True), 4
    ):
        assert min((a + g).min() for a, g in zip(arriving, going, strict=True)) == pytest.approx(
            bound, rel=1e-12
        )


# --- against independent methods


@pytest.mark.parametrize(
    ("radar", "target", "steps"),
    [((2.0, 0.3), (4.0, 0.5), 10), ((1.5, 1.4), (3.0, 3.0), 12), ((-0.4, 0.6), (3.0, 1.0), 9)],
)
def test_risk_bound_is_within_fine_grid_bounds(radar: Point, target: Point, steps: int) -> None:
    """Cells with their least rate, reach and target rounded outwards, without any refinement."""
    lower, upper = grid_bounds(radar, target, steps, cells=44)
    guide = plan(free(target, [radar], steps), gap=1e-4)
    assert 0.93 * upper < lower  # the bounds say something
    assert guide.gap < 1e-4
    assert lower < guide.risk_bound <= upper
    assert lower < guide.risk <= upper
    assert guide.risk == pytest.approx(upper, rel=2e-3)  # a path on cell centres is nearly as good


def random_risks(scenario: Scenario, seed: int) -> Array:
    """Risks up to the first arrival of random paths within the speed limit, of many lengths."""
    found: list[float] = []
    for T in range(scenario.n_steps, scenario.n_steps // 2, -2):
        paths = random_paths(scenario, 100, seed, T)[:, 1:]
        costs = scenario.time.dt * scenario.hazard.single_agent_rates(paths).cumsum(axis=1)
        first = scenario.target.contains(paths).argmax(axis=1)
        found += costs[np.arange(len(paths)), first].tolist()
    assert len(found) > 50
    return np.array(found)


@given(st.integers(0, 2**32 - 1))
@settings(max_examples=8, deadline=None)
def test_risk_bound_is_below_random_guides(seed: int) -> None:
    scenario = geometry(seed)
    guide = plan(scenario, gap=1e-3)
    found = random_risks(scenario, seed)
    assert guide.risk_bound <= min(*found, guide.risk, *(c.risk for c in guide.candidates))


@given(st.integers(0, 2**32 - 1), st.floats(0.0, 3.0))
@settings(max_examples=6, deadline=None)
def test_risk_bound_any_multiplier_is_below_guides(seed: int, weight: float) -> None:
    scenario = geometry(seed)
    guide = plan(scenario, certify=False)
    task = Relaxation.from_scenario(scenario)
    stage_costs = StageCosts(Grid.finest(task, 30_000), multiplier=weight * guide.risk)
    assert least_cost(stage_costs, costs_to_go(stage_costs)) <= guide.risk


# --- refinement


def test_certify_refinement_increases_bound() -> None:
    scenario = free((10.0, 10.0), TWO, 30)
    guide = plan(scenario, gap=1e-6)
    levels = guide.certificate.levels
    bounds = [level.bound for level in levels]
    assert len(levels) >= 4
    assert (np.diff(bounds) > 0).all()
    gaps = [1 - bound / guide.risk for bound in bounds]
    assert gaps[3] < gaps[0] / 16  # the square of the spacing would be a 64th
    assert guide.gap < 2e-6
    nodes = [level.nodes for level in levels]
    assert nodes[1] < nodes[0] / 10  # the cells that cannot carry a better guide are gone


@pytest.mark.slow
def test_certify_pruning_keeps_bound() -> None:
    """Discarding cells must not raise the bound above that of the whole grid and the best risk."""
    scenario = free((6.0, 4.0), [(2.0, 2.0), (4.5, 1.5)], 16)
    guide = plan(scenario, certify=False)
    task = Relaxation.from_scenario(scenario)
    certificate = certify(task, guide.risk, gap=1e-12, max_nodes=200_000, time_limit=5)
    assert certificate.levels[1].nodes < node_count(task, 1, certificate.levels[1].reach) / 2
    for level in certificate.levels:
        if node_count(task, 1, level.reach) < 2_000_000:
            stage_costs = StageCosts(Grid.full(task, 1, level.reach))
            assert level.bound == pytest.approx(
                least_cost(stage_costs, costs_to_go(stage_costs)), rel=1e-9
            )


@pytest.mark.parametrize("stride", [2, 4, 8])
def test_certify_stride_weakens_bound(stride: int) -> None:
    scenario = free((4.0, 3.0), [(2.0, 1.0)], 90, time__dt=0.033, time__t_f=90 * 0.033)
    task = Relaxation.from_scenario(scenario)
    bounds = []
    for m in (1, stride):
        stage_costs = StageCosts(Grid.full(task, m, 2))
        bounds.append(least_cost(stage_costs, costs_to_go(stage_costs)))
    guide = plan(scenario, certify=False)
    assert 0.5 * guide.risk < bounds[1] <= bounds[0] <= guide.risk


@pytest.mark.slow
@given(st.integers(0, 2**32 - 1), st.sampled_from([2_000, 5_000, 20_000]))
@settings(max_examples=8, deadline=None)
def test_certify_strided_refinement_is_below_guides(seed: int, first: int) -> None:
    """Cells are discarded at strides above 1, too; bounds of coarser grids stay valid."""
    scenario = geometry(seed)
    fine = scenario.with_values({"time.dt": 0.055, "time.t_f": scenario.time.t_f * (1 + 1e-9)})
    guide = plan(fine, certify=False)
    task = Relaxation.from_scenario(fine)
    certificate = certify(task, guide.risk, gap=0.002, first_nodes=first, max_nodes=2_000_000)
    assert certificate.levels[0].stride > 1
    assert certificate.bound <= min(*random_risks(fine, seed), guide.risk)
    assert certificate.gap < 0.03 or "nodes" in certificate.reason
    one = StageCosts(Grid.full(task, 1, 1))
    exact = least_cost(one, costs_to_go(one))
    assert all(level.bound <= guide.risk for level in certificate.levels)
    assert (
        certificate.bound >= min(exact, guide.risk) * (1 - 1e-9)
        or certificate.levels[-1].stride > 1
    )


def test_certify_node_and_time_limits_are_reported() -> None:
    scenario = free((10.0, 10.0), TWO, 30)
    guide = plan(scenario, certify=False)
    task = Relaxation.from_scenario(scenario)
    few = certify(task, guide.risk, gap=1e-9, max_nodes=1000)
    assert "more than 1,000 nodes" in few.reason
    short = certify(task, guide.risk, gap=1e-9, time_limit=1e-9)
    assert "time limit" in short.reason
    assert len(short.levels) == 1
    for certificate in (few, short):
        assert 0.9 * guide.risk < certificate.bound < guide.risk
