"""The compiled random numbers are those of `uniforms`, bit by bit."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from casswarm.chain import uniforms, write_uniforms

WORD = 2**64 - 1


@given(
    seed=st.integers(0, WORD),
    step=st.integers(0, 10_000),
    run=st.integers(0, 2**60),
    members=st.integers(1, 17),
)
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
