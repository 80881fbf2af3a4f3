"""casswarm plan-swarm as a user runs it, and the success bound of other commands."""

from __future__ import annotations

import csv
import json
import re
from pathlib import Path

import pytest
from commands import PNG, casswarm

PAIR = ("paper-1", "--set", "swarm.positions=[[0.0, 0.0], [0.4, 0.1]]", "--set", "time.t_f=8.0")
BOUND = re.compile(r"no policy can exceed (0\.\d+) \((?:level game|independent clocks)\)\n")


def test_plan_swarm_prints_success_and_bound(tmp_path: Path) -> None:
    printed = casswarm(tmp_path, "plan-swarm", *PAIR, "--seed", "3").stdout
    line = " ".join(printed.split())
    reported = re.search(r"success (0\.\d+) .*no policy can exceed (0\.\d+)", line)
    assert reported
    assert 0.5 < float(reported[1]) < float(reported[2]) < 1.0
    assert "formation" in printed
    assert "alive at the end" in printed
    folder = tmp_path / "results" / "plan-swarm-paper-1"
    assert (folder / "joint.png").read_bytes().startswith(PNG)
    record = json.loads((folder / "run.json").read_text())
    result = record["result"]
    low, high = result["success"]
    assert low <= result["value"] <= high <= result["success_bound"]["bound"]
    assert len(result["success_bound"]["risks"]) == 2
    assert record["inputs"]["seed"] == 3
    with (folder / "joint.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == 2 * len(result["positions"])
    assert float(rows[-1]["survival"]) < float(rows[0]["survival"]) == 1.0
    with (folder / "outcomes.csv").open() as file:
        assert len(list(csv.DictReader(file))) == len(result["outcomes"])


@pytest.mark.slow
def test_plan_swarm_of_a_large_swarm_is_estimated(tmp_path: Path) -> None:
    positions = json.dumps([[0.1 * i, 0.1 * (i % 3)] for i in range(11)])
    settings = ("--set", f"swarm.positions={positions}", "--set", "hazard.alpha_1=30.0")
    settings += ("--set", "time.t_f=7.0")
    printed = casswarm(tmp_path, "plan-swarm", "paper-1", *settings, "--time-limit", "1").stdout
    assert "by the mean field" in " ".join(printed.split())
    assert "95% confidence" in printed
    record = tmp_path / "results" / "plan-swarm-paper-1" / "run.json"
    estimate = json.loads(record.read_text())["result"]["estimate"]
    assert 0 <= estimate["success_low"] < estimate["success_high"] <= 1


@pytest.mark.slow
def test_evaluate_and_simulate_print_the_success_bound(tmp_path: Path) -> None:
    for command in (
        ("evaluate", *PAIR, "--policy", "naive", "--runs", "100"),
        ("simulate", *PAIR, "--policy", "naive", "--runs", "10"),
    ):
        done = casswarm(tmp_path, *command)
        printed_bound = BOUND.search(done.stdout)
        assert printed_bound, done.stdout
        record = tmp_path / "results" / f"{command[0]}-paper-1" / "run.json"
        bound = json.loads(record.read_text())["result"]["success_bound"]
        assert bound["certified"]
        assert bound["bound"] <= float(printed_bound[1]) <= bound["bound"] + 1e-4


def test_plan_swarm_with_too_large_distance_is_explained(tmp_path: Path) -> None:
    done = casswarm(tmp_path, "plan-swarm", *PAIR, "--min-distance", "2", code=2)
    assert "members start 0.412311 apart; choose a smaller distance" in done.stderr
