"""Kernels and generated modules: compiled once, kept on disk."""

import numba
import numpy as np
import pytest
from compiled_module import TEXT, run_compiled

from casswarm.compiled import cache_folder, contiguous, generated_module


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
