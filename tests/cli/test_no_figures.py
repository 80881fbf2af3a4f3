"""--no-figures has its effect."""

from __future__ import annotations

import pytest
from commands import casswarm

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


@pytest.mark.parametrize("arguments", DRAWING, ids=lambda a: a[0])
def test_command_without_figures_draws_none_and_plot_draws_them(tmp_path, arguments):
    done = casswarm(tmp_path, *arguments, "--no-figures")
    assert "drawing" not in done.stderr
    (folder,) = (tmp_path / "results").iterdir()
    assert (folder / "run.json").exists()
    assert not list(folder.glob("*.png"))
    casswarm(tmp_path, "plot", folder)
    assert list(folder.glob("*.png"))
