"""Kernels over rows on threads: every row once, whatever the number of cores."""

import threading

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from casswarm.compiled import execute, generated_module
from casswarm.compiled import parallel as kernel_threads

MODULE = generated_module("""
@kernel
def add_row(rows, refused, counts):
    for row in range(rows[0], rows[1]):
        if row == refused:
            raise ValueError("a row that is refused")
        counts[row] += row
""")


@given(rows=st.integers(0, 60), cores=st.integers(1, 5), per_thread=st.integers(0, 20))
def test_every_row_is_worked_on_once(rows: int, cores: int, per_thread: int) -> None:
    counts = np.zeros(rows)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(kernel_threads, "_cores", lambda: cores)
        assert execute(MODULE.add_row, rows, (-1, counts), per_thread) >= 0.0
    np.testing.assert_array_equal(counts, np.arange(rows))


@pytest.mark.parametrize("cores", [1, 3])
def test_exception_in_a_thread_is_raised(cores: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(kernel_threads, "_cores", lambda: cores)
    with pytest.raises(ValueError, match="a row that is refused"):
        execute(MODULE.add_row, 40, (31, np.zeros(40)), 2)


@pytest.mark.parametrize(("rows", "used"), [(19, 1), (20, 2)])
def test_few_rows_take_the_calling_thread(
    rows: int, used: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    threads: list[threading.Thread] = []

    def note(part: tuple[int, int]) -> None:
        threads.extend([threading.current_thread()] * (part[1] - part[0]))

    monkeypatch.setattr(kernel_threads, "_cores", lambda: 2)
    monkeypatch.setattr(kernel_threads, "announce", lambda _: None)
    execute(note, rows, (), 10)
    assert len(threads) == rows
    assert (threading.current_thread() in threads) == (used == 1)
