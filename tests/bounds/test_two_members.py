"""The bound of two members' success: lemmas of its proof, known answers, and plans below it."""

from __future__ import annotations

import itertools
import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from small_scenarios import DT, ON_THE_WAY, V_MAX, colliding, pair, patrolled, small

from casswarm import SaturationCollision, load_scenario, success_bound
from casswarm.bounds import PairValueFunction, pair_bound
from casswarm.bounds.pair_kernels import MemberNodes, step_back
from casswarm.bounds.pair_program import PairProgram, pair_lattice, viable_boxes
from casswarm.bounds.two_members import first_program
from casswarm.errors import PlanningError
from casswarm.grid import NodeBlock, Relaxation
from casswarm.joint import PlanDistribution

# --- known answers


@pytest.mark.parametrize("collides", [False, True])
def test_pair_bound_of_one_step_matches_best_positions(collides):
    scenario = small([(0.0, 0.0), (0.0, 0.0)], (1.0, 0.0), [(2.0, 0.4)], 1)  # anywhere together
    scenario = colliding(scenario) if collides else scenario
    axis = np.linspace(0.5, 0.66, 15)
    east, north = np.meshgrid(axis, np.linspace(-0.5, 0.5, 41))
    spots = np.column_stack([east.ravel(), north.ravel()])
    spots = spots[np.hypot(*(spots - [1.0, 0.0]).T) <= 0.5]
    pairs = np.array(list(itertools.product(spots, spots)))
    survival = np.exp(-DT * scenario.hazard.rates(pairs))
    best = float((1 - (1 - survival).prod(axis=1)).max())
    bound = pair_bound(scenario, tolerance=1e-4, max_nodes=2_000_000)
    assert best <= bound.value <= best + 0.002


@pytest.mark.parametrize("active", [None, [[0.0, DT]], [[DT, 2 * DT]]])
def test_pair_bound_of_two_steps_matches_brute_force(active):
    scenario = small([(0.0, 0.0), (0.0, 0.0)], (1.7, 0.0), [(1.0, 0.6)], 2, swarm__a_max=100.0)
    if active:
        radar = {"position": [1.0, 0.6], "active": active}
        scenario = scenario.with_values({"hazard.radars": None, "hazard.radar": [radar]})
    hazard, later = scenario.hazard.after(1), scenario.hazard.after(2)
    axes = np.linspace(0.56, 0.66, 3), np.linspace(-0.66, 0.66, 15)
    spots = np.stack(np.meshgrid(*axes), axis=-1).reshape(-1, 2)
    ends = np.stack(np.meshgrid(np.linspace(1.2, 1.32, 3), np.linspace(-0.4, 0.4, 9)), axis=-1)
    ends = ends.reshape(-1, 2)
    ends = ends[np.hypot(*(ends - [1.7, 0.0]).T) <= 0.5]
    pairs = np.array(list(itertools.product(ends, ends)))
    last = 1 - (1 - np.exp(-DT * later.rates(pairs))).prod(axis=1)
    alone = np.exp(-DT * later.single_agent_rates(ends))
    best = 0.0
    for a, b in itertools.product(spots, spots):
        near_a, near_b = (np.abs(ends - x).max(axis=1) <= DT * V_MAX + 1e-12 for x in (a, b))
        both = np.outer(near_a, near_b).ravel()
        if not both.any():
            continue
        p, q = np.exp(-DT * hazard.rates([a, b]))
        value = p * q * last[both].max()
        value += p * (1 - q) * alone[near_a].max() + q * (1 - p) * alone[near_b].max()
        best = max(best, value)
    bound = pair_bound(scenario, best, max_nodes=4_000_000)
    assert best <= bound.value <= best + 0.01


def test_pair_bound_of_partner_out_of_reach_is_that_of_protected_agent():
    scenario = small([(0.0, 0.0), (-9.0, 0.0)], (1.2, 0.0), [(0.9, 0.5)], 3)
    alone = scenario.with_values({"swarm.positions": [[0.0, 0.0]]})
    single, bound = float(success_bound(alone)), pair_bound(scenario, tolerance=1e-3).value
    assert single - 0.01 <= bound <= single + 0.2  # the proof lets the partner be at the margin


@pytest.mark.parametrize("far", [(300.0, 300.0), (0.0, -1e4), (-9.0, 0.0)])
def test_pair_bound_does_not_depend_on_where_a_partner_out_of_reach_is(far):
    bounds, sizes = [], []
    for position in ((12.0, 0.0), far):
        scenario = small([(0.0, 0.0), position], (1.2, 0.0), [(0.9, 0.5)], 3)
        bounds.append(pair_bound(scenario, max_nodes=200_000).value)
        sizes.append(first_program(scenario, 200_000).size)
    assert math.isclose(*bounds, rel_tol=1e-12)
    assert max(sizes) < 5_000
    program = first_program(scenario, 1_000_000, certified=False)
    assert program.size < 100_000
    path = PairValueFunction.from_scenario(scenario, 1_000_000).path(scenario.positions)
    np.testing.assert_allclose(path[0], scenario.positions)
    assert np.abs(np.diff(path, axis=0)).max() <= DT * V_MAX * (1 + 1e-6)


