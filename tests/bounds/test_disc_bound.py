"""Bounds of paths whose speed is limited in every direction: lemmas and known answers."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from random_paths import geometry, risks
from small_scenarios import free

import casswarm as csw
from casswarm.bounds import certify
from casswarm.bounds.disc_bound import DiscMoves, DiscProgram, convexity_excess
from casswarm.grid import NodeBlock, Relaxation

MULTIPLIER = 0.11  # near that of the path in `passing`
SEEDS = st.integers(0, 2**32 - 1)


def interpolated(values, point):
    """Bilinear interpolation of node values (n, m) at a point (2,), in nodes."""
    cell = np.minimum(np.floor(point).astype(int), np.array(values.shape) - 2)
    (s, t), (i, j) = point - cell, cell
    rows = (1 - s) * values[i] + s * values[i + 1]
    return float((1 - t) * rows[j] + t * rows[j + 1])


def in_disc(scenario):
    return scenario.with_values({"swarm.speed": "disc"})


def program(scenario, reach, best, multiplier=MULTIPLIER):
    return DiscProgram.full(Relaxation.from_scenario(scenario), reach, best, multiplier)


# --- lemmas


@given(SEEDS, st.floats(0, 1), st.floats(0, 1), st.floats(0, 1), st.floats(0, 1))
@settings(max_examples=200, deadline=None)
def test_lowered_values_interpolated_twice_are_not_above_those_interpolated_once(
    seed, s, t, dx, dy
) -> None:
    rng = np.random.default_rng(seed)
    values = np.cumsum(np.cumsum(rng.normal(size=(7, 7)), axis=0), axis=1)
    lowered = values - convexity_excess(values)
    assert (lowered <= values).all()
    shift = np.array([dx, dy])
    corners = [np.array([2 + a, 2 + b]) for a in (0, 1) for b in (0, 1)]
    weights = [(s if a else 1 - s) * (t if b else 1 - t) for a in (0, 1) for b in (0, 1)]
    twice = sum(w * interpolated(lowered, c + shift) for w, c in zip(weights, corners, strict=True))
    assert twice <= interpolated(values, np.array([2 + s, 2 + t]) + shift) + 1e-9


def test_concave_values_are_not_lowered() -> None:
    x, y = np.meshgrid(np.arange(9.0), np.arange(8.0), indexing="ij")
    assert convexity_excess(-(x**2) - 2 * y**2).max() == 0.0
    bowl = convexity_excess(x**2)[1:-1, 1:-1]
    np.testing.assert_allclose(bowl, 0.5)  # a quarter of the second difference


@given(SEEDS, st.sampled_from([1, 2, 3, 5]))
@settings(max_examples=60, deadline=None)
def test_least_value_is_below_every_move_in_the_disc(seed, reach) -> None:
    rng = np.random.default_rng(seed)
    size = 2 * reach + 7
    values = rng.normal(size=(size, size))
    middle = NodeBlock((size // 2, size // 2), (1, 1))
    least = DiscMoves.within(reach).least(values, NodeBlock((0, 0), values.shape), middle)[0, 0]
    angles, lengths = rng.uniform(0, 2 * math.pi, 500), reach * np.sqrt(rng.uniform(0, 1, 500))
    lengths[:200] = reach
    moves = lengths[:, None] * np.stack([np.cos(angles), np.sin(angles)], axis=-1)
    found = min(interpolated(values, size // 2 + move) for move in moves)
    assert least <= found
    assert least >= values.min()


@pytest.mark.parametrize("reach", [1, 4, 16])
def test_least_value_of_a_plane_is_at_the_rim(reach) -> None:
    size = 2 * reach + 9
    i, j = np.meshgrid(np.arange(size), np.arange(size), indexing="ij")
    at, middle = NodeBlock((0, 0), i.shape), NodeBlock((size // 2, size // 2), (1, 1))
    for angle in np.linspace(0, 2 * math.pi, 17):
        plane = math.cos(angle) * (i - size // 2) + math.sin(angle) * (j - size // 2)
        least = DiscMoves.within(reach).least(plane, at, middle)[0, 0]
        rim = reach / math.cos(math.pi / (12 * reach))  # of the polygon around the disc
        assert -rim * (1 + 1e-8) <= least <= -reach


# --- bounds


def straight(scenario, seed, count=200):
    """Paths with one turn, at speeds up to the limit, of those that arrive: (T+1, 2) each."""
    rng, step = np.random.default_rng(seed), scenario.swarm.v_max * scenario.time.dt
    center, found = np.array(scenario.target.center), []
    for _ in range(count):
        end = center + 0.99 * scenario.target.radius * rng.uniform(-0.7, 0.7, 2)
        turn = rng.uniform(0.2, 0.8) * end + rng.normal(size=2)
        corners, length = np.array([[0.0, 0.0], turn, end]), rng.uniform(0.6, 1.0) * step
        along = np.concatenate([[0.0], np.hypot(*np.diff(corners, axis=0).T).cumsum()])
        steps = math.ceil(along[-1] / length)
        if steps <= scenario.n_steps:
            at = np.minimum(length * np.arange(steps + 1), along[-1])
            found.append(np.stack([np.interp(at, along, line) for line in corners.T], axis=-1))
    return found


@pytest.mark.slow
@given(SEEDS)
@settings(max_examples=15, deadline=None)
def test_no_path_is_below_the_bound(seed) -> None:
    scenario = in_disc(geometry(seed))
    paths = straight(scenario, seed)
    if not paths:
        return
    least = min(float(risks(scenario, path[None])[0]) for path in paths)
    multiplier = float(np.random.default_rng(seed).choice([0.01, 0.1, 1.0]))
    coarse = program(scenario, 4, least, multiplier)
    assert coarse.bound <= least
    assert coarse.halved().bound <= least


@pytest.fixture(scope="module")
def passing():
    """An agent that passes a radar, and its best path."""
    scenario = in_disc(free((4.0, 0.0), [(2.0, 0.6)], 12))
    return scenario, csw.plan(scenario, certify=False)


def test_gap_falls_as_the_square_of_the_spacing(passing) -> None:
    scenario, guide = passing
    gaps = [1 - program(scenario, reach, guide.risk).bound / guide.risk for reach in (4, 8, 16)]
    assert gaps[0] > 3 * gaps[1] > 9 * gaps[2] > 0
    assert gaps[2] < 0.005


def test_pruned_program_has_the_bound_of_the_full_one(passing) -> None:
    scenario, guide = passing
    pruned, full = program(scenario, 4, guide.risk).halved(), program(scenario, 8, guide.risk)
    assert pruned.size < full.size
    assert pruned.bound == pytest.approx(full.bound, rel=1e-6)


@pytest.mark.slow
def test_certificate_is_within_a_percent_where_rounded_paths_are_not(passing) -> None:
    scenario, guide = passing
    certificate = certify(Relaxation.from_scenario(scenario), guide.risk, MULTIPLIER)
    assert certificate.gap <= 0.01
    assert certificate.levels[-1].reach <= 16
    bounds = [level.bound for level in certificate.levels]
    assert bounds == sorted(bounds)


@pytest.mark.parametrize("turns", [1, 2, 3])
def test_quarter_turns_change_no_bound(passing, turns) -> None:
    scenario, guide = passing
    turn = np.linalg.matrix_power(np.array([[0, -1], [1, 0]]), turns)
    turned = scenario.with_values(
        {
            "target.center": (turn @ scenario.target.center).tolist(),
            "hazard.radars": [(turn @ radar).tolist() for radar in scenario.hazard_table.radars],
        }
    )
    bounds = [program(each, 8, guide.risk).bound for each in (scenario, turned)]
    assert bounds[0] == pytest.approx(bounds[1], rel=1e-9)


def constant(positions, alive):
    """The same rate everywhere."""
    del alive
    return 0.3 + 0.0 * positions[:, 0]


constant.lower_bound = lambda lower, upper: np.full(np.shape(lower)[:-1], 0.3)  # noqa: ARG005


def test_equal_rates_cost_the_least_number_of_steps() -> None:
    scenario = in_disc(free((3.0, 3.0), [(9.0, 9.0)], 12)).replace(
        hazard={"kind": constant, "radars": None, "alpha_1": None, "alpha_2": None, "alpha_3": None}
    )
    guide = csw.plan(scenario)
    steps = math.ceil((3 * math.sqrt(2) - 0.5) / 0.66)
    assert guide.arrival == steps
    assert guide.certificate.bound <= 0.33 * 0.3 * steps
    assert guide.certificate.bound >= 0.33 * 0.3 * (steps - 1)
