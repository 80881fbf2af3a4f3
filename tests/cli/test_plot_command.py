"""casswarm plot as a user runs it."""

from __future__ import annotations

import json
import shutil

import pytest
from commands import PNG, SIMULATION, casswarm
from PIL import Image

from casswarm import CheckpointError
from casswarm.figures import save
from casswarm.results import ResultsFolder

POLICIES = ("naive", "constrained", "leader")
FEW = "--set=guide.iterations=50"
RHO = "formation.rho=0.05,0.1"


@pytest.fixture
def simulated(finished, tmp_path):
    """Copy of the results of a simulation that a test may change."""
    return shutil.copytree(finished(*SIMULATION)[0], tmp_path / "results" / "simulate-paper-1")


def figures(folder):
    return {path.name: path.read_bytes() for path in folder.glob("*.png")}


@pytest.mark.slow
def test_plot_of_simulate_draws_same_figures(simulated):
    before = figures(simulated)
    assert set(before) == {
        "success.png",
        "differences.png",
        *(f"{kind}-{policy}.png" for kind in ("run", "formation") for policy in POLICIES),
    }
    for name in before:
        (simulated / name).unlink()
    done = casswarm(simulated.parent, "plot", simulated.name)
    assert figures(simulated) == before
    assert set(done.stdout.split()) == {f"{simulated.name}/{name}" for name in before}


@pytest.mark.slow
@pytest.mark.parametrize(
    ("command", "names"),
    [
        (
            ("plan", "paper-1", "--map", "--no-certify", "--solver=projected-gradient", FEW),
            {"guide", "cost-to-go", "comparison"},
        ),
        (
            ("evaluate", "paper-1", "--policy", "leader", "--max-states", 30, "--runs", 20),
            {"success", "arrival", "population", "survival"},
        ),
        (
            ("sweep", "paper-1", "--policy=leader", "--runs=5", "--set=n=1,2", f"--set={RHO}"),
            {"over-n", "over-formation-rho", "heat-map"},
        ),
    ],
    ids=["plan", "evaluate", "sweep"],
)
def test_plot_of_other_commands_draws_same_figures(tmp_path, command, names):
    casswarm(tmp_path, *command, "--quiet", "--out", "here")
    before = figures(tmp_path / "here")
    assert set(before) == {f"{name}.png" for name in names}
    drawn = ResultsFolder.open(tmp_path / "here").figures()  # as casswarm plot, in this process
    (tmp_path / "there").mkdir()
    for name, draw in drawn.items():
        save(draw(), tmp_path / "there" / f"{name}.png")
    assert figures(tmp_path / "there") == before


def test_plot_options_choose_run_figure_and_size(simulated):
    where = simulated.parent
    options = ("--run", 1, "--figure", "run-leader", "--width", "column", "--out", "small")
    casswarm(where, "plot", simulated.name, *options, "--dpi", 100)
    with Image.open(where / "small" / "run-leader.png") as image:
        assert image.width == 350
    assert {path.name for path in (where / "small").iterdir()} == {"run-leader.png"}


@pytest.mark.slow
def test_simulate_removes_figures_added_by_plot(simulated):
    where = simulated.parent
    casswarm(where, "plot", simulated.name, "--format", "pdf", "--figure", "success")
    assert "success.pdf" in json.loads((simulated / "run.json").read_text())["files"]
    casswarm(where.parent, "simulate", "paper-1", "--policy", "naive", "--runs", 3, "--quiet")
    assert not (simulated / "success.pdf").exists()
    assert not (simulated / "differences.png").exists()
    assert (simulated / "run-naive.png").read_bytes().startswith(PNG)


def test_plot_with_wrong_options_is_explained(simulated):
    with pytest.raises(
        CheckpointError, match=r"saved: 0 to 4\. casswarm simulate --save-trajectories 8 saves it"
    ):
        ResultsFolder.open(simulated).figures(7)
    done = casswarm(simulated.parent, "plot", simulated.name, "--figure", "sucess", code=2)
    assert "did you mean 'success'" in done.stderr
