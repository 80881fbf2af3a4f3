"""Options that would have no effect are refused at once, and --no-figures has its effect."""

from __future__ import annotations

import pytest
from commands import casswarm

REFUSED = [
    (("plan", "--no-certify", "--gap", "0.1"), "--gap does not apply: no bound is computed"),
    (("plan", "--verbose", "--quiet"), "--quiet does not apply"),
    (("plan", "--no-figures", "--dpi", "100"), "--dpi does not apply: nothing is drawn"),
    (("evaluate", "--seed", "3"), "--seed does not apply: nothing is sampled without --runs"),
    (("sweep", "--set", "n=1,2", "--seed", "0"), "--seed does not apply"),
    (
        ("sweep", "--set", "n=1,2", "--runs", "3", "--tolerance", "0.1", "--max-states", "9"),
        "--tolerance, --max-states do not apply: nothing is enumerated with --runs",
    ),
    (
        ("simulate", "--policy-time-limit", "3"),
        "--policy-time-limit does not apply: no policy is your own",
    ),
    (
        ("simulate", "--solver", "projected-gradient", "--arrival", "any"),
        "--arrival does not apply: projected-gradient starts from the straight line",
    ),
    (("simulate", "--report", "--no-figures"), "--report and --no-figures: give one of them"),
    (("simulate", "--dask", "tcp://127.0.0.1:9", "--workers", "2"), "--workers does not apply"),
]
DRAWING = [
    ("plan", "single-agent", "--no-certify"),
    ("plan-swarm", "single-agent"),
    ("simulate", "single-agent", "--runs", "3", "--policy", "naive"),
    ("evaluate", "single-agent", "--policy", "naive"),
    ("sweep", "single-agent", "--set", "formation.rho=0.1,0.2", "--policy", "naive"),
    pytest.param(
        ("compare", "--family", "quick", "--count", "1", "--solver", "spectral"),
        marks=pytest.mark.slow,
    ),
]


@pytest.mark.parametrize(("arguments", "message"), REFUSED, ids=[" ".join(a) for a, _ in REFUSED])
def test_option_without_effect_is_refused(tmp_path, arguments, message):
    command, *options = arguments
    done = casswarm(tmp_path, command, "single-agent", *options, code=2)
    assert f"Error: {message}" in done.stderr
    assert not list(tmp_path.iterdir())


def test_reproduce_of_figures_without_figures_is_refused(tmp_path):
    done = casswarm(tmp_path, "reproduce", "--only", "figures", "--no-figures", code=2)
    assert "--only figures and --no-figures: give one of them" in done.stderr


@pytest.mark.parametrize("arguments", DRAWING, ids=lambda a: a[0])
def test_command_without_figures_draws_none_and_plot_draws_them(tmp_path, arguments):
    done = casswarm(tmp_path, *arguments, "--no-figures")
    assert "drawing" not in done.stderr
    (folder,) = (tmp_path / "results").iterdir()
    assert (folder / "run.json").exists()
    assert not list(folder.glob("*.png"))
    casswarm(tmp_path, "plot", folder)
    assert list(folder.glob("*.png"))
