"""Potentials and the level game: their properties, known answers, and policies below the bound."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from small_scenarios import DT, V_MAX, Array, small
from test_success_bound import adversary, some_scenario

from casswarm import Saturation, SaturationCollision, Scenario, load_scenario, success_bound
from casswarm.bounds import PotentialFamily
from casswarm.bounds.level_game import Effort, LevelGame, Potential, _product, game_bound
from casswarm.bounds.level_game_kernels import fill_levels
from casswarm.grid import Relaxation
from casswarm.hazard.rate_bounds import LeastRate
from casswarm.joint import PlanDistribution

ALLEY = load_scenario("alley")


def potential(scenario: Scenario, slope: float, largest: float, nodes: int = 100_000) -> Potential:
    task = Relaxation.from_scenario(scenario)
    return PotentialFamily(task, scenario.positions, nodes, 0.5).potential(slope, largest)


# --- rates by density


@pytest.mark.parametrize("collides", [False, True])
def test_least_rates_are_below_rates_of_formations(collides: bool) -> None:
    rng = np.random.default_rng(collides)
    radars = [(-1.0, 2.0), (2.0, 0.5)]
    hazard = SaturationCollision(radars, beta_2=4.0) if collides else Saturation(radars)
    tightest = np.inf
    for _ in range(60):
        n = int(rng.integers(2, 6))
        x = rng.uniform(-3, 3, 2) + 10 ** rng.uniform(-2, 0.5) * rng.normal(size=(n, 2))
        squared = ((x[:, None] - x) ** 2).sum(axis=-1)
        densities = hazard.density_bound(squared).sum(axis=1) - 1
        rates, single = hazard.rates(x), hazard.single_agent_rates(x)
        least = hazard.least_rates(n, densities, single)
        all_densities = hazard.least_rate(n)
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


def test_level_game_is_the_same_for_images() -> None:
    turned = ALLEY.with_values(
        {
            "swarm.positions": [(-y, x) for x, y in ALLEY.positions[::-1].tolist()],
            "target.center": (0.0, 12.0),
            "hazard.radars": [(-y, x) for x, y in ALLEY.hazard.radar_positions[::-1].tolist()],
        }
    )
    bounds = [success_bound(scenario, 50_000, max_work=1e6) for scenario in (ALLEY, turned)]
    assert bounds[0].value == pytest.approx(bounds[1].value, abs=1e-9)


def test_level_game_is_monotone_in_rates() -> None:
    values = [
        success_bound(ALLEY.with_values({"hazard.alpha_1": alpha}), 100_000, max_work=3e6).value
        for alpha in (2.0, 3.0, 4.0)
    ]
    assert values[0] > values[1] > values[2]


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


def test_infinite_work_raises() -> None:
    with pytest.raises(ValueError, match="max_work = inf; allowed: finite numbers"):
        success_bound(ALLEY, max_work=math.inf)


def test_time_limit_is_reported() -> None:
    bound = success_bound(ALLEY, 50_000, max_work=1e7, time_limit=0.0)
    assert bound.limited
    assert success_bound(ALLEY, 50_000, max_work=1e7, time_limit=1e9).limited is False
    again = success_bound(ALLEY, 50_000, max_work=1e7, time_limit=0.0)
    assert again is not bound  # it is not cached: there may be more time
    assert bound.value <= success_bound(ALLEY, 50_000, max_work=0).value


@pytest.mark.parametrize("option", ["max_work", "accuracy", "time_limit"])
def test_negative_options_raise(option: str) -> None:
    with pytest.raises(ValueError, match=f"{option} = -1; allowed: numbers from 0"):
        success_bound(ALLEY, **{option: -1})  # type: ignore[arg-type]


def climbed(scenario: Scenario, rng: np.random.Generator, trials: int) -> float:
    """Exact success of an open-loop plan after random improvements."""
    reach = 0.9999999 * DT * V_MAX
    path: Array = adversary(scenario, rng)
    best, scale = PlanDistribution.from_positions(scenario, path).success[0], 0.3
    for _ in range(trials):
        velocities = np.diff(path, axis=0)
        together = rng.random() < 0.5
        shape = (len(velocities), 1 if together else scenario.n, 1)
        changed = rng.random(shape) < 0.5
        velocities += scale * reach * rng.normal(size=velocities.shape) * changed
        velocities = np.clip(velocities, -reach, reach)
        trial = np.concatenate([path[:1], path[0] + np.cumsum(velocities, axis=0)])
        success = PlanDistribution.from_positions(scenario, trial).success[0]
        if success > best:
            path, best = trial, success
        else:
            scale = max(0.01, 0.97 * scale)
    return best


def attack(seed: int, trials: int) -> None:
    rng = np.random.default_rng(seed)
    scenario = some_scenario(rng, int(rng.integers(2, 5)), int(rng.integers(1, 9)), seed % 3 == 0)
    factor = float(rng.choice([0.5, 1, 2, 4, 8]))
    scenario = scenario.with_values({"hazard.alpha_1": factor * scenario.hazard.alpha_1})
    bound = success_bound(scenario, 20_000, max_work=float(rng.choice([1e5, 1e6])), accuracy=0.0)
    best = max(climbed(scenario, rng, trials) for _ in range(2))
    assert best <= bound.value


@pytest.mark.parametrize("seed", range(4))
def test_no_plan_exceeds_the_bound(seed: int) -> None:
    attack(seed, 30)


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(4, 100))
def test_no_climbed_plan_exceeds_the_bound(seed: int) -> None:
    attack(seed, 150)


def test_all_risk_in_one_step_is_attained() -> None:
    """Three members in one place, one step: the clocks are exact, and the game is not below."""
    scenario = small([(0.0, 0.0)] * 3, (0.9, 0.0), [(4.0, 0.3)], 1, swarm__a_max=100.0)
    bound = success_bound(scenario, 1_000_000, max_work=1e7)
    clocks = success_bound(scenario, 1_000_000, max_work=0)
    assert bound.value == clocks.value
