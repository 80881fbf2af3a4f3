"""Kernels and generated modules: compiled once, kept on disk, run over rows on threads."""

import threading

import numba
import numpy as np
import pytest
from compiled_module import TEXT, run_compiled
from hypothesis import given
from hypothesis import strategies as st

from casswarm.compiled import cache_folder, contiguous, execute, generated_module
from casswarm.compiled import parallel as kernel_threads


def test_generated_module_of_same_text_is_loaded_once():
    module = generated_module(TEXT)
    assert module.call(module.square, np.array([3.0])) == 9.0
    assert generated_module(TEXT) is module


def test_cache_folder_follows_environment(monkeypatch, tmp_path):
    monkeypatch.setenv("CASSWARM_CACHE", str(tmp_path))
    assert cache_folder() == tmp_path


def test_kernel_that_allocates_is_refused():
    module = generated_module("@kernel\ndef zeros(n):\n    return np.zeros(n)[0]\n")
    with pytest.raises(numba.TypingError):
        module.zeros(3)


@pytest.mark.parametrize(
    "array", [np.broadcast_to(1.0, (2, 3)), np.ones((3, 2)).T, np.ones((2, 6))[:, ::2]]
)
def test_contiguous_array_is_writable_and_equal(array):
    result = contiguous(array)
    assert result.flags.c_contiguous
    assert result.flags.writeable
    np.testing.assert_array_equal(result, array)


@pytest.mark.slow
def test_second_process_uses_compiled_code_of_first(tmp_path):
    hits, messages = run_compiled(tmp_path)
    assert hits == "0 0"
    assert "compiling" in messages
    hits, messages = run_compiled(tmp_path)
    assert hits == "1 1"
    assert not messages


@pytest.mark.slow
def test_interrupted_compilation_is_announced_again(tmp_path):
    run_compiled(tmp_path)
    for index in tmp_path.glob("__pycache__/*.nbi"):
        index.unlink()
    assert "compiling" in run_compiled(tmp_path)[1]


@pytest.mark.slow
def test_unwritable_cache_folder_is_replaced_by_temporary_one(tmp_path):
    (tmp_path / "file").write_text("in the way")
    hits, messages = run_compiled(tmp_path / "file")
    assert hits == "0 0"
    assert "this process only" in messages


@pytest.mark.slow
def test_changed_file_in_cache_is_written_again(tmp_path):
    run_compiled(tmp_path)
    (path,) = tmp_path.glob("*.py")
    text = path.read_text()
    path.write_text("raise SystemExit('not mine')")
    run_compiled(tmp_path)
    assert path.read_text() == text


# --- kernels over rows on threads


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
