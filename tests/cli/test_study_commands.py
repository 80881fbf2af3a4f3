"""casswarm simulate, evaluate and sweep as a user runs them."""

import json
from itertools import combinations
from pathlib import Path

import pandas as pd
import pytest
from commands import PNG, SIMULATION, casswarm

CHECKPOINT = "checkpoint"  # folder from which simulate resumes
RESULTS = Path("results") / "simulate-paper-1"
POLICIES = ("naive", "constrained", "leader")
NAIVE = ("simulate", "paper-1", "--policy", "naive")


@pytest.fixture
def simulated(finished):
    """Results folder of a small study, and what was printed."""
    folder, done = finished(*SIMULATION)
    return folder, done.stdout


def test_simulate_prints_success_with_intervals(simulated):
    _, summary, paired, bound = simulated[1].split("\n\n")
    assert bound.startswith("no policy can exceed 0.99")
    rows = [line.split() for line in summary.splitlines()[1:4]]
    assert [row[0] for row in rows] == list(POLICIES)
    for row in rows:
        assert float(row[3]) <= float(row[2]) < float(row[5])
    differences = [line.split() for line in paired.splitlines()[1:4]]
    assert [(row[0], row[2]) for row in differences] == list(combinations(POLICIES, 2))
    for row in differences:
        assert float(row[4]) <= float(row[3]) <= float(row[6])


def test_simulate_notes_counts_that_are_not_zero(simulated):
    counts = pd.read_csv(simulated[0] / "summary.csv").set_index("policy")
    notes = simulated[1].split("\n\n")[1].splitlines()[4:]
    steps = counts.loc["constrained", "infeasible"]
    assert f"constrained: {steps} infeasible steps (no feasible velocity)" in notes
    assert not any(note.startswith("naive") for note in notes)
    assert {"infeasible", "solver_failures", "fallbacks", "saturated"} <= {*counts.columns}


def test_simulate_writes_tables_figures_and_record(simulated):
    results = simulated[0]
    assert {path.name for path in results.iterdir()} == {
        "summary.csv",
        "paired.csv",
        "runs.csv",
        "guide.csv",
        "trajectories.csv",
        "results.npz",
        "success.png",
        "differences.png",
        *(f"{kind}-{policy}.png" for kind in ("run", "formation") for policy in POLICIES),
        "run.json",
        CHECKPOINT,
    }
    runs = pd.read_csv(results / "runs.csv")
    summary = pd.read_csv(results / "summary.csv").set_index("policy")
    assert len(runs) == 3 * 40
    for policy, own in runs.groupby("policy"):
        assert own["success"].sum() == summary["successes"][policy]
    record = json.loads((results / "run.json").read_text())
    assert record["inputs"] == {
        "policies": list(POLICIES),
        "runs": 40,
        "half_width": None,
        "seed": 5,
        "save_trajectories": 5,
        "workers": 1,
        "solver": "auto",
    }


@pytest.mark.slow
def test_second_simulate_removes_files_of_the_first(tmp_path):
    options = ("--runs", 3, "--out", "here", "--quiet")
    casswarm(tmp_path, *NAIVE, *options)
    (tmp_path / "here" / "mine.txt").write_text("not casswarm's")
    casswarm(tmp_path, "simulate", "paper-1", "--policy", "leader", "--format", "pdf", *options)
    assert {path.name for path in (tmp_path / "here").iterdir()} == {
        "mine.txt",
        "run.json",
        "runs.csv",
        "summary.csv",
        "guide.csv",
        "trajectories.csv",
        "results.npz",
        "success.pdf",
        "run-leader.pdf",
        "formation-leader.pdf",
        CHECKPOINT,
    }
    batches = [path.name for path in (tmp_path / "here" / CHECKPOINT).glob("*.npz")]
    assert len(batches) == 1
    assert "leader" in batches[0]
    assert b"/Type3" not in (tmp_path / "here" / "success.pdf").read_bytes()


@pytest.mark.slow
def test_same_seed_with_two_workers_gives_same_files(simulated, tmp_path):
    casswarm(tmp_path, "simulate", "paper-1", "--runs", 40, "--seed", 5, "--workers", 2)
    for name in ("runs.csv", "summary.csv"):
        assert (tmp_path / RESULTS / name).read_bytes() == (simulated[0] / name).read_bytes()


