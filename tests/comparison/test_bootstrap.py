"""Bootstrap of problems: known answers, invariances, and coverage on synthetic data."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import binom, norm

from casswarm.comparison.profiles import (
    cluster_means,
    fraction_band,
    rank_probabilities,
    ranks,
    resampled_means,
)


def test_cluster_means_keep_order_of_appearance() -> None:
    values = [[1.0, 0.0], [5.0, 1.0], [3.0, 1.0]]
    assert cluster_means(values, ["q", "p", "q"]).tolist() == [[2.0, 0.5], [5.0, 1.0]]


def test_resampled_means_have_the_standard_error_of_the_mean() -> None:
    values = np.random.default_rng(1).normal(size=(50, 1))
    drawn = resampled_means(values, resamples=4000)
    assert drawn.mean() == pytest.approx(values.mean(), abs=0.01)
    error = values.std(ddof=1) / np.sqrt(50)
    assert drawn.std() == pytest.approx(error * np.sqrt(49 / 47), rel=0.05)  # of Student's t


def test_resampled_means_depend_on_seed_only_and_need_two_clusters_of_a_stratum() -> None:
    values = np.arange(6.0)[:, None]
    np.testing.assert_array_equal(resampled_means(values), resampled_means(values))
    assert not np.array_equal(resampled_means(values), resampled_means(values, seed=1))
    np.testing.assert_allclose(resampled_means(np.full((6, 2), 0.3)), 0.3, rtol=1e-14)  # constant
    with pytest.raises(ValueError, match="single cluster"):
        resampled_means(np.zeros((3, 1)), ["a", "a", "b"])


def test_resampled_means_do_not_vary_between_strata() -> None:
    rng = np.random.default_rng(2)
    strata = np.repeat(["a", "b", "c"], 4)
    values = rng.normal(size=(12, 1))
    shifted = values + np.repeat([0.0, 100.0, -7.0], 4)[:, None]
    plain, moved = (resampled_means(v, strata) - v.mean(axis=0) for v in (values, shifted))
    np.testing.assert_allclose(moved, plain, atol=1e-10)
    assert resampled_means(shifted).std() > 10 * moved.std()


SAMPLES = {
    "normal": (lambda rng, size: rng.normal(size=size), 0.0),
    "skewed": (lambda rng, size: rng.exponential(size=size), 1.0),
    # logarithms of times: 0.02 s with noise, and 30 % failures at 2 s
    "failing": (
        lambda rng, size: np.where(
            rng.random(size) < 0.3, np.log(2), np.log(0.02) + 0.5 * rng.normal(size=size)
        ),
        0.3 * np.log(2) + 0.7 * np.log(0.02),
    ),
}


def _coverage(kind: str, strata: np.ndarray, repetitions: int = 400) -> float:
    """How often the 95 % interval of the mean covers it; strata differ by a known shift."""
    sample, mean = SAMPLES[kind]
    rng = np.random.default_rng([9, len(strata)])
    covered = 0
    for number in range(repetitions):
        values = (strata + sample(rng, len(strata)))[:, None]
        drawn = resampled_means(values, strata, resamples=500, seed=number)
        low, high = np.quantile(drawn, [0.025, 0.975])
        covered += low <= strata.mean() + mean <= high
    return covered / repetitions


@pytest.mark.parametrize("clusters", [4, 9])
def test_interval_of_few_normal_values_covers_their_mean(clusters: int) -> None:
    assert _coverage("normal", np.zeros(clusters)) >= 0.92


@pytest.mark.slow
@pytest.mark.parametrize("kind", SAMPLES)
@pytest.mark.parametrize(
    "strata", [np.zeros(8), np.zeros(36), np.repeat(np.arange(12.0), 3)], ids=["8", "36", "12 x 3"]
)
def test_interval_covers_the_mean_of_skewed_values_and_failures(
    kind: str, strata: np.ndarray
) -> None:
    assert _coverage(kind, strata, 1000) >= (0.87 if kind == "skewed" else 0.91)


# --- bands


@pytest.mark.parametrize(("solved", "count"), [(9, 9), (0, 9), (3, 10), (35, 36)])
def test_fraction_band_of_single_runs_is_the_interval_of_agresti_and_coull(
    solved: int, count: int
) -> None:
    low, high = fraction_band((np.arange(count) < solved)[:, None])
    z = norm.ppf(0.975)
    middle = (solved + z**2 / 2) / (count + z**2)
    width = z * np.sqrt(middle * (1 - middle) / (count + z**2))
    assert (low[0], high[0]) == pytest.approx((max(middle - width, 0), min(middle + width, 1)))


@pytest.mark.parametrize("problems", [9, 10, 36])
def test_fraction_band_of_single_runs_covers_in_exact_calculation(problems: int) -> None:
    solved = np.arange(problems + 1)
    rows = np.arange(problems)[:, None] < solved
    low, high = fraction_band(rows)
    fractions = np.linspace(0.01, 0.99, 99)[:, None]
    covers = (low <= fractions) & (fractions <= high)
    coverage = (binom.pmf(solved, problems, fractions) * covers).sum(axis=1)
    assert coverage.min() >= 0.92
    assert coverage.mean() >= 0.95


def test_fraction_band_contains_the_mean_and_is_monotone() -> None:
    rng = np.random.default_rng(2)
    values = (rng.uniform(size=(15, 1)) <= np.linspace(0, 1, 40)).astype(float)
    low, high = fraction_band(values)
    mean = values.mean(axis=0)
    assert ((low <= mean) & (mean <= high)).all()
    assert (np.diff([low, high]) >= 0).all()
    # Clopper and Pearson: 9 of 9 give 66 % at least, and so no width of zero
    low, high = fraction_band(np.ones((9, 1)))
    assert high[0] == 1.0
    assert 0.55 <= low[0] <= 0.8


def test_fraction_band_shrinks_as_inverse_root_of_problems() -> None:
    half = np.tile([[0.0], [1.0]], (50, 1))
    widths = [np.ptp(fraction_band(np.tile(half, (times, 1)))) for times in (1, 4, 16)]
    assert widths[0] / widths[1] == pytest.approx(2, rel=0.15)
    assert widths[1] / widths[2] == pytest.approx(2, rel=0.15)


def test_fraction_band_is_not_narrowed_by_equal_copies() -> None:
    once = np.random.default_rng(3).integers(0, 2, (20, 3)).astype(float)
    problems = np.arange(20)
    copied = cluster_means(np.repeat(once, 5, axis=0), np.repeat(problems, 5))
    np.testing.assert_array_equal(fraction_band(copied), fraction_band(once))


@pytest.mark.parametrize("fraction", [0.1, 0.5, 0.9])
@pytest.mark.parametrize("problems", [4, 10, 40])
def test_fraction_band_covers_the_truth_nominally(fraction: float, problems: int) -> None:
    """Copies of a problem share its difficulty, as Beta(3 f, 3 (1 - f)): they are dependent."""
    rng = np.random.default_rng([4, problems])
    covered = []
    for _ in range(400):
        chance = rng.beta(3 * fraction, 3 * (1 - fraction), problems)
        solved = rng.binomial(4, chance) / 4
        low, high = fraction_band(solved[:, None])
        covered.append(low[0] <= fraction <= high[0])
    assert 0.91 <= np.mean(covered) <= 1.0


# --- ranks


@pytest.mark.parametrize(
    ("shifts", "probabilities"),
    [
        ([0.0, -0.5], [[0, 1], [1, 0]]),  # one dominates
        ([0.0, 0.0, 1.0], [[0.5, 0.5, 0], [0.5, 0.5, 0], [0, 0, 1]]),  # two are equal
    ],
)
def test_ranks_share_ties_and_have_known_probabilities(
    shifts: list[float], probabilities: list[list[float]]
) -> None:
    assert ranks([[3.0, 1.0, 3.0, 7.0]]).tolist() == [[2.5, 1.0, 2.5, 4.0]]
    scores = np.random.default_rng(6).uniform(1, 2, (12, 1)) + shifts
    np.testing.assert_array_equal(rank_probabilities(resampled_means(scores)), probabilities)


def test_rank_probabilities_of_solvers_equal_in_distribution_average_one_half() -> None:
    rng = np.random.default_rng(7)
    first = [
        rank_probabilities(resampled_means(rng.normal(size=(20, 2)), resamples=200))[0, 0]
        for _ in range(300)
    ]
    assert np.mean(first) == pytest.approx(0.5, abs=0.06)
    assert np.std(first) == pytest.approx(np.sqrt(1 / 12), abs=0.06)  # like uniform p-values


def test_rank_probabilities_sum_to_one_both_ways() -> None:
    held = rank_probabilities(resampled_means(np.random.default_rng(8).normal(size=(9, 5))))
    np.testing.assert_allclose(held.sum(axis=0), 1)
    np.testing.assert_allclose(held.sum(axis=1), 1)
