"""casswarm evaluate, as a user runs it."""

import pandas as pd
import pytest
from commands import PNG, casswarm


def test_evaluate_brackets_every_policy_and_leaves_tables(tmp_path):
    done = casswarm(
        tmp_path, "evaluate", "paper-1", "--policy", "naive", "--policy", "leader", "--quiet"
    )
    results = tmp_path / "results" / "evaluate-paper-1"
    laws = pd.read_csv(results / "laws.csv")
    assert list(laws["policy"]) == ["naive", "leader"]
    assert ((laws["success_high"] - laws["success_low"]).between(0, 1e-3)).all()
    # the paper's 50 runs, Wilson 95 %: 0.32 and 0.68
    assert 0.208 < laws["success_low"][0] < laws["success_high"][0] < 0.458
    assert 0.542 < laws["success_low"][1] < laws["success_high"][1] < 0.792
    assert f"{laws['success_low'][0]:.6f} to" in done.stdout
    assert (results / "arrival.png").read_bytes().startswith(PNG)
    arrival = pd.read_csv(results / "arrival.csv")
    assert arrival["leader"].sum() == pytest.approx(laws["success_low"][1], rel=1e-9)


def test_evaluate_says_when_states_were_too_few(tmp_path):
    done = casswarm(
        tmp_path, "evaluate", "paper-1", "--policy", "leader", "--max-states", "10", "--quiet"
    )
    assert "allow more of them (--max-states" in done.stdout


def test_evaluate_samples_what_the_states_leave(tmp_path):
    done = casswarm(
        tmp_path,
        "evaluate",
        "paper-1",
        "--policy",
        "leader",
        "--max-states",
        100,
        "--runs",
        50,
    )
    assert "with 95% confidence; proven:" in done.stdout
    found = pd.read_csv(tmp_path / "results" / "evaluate-paper-1" / "estimates.csv").iloc[0]
    assert found["enumerated_low"] <= found["success_low"] < found["success_high"]
    assert found["success_high"] <= found["enumerated_high"]


def test_evaluate_refuses_to_enumerate_a_large_swarm(tmp_path):
    done = casswarm(tmp_path, "evaluate", "large-swarm", "--tolerance", 0, code=2)
    assert "give a tolerance" in done.stderr
