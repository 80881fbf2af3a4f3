"""What fails after the work of a command, and Ctrl-C then, costs neither tables nor record; and
messages say that finished work is saved only where some is.
"""

from __future__ import annotations

import json
import time

import numpy as np
import pytest
from commands import casswarm

from casswarm._util.checkpoint import Checkpoint
from casswarm.cli.common import Failure, reported_errors
from casswarm.errors import FolderError

SIMULATE = ("simulate", "single-agent", "--runs", "5", "--policy", "naive", "--overwrite")
EVALUATE = ("evaluate", "single-agent", "--policy", "naive")


def failing(folder, place, error, *arguments):
    """Output of a command that fails at a place after its work."""
    done = casswarm(folder, *arguments, "--quiet", code=1, failing=(place, error))
    assert done.stderr.count("\n") == 1, done.stderr
    return done


def results(folder):
    """The results folder and its record."""
    (path,) = (folder / "results").iterdir()
    return path, json.loads((path / "run.json").read_text())


@pytest.mark.slow
@pytest.mark.parametrize("arguments", [SIMULATE, EVALUATE], ids=lambda a: a[0])
def test_failing_bound_costs_no_tables_and_no_figures(tmp_path, arguments):
    done = failing(tmp_path, "bound", "memory", *arguments)
    assert "the success bound failed (MemoryError: no room)" in done.stderr
    path, record = results(tmp_path)
    assert record["result"]["success_bound"] is None
    assert set(record["files"]) <= {file.name for file in path.iterdir()}
    assert {"success.png", "results.npz"} <= set(record["files"])
    assert "naive" in done.stdout


@pytest.mark.slow
@pytest.mark.parametrize("arguments", [SIMULATE, EVALUATE], ids=lambda a: a[0])
def test_interrupted_bound_costs_no_tables(tmp_path, arguments):
    done = failing(tmp_path, "bound", "ctrl-c", *arguments)
    path, record = results(tmp_path)
    assert f"interrupted during the success bound: the tables and run.json in {path}" in (
        done.stderr.replace("in results", f"in {tmp_path}/results")
    )
    assert (path / "results.npz").exists()
    assert not list(path.glob("*.png"))
    assert record["result"]["success_bound"] is None


@pytest.mark.slow
@pytest.mark.parametrize(
    "arguments",
    [
        ("plan", "single-agent", "--no-certify"),
        pytest.param(("plan-swarm", "single-agent"), marks=pytest.mark.slow),
        SIMULATE,
        pytest.param(EVALUATE, marks=pytest.mark.slow),
        ("sweep", "single-agent", "--set", "formation.rho=0.1,0.2", "--policy", "naive"),
    ],
    ids=lambda arguments: arguments[0],
)
def test_figures_interrupted_after_record_are_drawn_by_plot(tmp_path, arguments):
    done = failing(tmp_path, "figures", "ctrl-c", *arguments)
    path, record = results(tmp_path)
    assert "interrupted during drawing" in done.stderr
    assert f"casswarm plot {path.relative_to(tmp_path)} draws the figures" in done.stderr
    assert set(record["files"]) <= {file.name for file in path.iterdir()}
    assert not list(path.glob("*.png"))
    casswarm(tmp_path, "plot", path)
    assert list(path.glob("*.png"))


@pytest.mark.slow
def test_error_while_drawing_keeps_comparison(tmp_path):
    options = ("--family", "quick", "--count", "1", "--solver", "spectral")
    failing(tmp_path, "figures", "bug", "compare", *options)
    _, record = results(tmp_path)
    assert {"runs.csv", "summary.csv", "run.json"} <= set(record["files"])
    assert record["result"]["summary"]


@pytest.mark.slow
def test_record_lists_figures_that_were_drawn(tmp_path):
    casswarm(tmp_path, "evaluate", "single-agent", "--policy", "naive", "--json")
    path, record = results(tmp_path)
    assert {file.name for file in path.iterdir()} == set(record["files"])


# --- what is saved


def message(folder, error, since=0.0):
    """Message of a command whose study in a folder fails with an error."""

    def fail():
        with reported_errors() as saved:
            saved.folder, saved.since = folder, since
            raise error

    with pytest.raises(Failure) as caught:
        fail()
    return caught.value.message


def save_record(folder):
    with Checkpoint(folder, {"seed": 1}) as store:
        store.save("batch", {"x": np.zeros(2)})


def full_disk(folder):
    error = FolderError(f"cannot write {folder}")
    error.__cause__ = OSError("no space left on device")
    return error


def test_failure_before_anything_is_saved_does_not_mention_saved_work(tmp_path):
    with Checkpoint(tmp_path, {"seed": 1}):
        pass
    assert message(tmp_path, KeyboardInterrupt()) == "interrupted"
    assert message(None, KeyboardInterrupt()) == "interrupted"
    assert message(tmp_path, full_disk(tmp_path)) == f"cannot write {tmp_path}"
    assert message(tmp_path, OSError(28, "no space")) == "[Errno 28] no space"


def test_failure_after_a_record_says_how_to_continue(tmp_path):
    save_record(tmp_path)
    assert message(tmp_path, KeyboardInterrupt()) == (
        f"interrupted; finished work is saved in {tmp_path}: continue with --resume"
    )
    assert message(tmp_path, full_disk(tmp_path)).endswith(
        f"; finished work is saved in {tmp_path}: free some space, then continue with --resume"
    )


def test_records_of_an_earlier_study_are_not_this_ones_work(tmp_path):
    save_record(tmp_path)
    assert message(tmp_path, KeyboardInterrupt(), time.time() + 60) == "interrupted"
