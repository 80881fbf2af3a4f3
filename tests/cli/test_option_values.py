"""Values of options that make no sense are refused before anything else."""

from __future__ import annotations

import pytest
from commands import casswarm

NUMBERS = [
    ("plan", "--gap"),
    ("plan", "--time-limit"),
    ("plan-swarm", "--min-distance"),
    ("plan-swarm", "--time-limit"),
    ("simulate", "--half-width"),
    ("simulate", "--policy-time-limit"),
    ("evaluate", "--tolerance"),
    ("evaluate", "--aggregation-tol"),
    ("sweep", "--tolerance"),
    ("animate", "--fps"),
]


@pytest.mark.parametrize(("command", "option"), NUMBERS, ids=" ".join)
def test_nan_is_refused(tmp_path, command, option):
    done = casswarm(tmp_path, command, "single-agent", option, "nan", code=2)
    assert f"Invalid value for '{option}': nan is not a finite number." in done.stderr


@pytest.mark.parametrize(
    ("command", "option"),
    [
        ("plan-swarm", "--min-distance"),
        ("evaluate", "--aggregation-tol"),
        ("simulate", "--policy-time-limit"),
    ],
)
def test_infinity_is_refused_where_it_means_nothing(tmp_path, command, option):
    done = casswarm(tmp_path, command, "single-agent", option, "inf", code=2)
    assert "inf is not a finite number." in done.stderr


def test_lattice_on_which_members_cannot_move_is_refused(tmp_path):
    done = casswarm(tmp_path, "evaluate", "single-agent", "--aggregation-tol", "1", code=2)
    assert "aggregation_tol = 1; allowed: 0, or from" in done.stderr
    assert "Traceback" not in done.stderr


@pytest.mark.parametrize("command", ["simulate", "sweep"])
def test_resume_and_overwrite_exclude_each_other(tmp_path, command):
    done = casswarm(tmp_path, command, "single-agent", "--resume", "--overwrite", code=2)
    assert "--resume and --overwrite: give one of them" in done.stderr
    assert not (tmp_path / "results").exists()


@pytest.mark.parametrize(
    "address",
    ["foo", pytest.param("tcp://127.0.0.1:9", marks=pytest.mark.slow)],  # it waits ten seconds
)
def test_dask_address_without_scheduler_is_one_line(tmp_path, address):
    options = ("--runs", 3, "--policy", "naive", "--quiet", "--dask", address)
    done = casswarm(tmp_path, "simulate", "single-agent", *options, code=1)
    assert done.stderr.startswith(f"Error: no Dask scheduler answers at {address}: ")
    assert done.stderr.count("\n") == 1
