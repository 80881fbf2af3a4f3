"""casswarm sweep as a user runs it."""

import pandas as pd
import pytest
from commands import PNG, casswarm


@pytest.mark.slow
def test_sweep_command_draws_lines_and_heat_map(tmp_path):
    grid = ("--set", "hazard.alpha_1=1:100:3:log", "--set", "n=1,2")
    done = casswarm(tmp_path, "sweep", "paper-1", *grid, "--policy", "naive", "--tolerance", 0.01)
    folder = tmp_path / "results" / "sweep-paper-1"
    for name in ("over-hazard-alpha_1.png", "over-n.png", "heat-map.png"):
        assert (folder / name).read_bytes().startswith(PNG)
    table = pd.read_csv(folder / "sweep.csv")
    assert table["hazard.alpha_1"].tolist() == [1.0, 1.0, 10.0, 10.0, 100.0, 100.0]
    assert table["n"].tolist() == [1, 2] * 3
    assert (table["success_high"] - table["success_low"]).max() <= 0.01
    assert "bounds" in done.stdout


def test_sweep_command_without_success_fails(tmp_path):
    done = casswarm(
        tmp_path, "sweep", "paper-1", "--set", "formation.rho=-1,-2", "--policy", "naive", code=1
    )
    assert "every sweep point failed" in done.stderr
    assert "formation.rho is -2" in " ".join(done.stdout.split())
    assert (tmp_path / "results" / "sweep-paper-1" / "sweep.csv").exists()


@pytest.mark.slow
def test_sweep_command_without_scheduler_is_explained(tmp_path):
    pytest.importorskip("distributed")
    options = ("--set", "n=1", "--runs", 2, "--dask", "tcp://127.0.0.1:1")
    assert "Dask" in casswarm(tmp_path, "sweep", "paper-1", *options, code=1).stderr
