"""Kernels and generated modules: compiled once, kept on disk."""

import os
import subprocess
import sys

import numba
import numpy as np
import pytest

from casswarm._util.jit import cache_folder, contiguous, generated_module

TEXT = """
@objective
def square(x, p, constants, gradient, scratch):
    return x[0] * x[0]


@kernel
def call(function, x):
    return function(x, x, x, x, x)
"""


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


def run(cache):
    """Call a kernel with a function as argument in a process of its own: cache hits, and stderr."""
    code = (
        "import numpy as np\n"
        "from casswarm._util.jit import announce, generated_module\n"
        f"module = generated_module({TEXT!r})\n"
        "announce(module.call)\n"
        "assert module.call(module.square, np.array([2.0])) == 4.0\n"
        "print(sum(module.call.stats.cache_hits.values()), module.square.cache_hits)\n"
    )
    done = subprocess.run(
        [sys.executable, "-W", "error", "-c", code],
        env=os.environ | {"CASSWARM_CACHE": str(cache)},
        capture_output=True,
        text=True,
        check=True,
    )
    return done.stdout.strip(), done.stderr


def test_second_process_uses_compiled_code_of_first(tmp_path):
    hits, messages = run(tmp_path)
    assert hits == "0 0"
    assert "compiling" in messages
    hits, messages = run(tmp_path)
    assert hits == "1 1"
    assert not messages


def test_interrupted_compilation_is_announced_again(tmp_path):
    run(tmp_path)
    for index in tmp_path.glob("__pycache__/*.nbi"):
        index.unlink()
    assert "compiling" in run(tmp_path)[1]


def test_unwritable_cache_folder_is_replaced_by_temporary_one(tmp_path):
    (tmp_path / "file").write_text("in the way")
    hits, messages = run(tmp_path / "file")
    assert hits == "0 0"
    assert "this process only" in messages


def test_changed_file_in_cache_is_written_again(tmp_path):
    run(tmp_path)
    (path,) = tmp_path.glob("*.py")
    text = path.read_text()
    path.write_text("raise SystemExit('not mine')")
    run(tmp_path)
    assert path.read_text() == text
