"""Expectations over survivors, against sums over all subsets."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from casswarm.problems import subsets


def probability(before: int, after: int, lost: np.ndarray, n: int) -> float:
    """Probability of the survivors `after` given the living `before`, member by member."""
    if after & ~before:
        return 0.0
    factors = [lost[before, i] if not after >> i & 1 else 1 - lost[before, i] for i in range(n)]
    return float(np.prod([f for i, f in enumerate(factors) if before >> i & 1]))


@given(st.integers(1, 5), st.integers(0, 2**32 - 1))
@settings(max_examples=30, deadline=None)
def test_expectations_and_masses_match_sums_over_subsets(n: int, seed: int) -> None:
    rng = np.random.default_rng(seed)
    lost, values, masses = rng.uniform(size=(2**n, n)), rng.normal(size=2**n), rng.random(2**n)
    table = np.zeros((2**n, 2**n))
    for before, after in itertools.product(range(2**n), repeat=2):
        table[before, after] = probability(before, after, lost, n)
    np.testing.assert_allclose(subsets(n).expectations(values, lost), table @ values, atol=1e-13)
    np.testing.assert_allclose(subsets(n).advanced(masses, lost), table.T @ masses, atol=1e-13)


@pytest.mark.parametrize("n", [1, 4, 7])
def test_expectations_without_loss_are_identity(n: int) -> None:
    values = np.random.default_rng(n).random(2**n)
    calm = np.zeros((2**n, n))
    np.testing.assert_array_equal(subsets(n).expectations(values, calm), values)
    np.testing.assert_array_equal(subsets(n).advanced(values, calm), values)


def test_members_are_bits_of_mask() -> None:
    assert subsets(3).members[0b101].tolist() == [True, False, True]
    assert subsets(3).members.sum() == 3 * 4