@pytest.mark.slow
def test_another_seed_gives_other_runs(simulated, tmp_path):
    casswarm(tmp_path, *NAIVE, "--runs", 40, "--seed", 6)
    first = pd.read_csv(simulated[0] / "runs.csv").query("policy == 'naive'")
    second = pd.read_csv(tmp_path / RESULTS / "runs.csv")
    assert not (first["steps"].to_numpy() == second["steps"].to_numpy()).all()


@pytest.mark.slow
def test_no_success_is_printed_with_its_upper_bound(tmp_path):
    text = casswarm(tmp_path, *NAIVE, "--runs", 10, "--set", "hazard.alpha_1=400.0").stdout
    row = text.split("\n\n")[1].splitlines()[-1].split()
    assert row[:5] == ["naive", "10", "0", "(<=", "0.278)"]


@pytest.mark.slow
def test_settings_reach_the_simulation(tmp_path):
    done = casswarm(tmp_path, *NAIVE, "--runs", 10, "--set", "hazard.alpha_1=1e-6", "--json")
    assert json.loads(done.stdout)["result"]["summary"][0]["successes"] == 10


@pytest.mark.slow
def test_half_width_chooses_the_number_of_runs(tmp_path):
    done = casswarm(tmp_path, *NAIVE, "--half-width", 0.1, "--json")
    runs = json.loads(done.stdout)["inputs"]["runs"]
    assert 50 < runs < 150
    assert f"pilot study: {runs} runs per policy needed" in done.stderr


@pytest.mark.slow
def test_named_solver_is_used(tmp_path):
    options = ("--runs", 3, "--policy", "leader", "--solver", "spectral", "--json")
    done = casswarm(tmp_path, "simulate", "paper-1", *options)
    assert json.loads(done.stdout)["inputs"]["solver"] == "spectral"


@pytest.mark.slow
@pytest.mark.parametrize(
    "address",
    ["foo", pytest.param("tcp://127.0.0.1:9", marks=pytest.mark.slow)],  # it waits ten seconds
)
def test_dask_address_without_scheduler_is_one_line(tmp_path, address):
    options = ("--runs", 3, "--policy", "naive", "--quiet", "--dask", address)
    done = casswarm(tmp_path, "simulate", "single-agent", *options, code=1)
    assert done.stderr.startswith(f"Error: no Dask scheduler answers at {address}: ")
    assert done.stderr.count("\n") == 1


# --- evaluate


@pytest.mark.slow
def test_evaluate_bounds_every_policy_and_writes_tables(tmp_path):
    done = casswarm(
        tmp_path, "evaluate", "paper-1", "--policy", "naive", "--policy", "leader", "--quiet"
    )
    results = tmp_path / "results" / "evaluate-paper-1"
    laws = pd.read_csv(results / "distributions.csv")
    assert list(laws["policy"]) == ["naive", "leader"]
    assert ((laws["success_high"] - laws["success_low"]).between(0, 1e-3)).all()
    # the paper's 50 runs, Wilson 95 %: 0.32 and 0.68
    assert 0.208 < laws["success_low"][0] < laws["success_high"][0] < 0.458
    assert 0.542 < laws["success_low"][1] < laws["success_high"][1] < 0.792
    assert f"{laws['success_low'][0]:.6f} to" in done.stdout
    assert (results / "arrival.png").read_bytes().startswith(PNG)
    arrival = pd.read_csv(results / "arrival.csv")
    assert arrival["leader"].sum() == pytest.approx(laws["success_low"][1], rel=1e-9)


@pytest.mark.slow
def test_evaluate_with_few_states_gives_advice(tmp_path):
    done = casswarm(
        tmp_path, "evaluate", "paper-1", "--policy", "leader", "--max-states", "10", "--quiet"
    )
    assert "allow more states (--max-states" in " ".join(done.stdout.split())


@pytest.mark.slow
def test_evaluate_with_runs_samples_residual_mass(tmp_path):
    options = ("--policy", "leader", "--max-states", 100, "--runs", 50)
    done = casswarm(tmp_path, "evaluate", "paper-1", *options)
    assert "with 95% confidence; proven bounds:" in " ".join(done.stdout.split())
    estimate = pd.read_csv(tmp_path / "results" / "evaluate-paper-1" / "estimates.csv").iloc[0]
    assert estimate["enumerated_low"] <= estimate["success_low"] < estimate["success_high"]
    assert estimate["success_high"] <= estimate["enumerated_high"]


# --- sweep


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
