"""casswarm evaluate as a user runs it."""

import pandas as pd
import pytest
from commands import PNG, casswarm


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


def test_lattice_on_which_members_cannot_move_is_refused(tmp_path):
    done = casswarm(tmp_path, "evaluate", "single-agent", "--aggregation-tol", "1", code=2)
    assert "aggregation_tol = 1; allowed: 0, or from" in done.stderr
    assert "Traceback" not in done.stderr
