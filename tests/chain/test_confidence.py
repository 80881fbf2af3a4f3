"""Intervals and tests of paired runs, against published values and simulation."""

from __future__ import annotations

import math
from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import binom, binomtest

from casswarm.chain import Estimate, Paired, required_runs, wilson
from casswarm.chain.confidence import clopper_pearson, effective_runs


def test_paired_interval_matches_literature() -> None:
    """Cavo et al. (2012), as Fagerland, Lydersen and Laake (2017, chapter 8) evaluate it.

    Their R package contingencytables gives -0.1186 to -0.0046.
    """
    pair = Paired(59, 6, 16, 80)
    assert pair.difference == pytest.approx(-0.0621, abs=5e-5)
    assert pair.interval() == pytest.approx((-0.1186, -0.0046), abs=5e-5)


@given(*[st.integers(0, 200)] * 4, st.sampled_from([0.9, 0.95, 0.99]))
def test_paired_interval_contains_difference_and_is_antisymmetric(
    both: int, first: int, second: int, neither: int, level: float
) -> None:
    if both + first + second + neither == 0:
        return
    pair, turned = Paired(both, first, second, neither), Paired(both, second, first, neither)
    low, high = pair.interval(level)
    assert -1 - 1e-12 <= low <= pair.difference <= high <= 1 + 1e-12
    assert turned.interval(level) == pytest.approx((-high, -low), abs=1e-12)
    assert turned.p_value == pytest.approx(pair.p_value)


def test_paired_p_value_is_binomial_test_of_discordant_runs() -> None:
    assert Paired(50, 1, 7, 42).p_value == pytest.approx(2 * (1 + 8) / 2**8)
    assert Paired(50, 0, 0, 42).p_value == 1.0


def test_paired_variance_ratio_matches_formula() -> None:
    """Var(X - Y) / (Var X + Var Y), from the table itself."""
    x = np.repeat([1, 1, 0, 0], [30, 5, 8, 57])
    y = np.repeat([1, 0, 1, 0], [30, 5, 8, 57])
    assert Paired(30, 5, 8, 57).variance_ratio == pytest.approx(
        np.var(x - y) / (np.var(x) + np.var(y))
    )
    assert math.isnan(Paired(9, 0, 0, 0).variance_ratio)


def test_paired_interval_has_nominal_coverage() -> None:
    generator = np.random.default_rng(5)
    p, q, shared = 0.7, 0.6, generator.random((2000, 150))
    wins, others = (shared < p).sum(axis=1), (shared < q).sum(axis=1)
    covered = [
        low <= p - q <= high
        for won, other in zip(wins, others, strict=True)
        for low, high in [Paired(int(other), int(won - other), 0, int(150 - won)).interval()]
    ]
    assert 0.93 <= np.mean(covered) <= 0.99


@pytest.mark.parametrize(("successes", "half_width"), [(500, 0.005), (10, 0.01), (0, 0.01)])
def test_required_runs_reach_half_width(successes: int, half_width: float) -> None:
    runs = required_runs(half_width, successes, 1000)
    low, high = wilson(round(successes / 1000 * runs), runs)
    assert high - low <= 2 * half_width * (1 + 1e-3)
    if successes == 500:  # the worst case: z^2 / (4 h^2)
        assert runs == pytest.approx(1.96**2 / 4 / half_width**2, rel=0.01)
    else:
        assert runs < 1.96**2 / 4 / half_width**2


@pytest.mark.parametrize(("interval", "method"), [(wilson, "wilson"), (clopper_pearson, "exact")])
@pytest.mark.parametrize(("successes", "runs"), [(0, 10), (3, 10), (8, 10), (10, 10), (517, 1000)])
def test_interval_matches_scipy(
    interval: Callable[[int, int], Any], method: str, successes: int, runs: int
) -> None:
    expected = binomtest(successes, runs).proportion_ci(0.95, method=method)
    tolerance = 1e-14 if interval is wilson else 1e-12
    found = interval(successes, runs)
    assert found == pytest.approx((expected.low, expected.high), abs=tolerance)


# --- strata


def test_effective_runs_match_calculation_by_hand() -> None:
    """Ten strata, five that succeed and five that do not: one pair differs, one more is added."""
    outcomes = np.array([True] * 5 + [False] * 5)
    assert effective_runs(outcomes) == pytest.approx(10 * 0.25 / (2 / 10))
    assert effective_runs(np.array([True, False] * 5)) == 10.0  # never fewer than there are
    assert effective_runs(np.ones(7, bool)) == 7.0
    assert effective_runs(np.array([True])) == 1.0


@pytest.mark.parametrize("runs", [50, 401])
def test_stratified_interval_has_nominal_coverage(runs: int) -> None:
    draws, chances = np.random.default_rng(1), np.linspace(0.02, 0.6, runs) ** 2
    covered, narrower = 0, 0.0
    for _ in range(2000):
        outcomes = draws.random(runs) < chances
        effective, mean = effective_runs(outcomes), outcomes.mean()
        low, high = wilson(mean * effective, effective)
        covered += low <= chances.mean() <= high
        narrower += runs / effective
    assert covered >= binom(2000, 0.95).ppf(0.001)
    assert narrower / 2000 < 0.98


def test_clopper_pearson_of_ten_runs_is_known() -> None:
    assert clopper_pearson(1, 10).low == pytest.approx(0.0025)
    assert clopper_pearson(9, 10).high == pytest.approx(0.9975)


@given(
    st.lists(st.floats(0, 1) | st.sampled_from([0.0, 1e-3, 0.999, 1.0]), min_size=1, max_size=60)
)
def test_clopper_pearson_covers_mean_of_different_probabilities(chances: list[float]) -> None:
    """The level is exact: the number of successes has a Poisson binomial distribution."""
    masses = np.ones(1)
    for chance in chances:
        masses = np.convolve(masses, [1 - chance, chance])
    mean, runs = float(np.mean(chances)), len(chances)
    ends = [clopper_pearson(successes, runs) for successes in range(runs + 1)]
    missed = sum(m for m, e in zip(masses, ends, strict=True) if not e.low <= mean <= e.high)
    assert missed <= 0.05 + 1e-9


@pytest.mark.parametrize("runs", [50, 100])
@pytest.mark.parametrize("mean", [0.005, 0.01, 0.02])
@pytest.mark.parametrize("rare", ["success", "failure"])
def test_estimate_of_rare_event_covers_it(runs: int, mean: float, rare: str) -> None:
    draws, chances = np.random.default_rng(3), np.linspace(0.0, 2 * mean, runs)
    nothing: Any = SimpleNamespace(success=(0.0, 1.0))
    covered = 0
    for outcomes in draws.random((2000, runs)) < chances:
        seen = outcomes if rare == "success" else ~outcomes
        estimate = Estimate(nothing, 1.0, 0.0, runs, int(seen.sum()), effective_runs(seen), 0, 1)
        low, high = estimate.success
        covered += low <= (mean if rare == "success" else 1 - mean) <= high
    assert covered >= binom(2000, 0.95).ppf(0.001)
