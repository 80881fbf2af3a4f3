"""Kernels and generated modules: compiled once, kept on disk."""

import os
import subprocess
import sys

from casswarm._util.jit import cache_folder, generated_module

TEXT = '''
@kernel
def twice(x):
    """A function of its own, so that its cache is."""
    return 2.0 * x
'''


def test_a_module_is_made_of_its_texts_and_only_once():
    module = generated_module(TEXT + "answer = 42")
    assert module.twice(1.5) == 3.0
    assert module.answer == 42
    assert generated_module(TEXT + "answer = 42") is module


def test_the_cache_folder_can_be_chosen(monkeypatch, tmp_path):
    monkeypatch.setenv("CASSWARM_CACHE", str(tmp_path))
    assert cache_folder() == tmp_path


def run(cache):
    """Solve a little in a process of its own; what it says on standard error."""
    code = (
        "from casswarm._util.jit import generated_module\n"
        f"module = generated_module({TEXT!r})\n"
        "assert module.twice(2.0) == 4.0\n"
        "print(sum(module.twice.stats.cache_hits.values()))\n"
    )
    done = subprocess.run(
        [sys.executable, "-W", "error", "-c", code],
        env=os.environ | {"CASSWARM_CACHE": str(cache)},
        capture_output=True,
        text=True,
        check=True,
    )
    return done.stdout.strip(), done.stderr


def test_a_second_process_finds_what_the_first_compiled(tmp_path):
    hits, said = run(tmp_path)
    assert hits == "0"
    assert "compiling" in said
    hits, said = run(tmp_path)
    assert hits == "1"
    assert not said


def test_a_compilation_that_was_interrupted_is_announced_again(tmp_path):
    run(tmp_path)
    for index in tmp_path.glob("__pycache__/*.nbi"):
        index.unlink()
    assert "compiling" in run(tmp_path)[1]


def test_a_folder_that_cannot_be_written_costs_time_only(tmp_path):
    (tmp_path / "file").write_text("in the way")
    hits, said = run(tmp_path / "file")
    assert hits == "0"
    assert "this process only" in said


def test_a_changed_file_in_the_cache_is_written_again(tmp_path):
    run(tmp_path)
    (path,) = tmp_path.glob("*.py")
    text = path.read_text()
    path.write_text("raise SystemExit('not mine')")
    run(tmp_path)
    assert path.read_text() == text
