"""Potentials and the level game: their properties, known answers, and policies below the bound."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from small_scenarios import Array, small

from casswarm import Saturation, SaturationCollision, Scenario, load_scenario, success_bound
from casswarm.bounds import PotentialFamily
from casswarm.bounds.level_game import Effort, LevelGame, Potential, _product, game_bound
from casswarm.bounds.level_game_kernels import fill_levels
from casswarm.grid import Relaxation
from casswarm.hazard.rate_bounds import LeastRate

ALLEY = load_scenario("alley")


def potential(scenario: Scenario, slope: float, largest: float, nodes: int = 100_000) -> Potential:
    task = Relaxation.from_scenario(scenario)
    return PotentialFamily(task, scenario.positions, nodes, 0.5).potential(slope, largest)


# --- rates by density


@pytest.mark.slow
@pytest.mark.parametrize("collides", [False, True])
def test_least_rates_are_below_rates_of_formations(collides: bool) -> None:
    rng, tightest = np.random.default_rng(collides), np.inf
    for _ in range(200):
        radars = [(float(x), float(y)) for x, y in rng.uniform(-3, 3, (2, 2))]
        beta_2, n, destroyed = rng.uniform(2, 8), int(rng.integers(2, 7)), int(rng.integers(3))
        hazard = SaturationCollision(radars, beta_2=beta_2) if collides else Saturation(radars)
        x = rng.uniform(-3, 3, 2) + 10 ** rng.uniform(-2, 0.5) * rng.normal(size=(n, 2))
        squared = ((x[:, None] - x) ** 2).sum(axis=-1)
        densities = hazard.density_bound(squared).sum(axis=1) - 1
        rates, single = hazard.rates(x), hazard.single_agent_rates(x)
        least = hazard.least_rates(n, densities, single)
        all_densities = hazard.least_rate(n + destroyed)
        assert least is not None
        assert all_densities is not None
        assert (np.diagonal(least) <= rates * (1 + 1e-9)).all()
        assert (np.diagonal(least) >= all_densities(single) * (1 - 1e-9)).all()
        tightest = min(tightest, float((rates / np.diagonal(least)).min()))
    assert tightest < 1.01


def test_least_rates_of_other_hazards_ignore_density() -> None:
    class Other(Saturation):
        def least_rate(self, n: int) -> LeastRate:
            return LeastRate(np.zeros(1), np.full(1, 1.0 / n))

    hazard = Other([(0.0, 0.0)])
    least = hazard.least_rates(3, np.array([0.0, 2.0]), np.array([1.0, 3.0]))
    assert least is not None
    np.testing.assert_allclose(least, [[1 / 3, 1.0], [1 / 3, 1.0]])
    np.testing.assert_array_equal(hazard.density_bound(np.array([0.0, 9.0])), [1.0, 1.0])


@pytest.mark.slow
def test_game_of_a_hazard_without_densities_is_valid() -> None:
    class Bounded(Saturation):
        """The paper's rates, of which only the least ones are known."""

        def single_agent_lower_bound(self, lower: Array, upper: Array) -> Array:
            return papers.single_agent_lower_bound(lower, upper)

        def least_rate(self, n: int) -> LeastRate | None:
            return papers.least_rate(n)

    papers = Saturation([(0.0, 1.5), (0.0, -1.5)])
    starts = np.array([(-2.0, 0.0), (-2.2, 0.1)])
    tasks = [
        replace(
            Relaxation.from_scenario(ALLEY),
            hazard=hazard,
            start=starts[0],
            center=np.array([2.0, 0]),
        )
        for hazard in (papers, Bounded(papers.radars))
    ]
    effort = Effort(3_000_000, 1e6, 0.0, math.inf)
    known, unknown = (game_bound(task, starts, 0.0, effort).value for task in tasks)
    assert known <= unknown + 0.005  # whose rates at the nodes are other lower bounds
    assert unknown < 0.95


# --- potentials


