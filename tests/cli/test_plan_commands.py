"""casswarm plan and plan-swarm as a user runs them, and the success bound of other commands."""

import json
import re
from types import SimpleNamespace

import pandas as pd
import pytest
from commands import PNG, casswarm

from casswarm import load_scenario
from casswarm.cli.plan import _limits

PAIR = ("paper-1", "--set", "swarm.positions=[[0.0, 0.0], [0.4, 0.1]]", "--set", "time.t_f=8.0")
BOUND = re.compile(r"no policy can exceed (0\.\d+) \((?:level game|independent clocks)\)\n")


@pytest.fixture
def planned(finished):
    """Results folder of paper-1, and what was printed."""
    return finished("plan", "paper-1")


def test_plan_prints_survival_residuals_and_solves(planned):
    text = planned[1].stdout
    assert "survival 0.045" in text
    assert "no guide can exceed 0.71" in text
    assert "limited to a local search and arrival at the last step: --search global" in text
    assert "violation" in text
    assert "solves: 1 solved" in text


def test_plan_says_what_limited_its_search():
    limited = load_scenario("paper-1")
    guide = SimpleNamespace(search="global")
    texts = [*_limits(limited, guide), *_limits(limited.replace(guide={"arrival": "any"}), guide)]
    assert texts == [
        "limited to arrival at the last step: --arrival any may find a better path",
    ]


def test_plan_writes_tables_figure_and_record(planned):
    results = planned[0]
    assert {path.name for path in results.iterdir()} == {
        "guide.csv",
        "candidates.csv",
        "paths.csv",
        "guide.png",
        "results.npz",
        "run.json",
    }
    assert (results / "guide.png").read_bytes().startswith(PNG)
    guide = pd.read_csv(results / "guide.csv")
    record = json.loads((results / "run.json").read_text())
    assert guide["risk"].iloc[-1] == pytest.approx(record["result"]["risk"], rel=1e-12)
    assert set(record["versions"]) >= {"casswarm", "casadi", "numpy", "python"}
    assert record["inputs"]["solver"] == "ipopt"


def test_record_holds_the_scenario(planned, tmp_path):
    record = json.loads((planned[0] / "run.json").read_text())
    (tmp_path / "again.toml").write_text(record["scenario"])
    assert load_scenario(tmp_path / "again.toml") == load_scenario("paper-1")


def test_plan_with_json_prints_only_json(tmp_path):
    done = casswarm(tmp_path, "plan", "single-agent", "--json", "--quiet", "--out", "here")
    result = json.loads(done.stdout)["result"]
    assert not done.stderr
    assert (tmp_path / "here" / "guide.csv").exists()
    assert 0.70 < result["survival"] < 0.73
    assert 0.95 * result["risk"] < result["risk_bound"] <= result["risk"]
    assert result["gap"] == pytest.approx(1 - result["risk_bound"] / result["risk"])
    proof = result["certificate"]
    assert proof["bound"] < proof["accelerated"]["bound"] == result["risk_bound"]


@pytest.mark.slow
def test_plan_with_gap_and_map_closes_gap_and_plots_map(tmp_path):
    options = ("--no-acceleration-limited", "--gap", "1e-5", "--map", "--json")
    done = casswarm(tmp_path, "plan", "single-agent", *options)
    assert json.loads(done.stdout)["result"]["gap"] < 1e-5
    figure = tmp_path / "results" / "plan-single-agent" / "cost-to-go.png"
    assert figure.read_bytes().startswith(PNG)


def test_plan_at_time_limit_of_search_fails_with_it(tmp_path):
    done = casswarm(tmp_path, "plan", "ring", "--time-limit", "1e-6", code=1)
    assert "the time limit of 1e-06 s ended the search before its first solve" in done.stderr
    assert not (tmp_path / "results").exists()


def test_plan_without_certificate_lists_homotopy_classes(tmp_path):
    text = casswarm(tmp_path, "plan", "single-agent", "--no-certify").stdout
    assert "not certified" in text
    signatures = re.findall(r"^  ([LR]+) ", text, re.MULTILINE)
    assert sorted(signatures) == ["LL", "LR", "RR"]


@pytest.mark.slow
def test_global_search_has_greater_survival_than_local(tmp_path):
    survival = {
        search: json.loads(
            casswarm(tmp_path, "plan", "single-agent", "--search", search, "--json").stdout
        )["result"]["survival"]
        for search in ("local", "global")
    }
    assert survival["global"] > 2 * survival["local"]


@pytest.mark.slow
def test_projected_gradient_at_iteration_limit_is_compared(tmp_path):
    options = ("--solver", "projected-gradient", "--set", "guide.iterations=50")
    done = casswarm(tmp_path, "plan", "paper-1", *options)
    assert "iteration limit by projected-gradient" in done.stdout
    assert "a global search without a_max and margin: guide arrives" in done.stdout
    results = tmp_path / "results" / "plan-paper-1"
    assert (results / "comparison.png").read_bytes().startswith(PNG)
    table = pd.read_csv(results / "comparison.csv").set_index("guide")
    assert list(table.index) == ["projected gradient", "global search"]
    assert table["risk_bound"].nunique() == 1
    assert table.loc["global search", "gap"] < 0.01 < table.loc["projected gradient", "gap"]


@pytest.mark.slow
def test_impossible_plan_fails_with_exit_code_1(tmp_path):
    settings = ("--set", "swarm.velocity=[-2.0, -2.0]", "--set", "guide.a_max=0.0001")
    done = casswarm(tmp_path, "plan", "paper-1", *settings, code=1)
    assert "no guide found" in done.stderr
    assert not (tmp_path / "results").exists()


# --- plan-swarm


@pytest.mark.slow
def test_plan_swarm_prints_success_and_bound(tmp_path):
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
    survival = pd.read_csv(folder / "joint.csv")["survival"]
    assert len(survival) == 2 * len(result["positions"])
    assert survival.iloc[-1] < survival[0] == 1.0
    assert len(pd.read_csv(folder / "outcomes.csv")) == len(result["outcomes"])


@pytest.mark.slow
def test_plan_swarm_of_a_large_swarm_is_estimated(tmp_path):
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
def test_evaluate_and_simulate_print_the_success_bound(tmp_path):
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
