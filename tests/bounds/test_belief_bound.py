"""Bounds of the mean survival over cases: known values, triangulations, attacks by random paths."""

from __future__ import annotations

from itertools import product

import numpy as np
import pytest
from small_scenarios import small

import casswarm as csw
from casswarm.bounds.belief_bound import (
    BeliefProgram,
    best_belief_path,
    mixture_bound,
    simplex,
)
from casswarm.grid import Grid, Relaxation
from casswarm.grid.belief_kernels import interpolated

FREE = {"guide__acceleration_limited": False, "guide__margin": 1e-6}
PLACES = [(1.0, 0.5), (1.2, -0.6), (2.0, 0.4), (2.2, -0.5)]


def tasks(cases: int) -> list[Relaxation]:
    scenarios = [
        small([(0.0, 0.0)], (3.0, 0.1), [PLACES[k], (1.5, 1.5)], 8, **FREE) for k in range(cases)
    ]
    return [Relaxation.from_scenario(each) for each in scenarios]


def survivals(chosen: list[Relaxation], path: np.ndarray) -> np.ndarray:
    return np.array([np.exp(-task.dt * task.rates_along(path[1:]).sum()) for task in chosen])


@pytest.mark.parametrize(("cases", "divisions"), [(1, 1), (2, 5), (3, 4), (4, 3)])
def test_points_of_the_simplex(cases: int, divisions: int) -> None:
    found = simplex(cases, divisions)
    assert len(found.points) == len({tuple(p) for p in found.points.tolist()})
    np.testing.assert_allclose(found.points.sum(axis=1), 1.0, atol=1e-15)
    whole = [p for p in product(range(divisions + 1), repeat=cases) if sum(p) == divisions]
    assert len(found.points) == len(whole)
    tails, order = np.empty(cases - 1), np.empty(cases - 1, np.int64)
    values = np.random.default_rng(0).uniform(size=len(whole))
    for point, value in zip(found.points, values, strict=True):  # its own value at every point
        ours = interpolated(values, 3.0 * point, found, tails, order)
        assert ours == pytest.approx(3.0 * value, rel=1e-12)


@pytest.mark.parametrize(("cases", "divisions"), [(2, 6), (3, 6), (4, 4)])
def test_interpolation_is_linear_exact_and_above_convex_functions(
    cases: int, divisions: int
) -> None:
    rng, found = np.random.default_rng(1), simplex(cases, divisions)
    tails, order = np.empty(cases - 1), np.empty(cases - 1, np.int64)
    slopes = rng.uniform(0, 1, (5, cases))
    linear, convex = found.points @ slopes[0], (found.points @ slopes.T).max(axis=1)
    excess = []
    for weights in rng.dirichlet(0.7 * np.ones(cases), 300) * rng.uniform(0, 2, (300, 1)):
        ours = interpolated(linear, weights, found, tails, order)
        assert ours == pytest.approx(weights @ slopes[0], rel=1e-12, abs=1e-15)
        upper = interpolated(convex, weights, found, tails, order)
        excess.append(upper - (slopes @ weights).max())
    assert min(excess) > -1e-12
    assert 0 < max(excess) < 0.3


def test_one_case_is_the_bound_of_guides() -> None:
    scenario = small([(0.0, 0.0)], (3.0, 0.1), [PLACES[0], (1.5, 1.5)], 8, **FREE)
    guide = csw.plan(scenario, gap=0.003)
    task = Relaxation.from_scenario(scenario)
    bound = mixture_bound([task], np.ones(1), guide.survival, gap=1e-3, time_limit=3.0)
    assert guide.survival <= bound.value <= guide.survival_bound * 1.01
    assert len(bound.levels) >= 1


@pytest.mark.slow
@pytest.mark.parametrize("cases", [2, 3, pytest.param(4, marks=pytest.mark.slow)])
def test_no_random_path_exceeds_the_bound(cases: int) -> None:
    """Bounds of coarse grids are near, and of no path below its value; so are those of limits."""
    chosen, rng = tasks(cases), np.random.default_rng(cases)
    prior = rng.dirichlet(np.ones(cases))
    best = 0.0
    step = chosen[0].step
    center = np.asarray(chosen[0].center)
    for _ in range(3000):
        goals = center + rng.uniform(-0.3, 0.3, 2)
        bend = rng.normal(0, 0.5, 2)
        path = [np.asarray(chosen[0].start)]
        for t in range(1, chosen[0].steps + 1):
            share = t / chosen[0].steps
            wanted = share * goals + 4 * share * (1 - share) * bend
            path.append(path[-1] + np.clip(wanted - path[-1], -step, step) * (1 - 1e-12))
            if np.hypot(*(path[-1] - center)) <= 0.5:
                best = max(best, float(prior @ survivals(chosen, np.array(path))))
                break
    assert best > 0.01
    bound = mixture_bound(chosen, prior, best, gap=1e-3, time_limit=1.0)
    assert best <= bound.value < 2.0 * best
    assert [level.bound for level in bound.levels] == sorted(
        (level.bound for level in bound.levels), reverse=True
    )


def test_path_of_beliefs_is_nearly_the_best() -> None:
    chosen, prior = tasks(3), np.array([0.5, 0.2, 0.3])
    grid = Grid.finest(chosen[0], 20_000)
    program = BeliefProgram(chosen, grid, prior, 12, certified=False)
    nodes = np.array(best_belief_path(program), float)
    path = chosen[0].start + grid.spacing * nodes
    assert np.hypot(*(path[-1] - chosen[0].center)) <= chosen[0].radius
    assert np.abs(np.diff(path, axis=0)).max() <= chosen[0].step * (1 + 1e-12)
    value = float(prior @ survivals(chosen, path))
    bound = mixture_bound(chosen, prior, value, gap=1e-3, time_limit=2.0)
    assert 0.9 * bound.value < value <= bound.value
