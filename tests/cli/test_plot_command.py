"""casswarm plot as a user runs it, and results folders that are read back."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from commands import PNG, casswarm
from PIL import Image

from casswarm import CheckpointError, evaluate, load_scenario, plan, simulate
from casswarm.figures import save
from casswarm.results import ResultsFolder
from casswarm.results.folder import pack
from casswarm.studies.tables import distribution_table

RESULTS = Path("results")
FEW = "--set=guide.iterations=50"
RHO = "formation.rho=0.05,0.1"


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Folder with the results of a small simulation."""
    folder = tmp_path_factory.mktemp("plot")
    options = ("--runs", 30, "--seed", 5, "--save-trajectories", 2, "--quiet")
    policies = ("--policy", "naive", "--policy", "leader")
    casswarm(folder, "simulate", "paper-1", *policies, *options)
    return folder


@pytest.fixture
def simulated(folder, tmp_path):
    """Copy of that folder that a test may change."""
    shutil.copytree(folder / RESULTS, tmp_path / RESULTS)
    return tmp_path / RESULTS / "simulate-paper-1"


def figures(folder):
    return {path.name: path.read_bytes() for path in folder.glob("*.png")}


def test_plot_of_simulate_draws_same_figures(simulated):
    before = figures(simulated)
    assert set(before) == {
        "success.png",
        "differences.png",
        *(
            f"{kind}-{policy}.png"
            for kind in ("run", "formation")
            for policy in ("naive", "leader")
        ),
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
    drawn = ResultsFolder.open(
        tmp_path / "here"
    ).figures()  # what casswarm plot does, in this process
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


@pytest.mark.parametrize(
    ("spoil", "words"),
    [
        (lambda folder: (folder / "run.json").unlink(), "has no run.json"),
        (lambda folder: (folder / "run.json").write_text("{"), "cannot be read"),
        (lambda folder: (folder / "run.json").write_text("[1]"), "of an unknown origin"),
        (lambda folder: (folder / "run.json").write_text('{"command": "fly"}'), "casswarm fly"),
        (lambda folder: (folder / "results.npz").unlink(), "has no results.npz: it was removed"),
        (lambda folder: (folder / "summary.csv").write_text(""), "summary.csv cannot be read"),
        (
            lambda folder: np.savez(folder / "results.npz", json=np.array('{"items": {}}')),
            "saves no trajectories",
        ),
        (lambda folder: (folder / "results.npz").write_text("PK"), "results.npz cannot be read"),
    ],
)
def test_plot_of_damaged_folder_is_refused(simulated, spoil, words):
    spoil(simulated)
    with pytest.raises(CheckpointError, match=words):
        ResultsFolder.open(simulated).figures()


def test_plot_with_wrong_options_is_explained(simulated):
    where = simulated.parent
    assert (
        "is not a folder: expected one written by casswarm plan"
        in casswarm(where, "plot", "nowhere", code=2).stderr
    )
    with pytest.raises(
        CheckpointError, match=r"saved: 0 to 1\. casswarm simulate --save-trajectories 8 saves it"
    ):
        ResultsFolder.open(simulated).figures(7)
    done = casswarm(where, "plot", simulated.name, "--figure", "sucess", code=2)
    assert "did you mean 'success'" in done.stderr


def test_results_folder_returns_objects_equal_to_the_bit(tmp_path):
    scenario = load_scenario("paper-1")
    guide = plan(scenario)
    study = simulate(scenario, ["leader", "constrained"], runs=4, guide=guide, save_trajectories=3)
    distribution = evaluate(scenario, "leader", 0.1, guide=guide)
    written = ResultsFolder.create("simulate", scenario, tmp_path / "here")
    written.write_objects(
        guide=guide, trajectories=study.trajectories, distributions=[distribution]
    )
    written.write_record({}, {})
    folder = ResultsFolder.open(tmp_path / "here")
    assert folder.scenario == scenario
    for name in ("positions", "velocities", "rates"):
        np.testing.assert_array_equal(getattr(folder.guide, name), getattr(guide, name))
    assert folder.guide.solution.as_row() == guide.solution.as_row()
    assert str(folder.guide) == str(guide)
    assert folder.guide.certificate == guide.certificate
    assert list(folder.trajectories) == ["leader", "constrained"]
    for policy, saved in study.trajectories.items():
        for one, other in zip(folder.trajectories[policy], saved, strict=True):
            for name in ("positions", "alive", "leaders"):
                np.testing.assert_array_equal(getattr(one, name), getattr(other, name))
    (again,) = folder.objects["distributions"]
    assert again.success == distribution.success
    pd.testing.assert_frame_equal(distribution_table([again]), distribution_table([distribution]))
    np.testing.assert_array_equal(again.population, distribution.population)
    with pytest.raises(CheckpointError, match=r"no trajectories of 'leder'.*did you mean 'leader'"):
        folder.trajectory("leder")


def test_pack_refuses_objects_of_other_classes():
    with pytest.raises(TypeError, match="not JSON serializable"):
        pack({"scenario": load_scenario("paper-1")})