@pytest.mark.parametrize("factor", [1e4, 1e5])
def test_pair_bound_of_tiny_success_is_positive(factor):
    bound = pair_bound(pair(4, hazard__alpha_1=factor), max_nodes=200_000)
    assert 0 < bound.value < 1e-300


def test_multipliers_of_a_target_much_smaller_than_a_step_do_not_overflow():
    scenario = pair(target__radius=0.02)
    program = first_program(scenario, 100_000)
    largest = 300.0 / scenario.target.radius
    bounds = [
        replace(program, multipliers=(factor * largest, 2 * factor * largest)).backward()[0]
        for factor in (1e-3, 1.0)
    ]
    best = PairValueFunction.from_scenario(scenario, 100_000).after(1, scenario.positions[None])[0]
    assert np.isfinite(bounds).all()
    assert min(bounds) >= best


def test_initial_velocities_lower_bound():
    scenario = pair(5, swarm__a_max=0.3)
    free = pair_bound(scenario, max_nodes=500_000).value
    away = np.array([[-1.5, 0.0], [-1.5, 0.0]])
    assert pair_bound(scenario, initial_velocities=away, max_nodes=500_000).value < free


# --- lemmas


@settings(max_examples=30, deadline=None)
@given(st.floats(0.005, 0.7), st.floats(0.0, 8.0), st.floats(0.2, 9.0), st.integers(0, 99))
def test_interpolated_pair_bounds_are_below_rates(spacing, alpha_2, alpha_3, seed):
    hazard = SaturationCollision([(0, 0)], alpha_2=alpha_2, alpha_3=alpha_3)
    count = 20
    bounds = hazard.pair_bounds((count, count), spacing)
    rng = np.random.default_rng(seed)
    at = rng.uniform(0, 2 * count - 2, (4000, 2))
    at[:1000] = rng.uniform(count - 4, count + 2, (1000, 2))
    cells = np.minimum(np.floor(at).astype(int), 2 * count - 3)
    offsets = spacing * (at - (count - 1))
    squared = (offsets**2).sum(axis=1)
    share = (1 + alpha_2) / (1 + alpha_2 * (1 + 1 / (1 + alpha_3 * squared)))
    pairs = np.stack([100.0 + offsets, np.full_like(offsets, 100.0)], axis=1)
    exact = hazard.rates(pairs)[:, 0] - share * hazard.single_agent_rates(pairs[:, 0])
    for values, function in ((bounds.share, share), (bounds.collision, exact)):
        found = np.zeros(len(at))
        for i, j in itertools.product((0, 1), (0, 1)):
            weights = np.abs(1 - i - (at - cells)[:, 0]) * np.abs(1 - j - (at - cells)[:, 1])
            found += weights * values[cells[:, 0] + i, cells[:, 1] + j]
        assert (found <= function * (1 + 1e-9) + 1e-9).all()
    assert (bounds.collision >= 0).all()


def common_offset_mean(values, at, rng, count=4000):
    """Mean of values at positions (4,) that are rounded with one random offset for each axis."""
    offsets = rng.random((count, 2))
    nodes = np.floor(at + np.tile(offsets, 2)).astype(int)
    return values[tuple(nodes.T)].mean()


@pytest.mark.parametrize("collides", [False, True])
def test_step_back_is_above_every_position_between_nodes(collides):
    rng = np.random.default_rng(3)
    scenario = colliding(pair(4)) if collides else pair(4)
    task = Relaxation.from_scenario(scenario, scenario.positions[0])
    region = NodeBlock((0, 0), (10, 10))
    lattice = pair_lattice(task, scenario.positions, 6, region, 2, (0.0, 0.0))
    alone = rng.uniform(0.2, 0.6, (2, 10, 10))
    members = [MemberNodes(*lattice.risks[0], nodes, nodes) for nodes in alone]
    values = np.maximum(alone[0][:, :, None, None], alone[1])
    values = np.maximum(values, rng.uniform(0.3, 1.0, (10, 10, 10, 10)))
    after = values.copy()
    step_back(*members, lattice.pair, (9, 9), after)
    spacing = lattice.grid.spacing
    for _ in range(100):
        at = rng.uniform(0, 8, 4)
        if rng.random() < 0.5:  # close together
            at[2:] = np.clip(at[:2] + rng.normal(0, 1, 2), 0, 8)
        seed = int(rng.integers(1 << 30))
        first, second = (
            np.exp(common_offset_mean(np.log(lifted), at, np.random.default_rng(seed)))
            for lifted in (
                np.broadcast_to(alone[0][:, :, None, None], values.shape),
                np.broadcast_to(alone[1], values.shape),
            )
        )
        both, found = (
            np.exp(common_offset_mean(np.log(array), at, np.random.default_rng(seed)))
            for array in (values, after)
        )
        p, q = np.exp(-DT * scenario.hazard.rates(spacing * at.reshape(2, 2)))
        exact = p * q * both + p * (1 - q) * first + q * (1 - p) * second
        assert exact <= found * (1 + 0.01)  # up to the error of the mean