@pytest.mark.parametrize(("slope", "largest"), [(1.2, 0.5), (0.5, 0.2), (4.0, np.inf)])
def test_potential_has_its_properties(slope: float, largest: float) -> None:
    levels = potential(ALLEY, slope, largest)
    task = levels.task
    rng = np.random.default_rng(0)
    target = task.center + task.radius * rng.normal(size=(200, 2)) * 0.3
    target = target[np.hypot(*(target - task.center).T) <= task.radius]
    for step in range(0, task.steps, 3):
        x = rng.uniform((-3, -6), (15, 6), (2000, 2))
        y = x + rng.uniform(-task.step, task.step, x.shape)
        risk = task.dt * ALLEY.hazard.single_agent_rates(y)
        drop = levels.levels(step, x) - levels.levels(step + 1, y)
        assert (drop <= np.minimum(risk, largest) + 1e-9).all()
        assert (levels.levels(step, target) <= 0).all()
        z = x + rng.normal(size=x.shape) * 10 ** rng.uniform(-2, 1, (len(x), 1))
        gap = levels.levels(step, x) - levels.levels(step, z)
        squared = ((x - z) ** 2).sum(axis=1)
        assert (squared >= levels.least_squared_distance(np.abs(gap)) * (1 - 1e-9)).all()
    assert levels.start_levels.min() > 0.5  # and is not just 0


def test_potential_without_limits_is_value_function() -> None:
    alone = ALLEY.with_values({"swarm.positions": [(0.0, 0.0)]})
    levels = potential(alone, math.inf, math.inf, 4_000_000).start_levels
    risk = success_bound(alone, 4_000_000).risks[0]
    assert 0.97 * risk <= levels[0] <= risk * 1.01


# --- the game


def test_levels_are_ranked() -> None:
    levels = np.zeros((math.comb(6 + 2, 3), 3), np.int64)
    fill_levels(levels)
    ranks = [sum(math.comb(int(x) + i, i + 1) for i, x in enumerate(row)) for row in levels]
    assert ranks == list(range(len(levels)))
    assert (np.diff(levels, axis=1) >= 0).all()
    assert levels.max() == 5


def test_game_of_one_member_is_exact() -> None:
    levels = potential(ALLEY.with_values({"swarm.positions": [(0.0, 0.0)]}), 1.2, 0.5)
    for cells in (1, 2, 3):
        value = LevelGame(levels, cells, (0,)).value()
        ideal = math.exp(-levels.start_levels[0])
        assert ideal <= value <= ideal * 1.15
    # on a level of the grid interpolation is exact
    game = LevelGame(levels, 4, (0,))
    game.__dict__["starts"] = np.array([12 * game.spacing])
    assert game.value() == pytest.approx(math.exp(-12 * game.spacing), rel=1e-6)


def on_levels(levels: float, largest: float, cells: int, slope: float) -> float:
    """Value of the game of two members on the levels of a grid, without rounding in either."""
    g, n = largest / cells, round(levels * cells / largest)
    alone, value = np.exp(-g * np.arange(n + 1)), np.ones((n + 1, n + 1))

    def survival(drop: int, behind: int) -> float:
        density = 1 / (1 + 4.0 * (max(behind, 0) * g / slope) ** 2)
        return math.exp(-drop * g * 4.0 / (1 + 3.0 * (1 + density)))

    for x in range(1, n + 1):
        for y in range(x, n + 1):
            best = alone[x]
            for i in range(min(cells, x) + 1):
                for j in range(min(cells, y) + 1):
                    a, b = x - i, y - j
                    p, q = survival(i, b - a), survival(j, a - b)
                    if i + j:
                        both = value[min(a, b), max(a, b)]
                        single = p * (1 - q) * alone[a] + (1 - p) * q * alone[b]
                        best = max(best, p * q * both + single)
            value[x, y] = best
    return float(value[n, n])


def test_game_of_two_members_approaches_the_game_on_levels() -> None:
    scenario = ALLEY.with_values({"swarm.positions": [(0.0, 0.0)] * 2})
    levels = potential(scenario, 1.2, 0.5)
    exact = on_levels(2.5, 0.5, 8, 1.2)
    excess = []
    for cells in (2, 4, 8):
        game = LevelGame(levels, cells, (0, 1))
        game.__dict__["starts"] = np.full(2, 2.5 * (1 - 1e-9))
        excess.append(game.value() / exact - 1)
    assert 0 <= excess[2] < excess[1] < excess[0] < 0.1
    assert excess[2] < 0.01


