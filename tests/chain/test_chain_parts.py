"""Random streams of runs, and the grouping of equal states."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.stats import kstest

from casswarm.chain import Purpose, uniforms, write_uniforms
from casswarm.chain.states import distinct_states

WORD = 2**64 - 1
sizes = st.integers(1, 7)


@given(st.integers(0, 2**64 - 1), st.integers(0, 10**9), sizes, sizes, st.lists(sizes, min_size=1))
@settings(max_examples=60, deadline=None)
def test_uniforms_are_independent_of_batches(
    seed: int, first: int, step: int, members: int, batches: list[int]
) -> None:
    whole = uniforms(seed, step, first, sum(batches), members)
    assert whole.shape == (sum(batches), members)
    starts = first + np.cumsum([0, *batches[:-1]])
    parts = [
        uniforms(seed, step, int(start), size, members)
        for start, size in zip(starts, batches, strict=True)
    ]
    np.testing.assert_array_equal(np.concatenate(parts), whole)


@given(st.integers(0, WORD), st.integers(0, 10_000), st.integers(0, 2**60), st.integers(1, 17))
def test_write_uniforms_of_any_run_equals_uniforms(
    seed: int, step: int, run: int, members: int
) -> None:
    draws = np.empty(members)
    write_uniforms(np.uint64(seed), np.uint64(step), np.uint64(run), draws)
    np.testing.assert_array_equal(draws, uniforms(seed, step, run, 1, members)[0])


@pytest.mark.parametrize("seed", [0, WORD])
def test_write_uniforms_has_the_numbers_of_its_generator(seed: int) -> None:
    draws = np.empty(4)
    write_uniforms(np.uint64(seed), np.uint64(0), np.uint64(0), draws)
    generator = np.random.Generator(np.random.Philox(key=np.array([seed, 0], np.uint64)))
    np.testing.assert_array_equal(draws, generator.random(4))


def test_uniforms_differ_between_runs_steps_seeds_and_purposes() -> None:
    words = (0, 1, 2, 3)
    seeds = (*words, *(low + (high << 32) for low in words for high in (1, 2, 1 << 24)), 2**64 - 1)
    steps = (*range(4), 1 << 30, 1 << 32, 2**56 - 1)
    streams = [
        uniforms(seed, step, 0, 50, 5, purpose)
        for seed in seeds
        for step in steps
        for purpose in Purpose
    ]
    assert len(np.unique(streams)) == np.size(streams)


def test_uniforms_are_uniform_and_uncorrelated() -> None:
    numbers = np.stack([uniforms(3, step, 1000, 4000, 3) for step in range(5)], axis=1)
    assert numbers.min() >= 0
    assert numbers.max() < 1
    assert kstest(numbers.ravel(), "uniform").pvalue > 0.001
    for t, i in np.ndindex(5, 3):
        assert kstest(numbers[:, t, i], "uniform").pvalue > 0.001
    correlation = np.corrcoef(numbers.reshape(4000, 15).T) - np.eye(15)
    assert np.abs(correlation).max() < 5 / np.sqrt(4000)


@given(st.integers(0, 2**32 - 1), st.integers(1, 40), st.integers(1, 3))
@settings(max_examples=100, deadline=None)
def test_distinct_states_groups_exactly_equal_rows(seed: int, rows: int, n: int) -> None:
    rng = np.random.default_rng(seed)
    positions = rng.integers(0, 2, (rows, n, 2)) * np.pi
    alive = rng.random((rows, n)) < 0.5
    first, back = distinct_states(positions, alive)
    np.testing.assert_array_equal(positions[first][back], positions)
    np.testing.assert_array_equal(alive[first][back], alive)
    plain = [(tuple(x.ravel()), tuple(d)) for x, d in zip(positions, alive, strict=True)]
    assert len(first) == len(set(plain))


@pytest.mark.parametrize("apart", [2.0**-52, 1e-300])
def test_distinct_states_separates_last_bits(apart: float) -> None:
    base = 1.0 if apart > 1e-20 else 0.0
    positions = np.array([[[base, 0.0]], [[base + apart, 0.0]], [[base, 0.0]]])
    first, back = distinct_states(positions)
    assert len(first) == 2
    assert back[0] == back[2] != back[1]
