"""The hypotheses of the level game's theorem hold between the nodes, in games of all kinds."""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass
from types import SimpleNamespace

import numpy as np
import pytest
from small_scenarios import Array

from casswarm import Saturation, SaturationCollision
from casswarm.bounds.level_game import LevelGame


@dataclass
class Case:
    """A game of random rates, levels, slope and grid, from coarse to extreme."""

    rng: np.random.Generator

    def __post_init__(self) -> None:
        rng = self.rng
        self.members, self.cells = int(rng.integers(1, 4)), int(rng.integers(1, 4))
        self.others = int(rng.choice([0, 0, 1, 2]))
        self.drop = float(10 ** rng.uniform(-1.5, 0.8))
        self.top = self.drop * rng.uniform(0.3, 3.0 if self.members == 3 else 5.0)
        self.slope, self.spacing = 10 ** rng.uniform(-1.5, 1.5), 10 ** rng.uniform(-3, 0)
        alphas = {"alpha_2": 10 ** rng.uniform(-1, 3), "alpha_3": 10 ** rng.uniform(-1, 2)}
        betas = {"beta_1": 10 ** rng.uniform(-2, 0.5), "beta_2": rng.uniform(1, 8)}
        collides = rng.random() < 0.5
        at = [(0.0, 0.0)]
        self.hazard = (
            SaturationCollision(at, **alphas, **betas) if collides else Saturation(at, **alphas)
        )
        total = self.members + self.others
        task = SimpleNamespace(hazard=self.hazard, dt=1.0, steps=10)
        potential = SimpleNamespace(task=task, largest=self.drop, slack=0.0)
        potential.starts = np.zeros((total, 2))
        potential.start_levels = np.full(total, self.top)
        potential.least_squared_distance = self.least_squared_distance
        players = tuple(range(self.members))
        self.game = LevelGame(potential, self.cells, players)  # type: ignore[arg-type]

    def least_squared_distance(self, gaps: Array) -> Array:
        return np.maximum(0.0, (gaps / self.slope) ** 2 - 0.5 * self.spacing**2)

    def expected(self, before: Array, after: Array) -> float:
        """Mean value of the survivors of a move, with survival as in the theorem."""
        survival = []
        for i, drop in enumerate(before - after):
            gaps = np.maximum(np.delete(after, i) - after[i], 0.0)
            squared = self.least_squared_distance(gaps)
            near = np.where(squared > 0, self.hazard.density_bound(squared), 1.0)
            density = np.array([self.others + np.minimum(near, 1.0).sum()])
            total = self.members + self.others
            risk = self.hazard.least_rates(total, density, np.array([drop]))
            assert risk is not None
            survival.append(math.exp(-risk[0, 0]) if drop > 0 else 1.0)
        p = np.array(survival)
        return sum(
            float(np.prod(np.where(alive, p, 1 - p))) * self.game.at(after[np.array(alive)])
            for alive in itertools.product((False, True), repeat=self.members)
        )

    def move(self) -> tuple[Array, Array]:
        """Levels before and after a random move, many of them in the lowest cell."""
        rng, n, g = self.rng, self.members, self.game.spacing
        before = rng.uniform(0, self.top, n)
        low = rng.random(n) < rng.choice([0.2, 0.8])
        before[low] = rng.uniform(0, min(g, self.top), low.sum())
        drops = rng.uniform(0, rng.choice([self.drop, min(g, self.drop)]), n)
        drops *= rng.random(n) < 0.7
        return before, np.maximum(before - drops, rng.choice([0.0, 1e-9 * g]))


def excess(case: Case, moves: int) -> float:
    """Largest excess of the mean value after a move over that before, climbed from random moves."""
    worst = -math.inf
    for _ in range(moves):
        before, after = case.move()
        found = case.expected(before, after) / case.game.at(before) - 1
        for _ in range(8):
            step = 0.2 * case.game.spacing * case.rng.normal(size=(2, case.members))
            near = np.clip(before + step[0], 1e-9, case.top)
            there = np.clip(after + step[1], np.maximum(near - case.drop, 0), near)
            trial = case.expected(near, there) / case.game.at(near) - 1
            if trial > found:
                before, after, found = near, there, trial
        worst = max(worst, found)
    return worst


def check(seed: int, games: int, moves: int) -> list[float]:
    """Check the three hypotheses; the largest value of each game."""
    rng, largest = np.random.default_rng(seed), []
    for _ in range(games):
        case = Case(rng)
        assert excess(case, moves) <= 1e-12
        values = case.game.node_values
        for _ in range(moves):  # a loss does not raise the value, not even near level 0
            levels, _ = case.move()
            levels[rng.random(case.members) < 0.3] = 0.0
            value = case.game.at(levels)
            for i in range(case.members):
                assert case.game.at(np.delete(levels, i)) <= value * (1 + 1e-12)
            if (levels == 0).any():
                assert value >= max(1.0, values[-2].max()) * (1 - 1e-12)
        largest.append(float(max(part.max() for part in values[:-1])))
    return largest


def test_value_is_a_supersolution_between_nodes() -> None:
    largest = check(0, 30, 4)
    assert max(largest) > 1.01  # corrections do exceed 1, so the value at level 0 matters


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(1, 5))
def test_value_is_a_supersolution_in_many_games(seed: int) -> None:
    check(seed, 60, 20)