# --- the bound


@pytest.mark.parametrize("name", ["alley", "gauntlet"])
def test_level_game_is_sharper_where_radars_cannot_be_avoided(name: str) -> None:
    scenario = load_scenario(name)
    clocks, game = success_bound(scenario, max_work=0), success_bound(scenario, max_work=1e7)
    assert clocks.method == "independent clocks"
    assert game.method == "level game"
    assert game.value < clocks.value - 0.02
    assert "(level game)" in str(game)
    assert game.seconds > 0
    assert game.as_dict()["method"] == "level game"


@pytest.mark.slow
def test_level_game_reaches_known_bounds() -> None:
    assert success_bound(ALLEY, max_work=1.5e8).value < 0.78
    assert success_bound(load_scenario("barricade"), max_work=1.5e8).value < 0.70


def test_level_game_with_members_out_of_reach_and_groups() -> None:
    far = [*ALLEY.positions.tolist(), (-60.0, 0.0)]
    with_far = ALLEY.with_values({"swarm.positions": far})
    bounds = [success_bound(s, 50_000, max_work=1e6).value for s in (ALLEY, with_far)]
    assert bounds[0] <= bounds[1] <= 1
    many = ALLEY.with_values({"swarm.positions": ALLEY.positions.tolist() * 2})
    game = success_bound(many, 50_000, max_work=1e6)
    assert game.method == "level game"
    # more members in each group than alone, each among nine others that are never lost
    assert success_bound(ALLEY, 50_000, max_work=1e6).value < game.value < 1


def test_groups_multiply_failures() -> None:
    many = ALLEY.with_values({"swarm.positions": ALLEY.positions.tolist() * 2})
    levels = potential(many, 1.2, 0.5)
    groups = [np.arange(5), np.arange(5, 10)]
    one, other = (1 - LevelGame(levels, 1, tuple(group.tolist())).value() for group in groups)
    assert _product(levels, groups, 1) == pytest.approx(1 - one * other, abs=1e-11)


def test_few_members_use_more_work() -> None:
    pair = ALLEY.with_values({"swarm.positions": ALLEY.positions[:2].tolist()})
    bounds = [success_bound(pair, 50_000, max_work=work, accuracy=0).value for work in (1e5, 1e7)]
    assert bounds[1] < bounds[0] - 0.002


@pytest.mark.slow
@pytest.mark.parametrize("name", ["gauntlet", "alley"])
def test_more_work_than_by_default_is_not_worse(name: str) -> None:
    scenario = load_scenario(name)
    assert success_bound(scenario, max_work=1.5e8).value <= success_bound(scenario).value


@pytest.mark.parametrize("intercept", [0.0, 0.3])
def test_game_of_rates_that_do_not_grow_proves_nothing(intercept: float) -> None:
    class Flat(Saturation):
        """Its rates may be the same everywhere."""

        def single_agent_lower_bound(self, lower: Array, upper: Array) -> Array:
            return Saturation(self.radars).single_agent_lower_bound(lower, upper)

        def least_rate(self, n: int) -> LeastRate:  # noqa: ARG002
            return LeastRate(np.array([intercept]), np.zeros(1))

    scenario = small([(0.0, 0.0)] * 2, (2.0, 0.0), [(1.0, 0.3)], 4)
    task = replace(Relaxation.from_scenario(scenario), hazard=Flat([(1.0, 0.3)]))
    assert game_bound(task, scenario.positions, 0.0, Effort(100_000, 1e6, 0.0, math.inf)).value == 1


def test_time_limit_is_reported() -> None:
    bound = success_bound(ALLEY, 50_000, max_work=1e7, time_limit=0.0)
    assert bound.limited
    assert success_bound(ALLEY, 50_000, max_work=1e7, time_limit=1e9).limited is False
    again = success_bound(ALLEY, 50_000, max_work=1e7, time_limit=0.0)
    assert again is not bound  # it is not cached: there may be more time
    assert bound.value <= success_bound(ALLEY, 50_000, max_work=0).value