def test_viable_boxes_hold_all_cells_around_viable_nodes():
    rng = np.random.default_rng(0)
    needed = np.full((16, 16, 16, 16), -np.inf)
    for corner in ((1, 1, 1, 1), (11, 11, 11, 11)):
        window = tuple(slice(c, c + 4) for c in corner)
        needed[window] = np.where(rng.random((4, 4, 4, 4)) < 0.3, -0.5, -np.inf)
    block = NodeBlock.between((3, 3, -5, -5), (18, 18, 10, 10))
    boxes = list(viable_boxes(needed, block, 0.5))
    assert len(boxes) >= 2
    assert sum(np.prod((box[1] - box[0]) / 0.5 + 1) for box in boxes) < 0.25 * needed.size
    for node in np.argwhere(needed > -np.inf) + block.first:
        assert any(
            (0.5 * (node - 1) >= box[0] - 1e-9).all() and (0.5 * (node + 1) <= box[1] + 1e-9).all()
            for box in boxes
        )


@pytest.mark.parametrize("collides", [False, True])
def test_tube_keeps_bound_of_full_grid(collides):
    scenario = colliding(pair(5)) if collides else pair(5)
    program = first_program(scenario, 300_000)
    bound, kept = program.backward()
    values = program.task, program.starts
    options = 2 * program.reach, program.margin, program.multipliers
    full, _ = PairProgram(*values, program.tube, *options).backward()
    known = full * 0.97  # a policy that is a little worse than the bound
    tube = program.forward(kept, known)
    within, _ = PairProgram(*values, tube, *options).backward()
    assert tube.nodes(program.spacing) < program.tube.nodes(program.spacing)
    assert math.isclose(max(within, known), full, rel_tol=1e-12)
    assert full <= bound


# --- the value function

FIVE_STEPS = pair(5)


def test_path_of_pair_keeps_speed_limit_and_arrives_and_value_is_zero_elsewhere():
    value = PairValueFunction.from_scenario(FIVE_STEPS, 300_000)
    path = value.path(FIVE_STEPS.positions)
    assert path.shape == (6, 2, 2)
    np.testing.assert_array_equal(path[0], FIVE_STEPS.positions)
    assert np.abs(np.diff(path, axis=0)).max() <= DT * V_MAX * (1 + 1e-9)
    assert FIVE_STEPS.target.contains(path).any()
    for step, positions in ((2, np.full((3, 2, 2), 99.0)), (6, path[:3])):  # outside, and after
        np.testing.assert_array_equal(value.after(step, positions), 0.0)


def test_value_of_path_is_near_its_exact_law():
    value = PairValueFunction.from_scenario(FIVE_STEPS, 3_000_000)
    path = value.path(FIVE_STEPS.positions)
    predicted = value.after(1, path[1:2])[0]
    law = PlanDistribution.from_positions(FIVE_STEPS, path).success
    assert law.low - 0.01 <= predicted <= pair_bound(FIVE_STEPS, max_nodes=3_000_000).value + 0.01


# --- refusals

FOUR_STEPS = pair(4)
USERS = FOUR_STEPS.with_hazard(patrolled, radars=ON_THE_WAY)
PAPER = load_scenario("paper-1")
REFUSALS = [
    (pair_bound, PAPER, {}, PlanningError, "computed for two members; 'paper-1' has 5"),
    (pair_bound, USERS, {}, PlanningError, "CustomHazard does not provide `pair_bounds`"),
    (pair_bound, FOUR_STEPS, {"max_nodes": 10}, PlanningError, "more than max_nodes = 10"),
    (success_bound, PAPER, {"max_nodes": 10}, ValueError, "from 1000"),
    (
        success_bound,
        PAPER,
        {"max_work": math.inf},
        ValueError,
        "max_work = inf; allowed: finite numbers",
    ),
    *(
        (success_bound, PAPER, {name: -1}, ValueError, f"{name} = -1; allowed: numbers from 0")
        for name in ("max_work", "accuracy", "time_limit")
    ),
]


@pytest.mark.parametrize(("function", "scenario", "options", "error", "message"), REFUSALS)
def test_bound_refuses(function, scenario, options, error, message):
    with pytest.raises(error, match=message):
        function(scenario, **options)
