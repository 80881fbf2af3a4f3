"""The commands, as a user runs them: real processes, real folders."""

import json
from itertools import combinations
from pathlib import Path

import pandas as pd
import pytest
from commands import PNG, casswarm

KEPT = {"checkpoint"}  # from which simulate and sweep resume


@pytest.fixture(scope="module")
def planned(tmp_path_factory):
    folder = tmp_path_factory.mktemp("plan")
    return folder, casswarm(folder, "plan", "paper-1")


@pytest.fixture(scope="module")
def simulated(tmp_path_factory):
    folder = tmp_path_factory.mktemp("simulate")
    return folder, casswarm(folder, "simulate", "paper-1", "--runs", 40, "--seed", 5)


def test_help_shows_where_to_begin(tmp_path):
    out = casswarm(tmp_path, "--help").stdout
    assert "casswarm plan paper-1" in out
    for command in (
        "plan",
        "simulate",
        "evaluate",
        "sweep",
        "compare",
        "plot",
        "animate",
        "scenarios",
        "solvers",
    ):
        assert f"  {command} " in out


@pytest.mark.parametrize(
    "command",
    [
        ("plan",),
        ("simulate",),
        ("scenarios",),
        ("scenarios", "list"),
        ("scenarios", "show"),
        ("scenarios", "new"),
        ("scenarios", "check"),
        ("solvers",),
        ("evaluate",),
        ("sweep",),
        ("compare",),
        ("plot",),
        ("animate",),
    ],
)
def test_every_command_has_help(tmp_path, command):
    assert "Usage: casswarm" in casswarm(tmp_path, *command, "--help").stdout


def test_no_help_text_shows_a_control_sequence(tmp_path):
    for command in (
        [],
        ["plan"],
        ["simulate"],
        ["evaluate"],
        ["sweep"],
        ["compare"],
        ["plot"],
        ["animate"],
        ["scenarios", "new"],
    ):
        out = casswarm(tmp_path, *command, "--help").stdout
        assert "\\b" not in out
        assert "  casswarm" in out  # examples, a line each


def test_files_of_an_earlier_run_do_not_stay_beside_new_ones(tmp_path):
    options = ("--runs", 3, "--out", "here", "--quiet")
    casswarm(tmp_path, "simulate", "paper-1", "--policy", "naive", *options)
    (tmp_path / "here" / "mine.txt").write_text("not casswarm's")
    casswarm(tmp_path, "simulate", "paper-1", "--policy", "leader", "--format", "pdf", *options)
    names = {path.name for path in (tmp_path / "here").iterdir()}
    assert names == {
        "mine.txt",
        "run.json",
        "runs.csv",
        "summary.csv",
        "guide.csv",
        "traces.csv",
        "success.pdf",
        "run-leader.pdf",
        "formation-leader.pdf",
        *KEPT,
    }
    cells = {path.name for path in (tmp_path / "here" / "checkpoint").glob("*.npz")}
    assert len(cells) == 1
    assert "leader" in cells.pop()
    assert b"/Type3" not in (tmp_path / "here" / "success.pdf").read_bytes()


def test_options_that_do_not_apply_to_the_projected_gradient_are_refused(tmp_path):
    done = casswarm(
        tmp_path, "plan", "paper-1", "--solver", "projected-gradient", "--search", "global", code=2
    )
    assert "do not apply" in done.stderr


def test_version_is_the_installed_one(tmp_path):
    from casswarm import __version__

    assert __version__ in casswarm(tmp_path, "--version").stdout


def test_plan_tells_survival_residuals_and_outcomes(planned):
    out = planned[1].stdout
    assert "survival 0.03" in out
    assert "no guide can exceed 0.70" in out
    assert "a local search" in out
    assert "violation" in out
    assert "solves: 1 solved" in out


def test_plan_leaves_tables_figure_and_record(planned):
    results = planned[0] / "results" / "plan-paper-1"
    assert {path.name for path in results.iterdir()} == {
        "guide.csv",
        "candidates.csv",
        "paths.csv",
        "guide.png",
        "run.json",
    }
    assert (results / "guide.png").read_bytes().startswith(PNG)
    guide = pd.read_csv(results / "guide.csv")
    record = json.loads((results / "run.json").read_text())
    assert guide["risk"].iloc[-1] == pytest.approx(record["result"]["risk"], rel=1e-12)
    assert set(record["versions"]) >= {"casswarm", "casadi", "numpy", "python"}
    assert record["inputs"]["solver"] == "ipopt"


def test_record_holds_the_scenario_that_made_it(planned, tmp_path):
    record = json.loads((planned[0] / "results" / "plan-paper-1" / "run.json").read_text())
    (tmp_path / "again.toml").write_text(record["scenario"])
    from casswarm import load_scenario

    assert load_scenario(tmp_path / "again.toml") == load_scenario("paper-1")


def test_json_output_is_json_and_nothing_else(tmp_path):
    done = casswarm(tmp_path, "plan", "single-agent", "--json", "--quiet", "--out", "here")
    content = json.loads(done.stdout)
    assert 0.70 < content["result"]["survival"] < 0.73
    assert (tmp_path / "here" / "guide.csv").exists()
    result = content["result"]
    assert 0.95 * result["risk"] < result["risk_bound"] <= result["risk"]
    assert result["gap"] == pytest.approx(1 - result["risk_bound"] / result["risk"])
    assert result["certificate"]["bound"] == result["risk_bound"]


def test_plan_takes_a_gap_a_time_limit_and_a_map_or_no_proof_at_all(tmp_path):
    done = casswarm(
        tmp_path,
        "plan",
        "single-agent",
        "--not-acceleration_limited",
        "--gap",
        "1e-5",
        "--map",
        "--json",
    )
    assert json.loads(done.stdout)["result"]["gap"] < 1e-5
    folder = tmp_path / "results" / "plan-single-agent"
    assert (folder / "cost-to-go.png").read_bytes().startswith(PNG)
    limits = ("--gap", "1e-12", "--time-limit", "1e-6")
    assert "time limit of 1e-06 s" in casswarm(tmp_path, "plan", "ring", *limits, "--json").stdout
    plain = casswarm(tmp_path, "plan", "single-agent", "--no-certify").stdout
    assert "not certified" in plain
    ways = [line.split()[0] for line in plain.splitlines() if line.startswith("  ")]
    assert sorted(ways) == ["LL", "LR", "RR"]  # on which side each of the two radars is passed


def test_global_search_beats_local_search(tmp_path):
    survival = {
        search: json.loads(
            casswarm(tmp_path, "plan", "single-agent", "--search", search, "--json").stdout
        )["result"]["survival"]
        for search in ("local", "global")
    }
    assert survival["global"] > 2 * survival["local"]


def test_plan_by_projected_gradient_says_that_it_hit_its_limit(tmp_path):
    done = casswarm(
        tmp_path,
        "plan",
        "paper-1",
        "--solver",
        "projected-gradient",
        "--set",
        "guide.iterations=50",
    )
    assert "iteration limit by projected-gradient" in done.stdout
    assert "a global search without a_max and margin: guide arrives" in done.stdout
    results = tmp_path / "results" / "plan-paper-1"
    assert (results / "comparison.png").read_bytes().startswith(PNG)
    table = pd.read_csv(results / "comparison.csv").set_index("guide")
    assert list(table.index) == ["projected gradient", "global search"]
    assert table["risk_bound"].nunique() == 1
    assert table.loc["global search", "gap"] < 0.01 < table.loc["projected gradient", "gap"]


def test_impossible_plan_fails_with_code_1(tmp_path):
    settings = ("--set", "swarm.velocity=[-2.0, -2.0]", "--set", "guide.a_max=0.0001")
    done = casswarm(tmp_path, "plan", "paper-1", *settings, code=1)
    assert "no guide found" in done.stderr
    assert not (tmp_path / "results").exists()


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("plan", "papr-1"), "did you mean 'paper-1'"),
        (("plan", "paper-1", "--set", "swarm.vmax=1"), "swarm.v_max"),
        (("plan", "paper-1", "--set", "formation.rho"), "KEY=VALUE"),
        (("plan", "paper-1", "--set", "time.dt=-1"), "time.dt"),
        (("plan", "paper-1", "--solver", "ipop"), "did you mean 'ipopt'"),
        (("plan", "paper-1", "--search", "everywhere"), "everywhere"),
        (("plan", "paper-1", "--set", "target.center=[80.0, 65.0]"), "reach"),
        (("simulate", "paper-1", "--policy", "leeder"), "did you mean 'leader'"),
        (("simulate", "paper-1", "--policy", "leader", "--policy", "leader"), "repeated"),
        (("simulate", "paper-1", "--runs", "0"), "0"),
        (("simulate", "paper-1", "--solver", "newton"), "projected-gradient"),
        (("scenarios", "show", "nowhere.toml"), "nowhere.toml"),
        (("plan",), "SCENARIO"),
        (("fly", "paper-1"), "No such command"),
    ],
)
def test_wrong_input_is_explained_with_code_2(tmp_path, arguments, words):
    done = casswarm(tmp_path, *arguments, code=2)
    assert words in done.stderr
    assert not done.stdout
    assert not (tmp_path / "results").exists()


def test_results_that_cannot_be_written_fail_with_code_1(tmp_path):
    (tmp_path / "file").write_text("in the way")
    done = casswarm(tmp_path, "plan", "paper-1", "--out", "file/results", code=1)
    assert "cannot write" in done.stderr


def test_simulate_prints_a_row_a_policy_with_its_interval(simulated):
    _, summary, paired, bound = simulated[1].stdout.split("\n\n")
    assert bound.startswith("no policy can exceed 0.99")
    rows = [line.split() for line in summary.splitlines()[1:]]
    assert [row[0] for row in rows] == ["naive", "constrained", "leader"]
    for row in rows:
        success = 0.0 if row[2] == "none" else float(row[2])
        assert float(row[3]) <= success < float(row[5])
    differences = [line.split() for line in paired.splitlines()[1:4]]
    assert [(row[0], row[2]) for row in differences] == list(combinations((r[0] for r in rows), 2))
    for row in differences:
        assert float(row[4]) <= float(row[3]) <= float(row[6])


def test_simulate_leaves_tables_figures_and_record(simulated):
    results = simulated[0] / "results" / "simulate-paper-1"
    names = {path.name for path in results.iterdir()}
    summary_policies = ("naive", "constrained", "leader")
    assert names == {
        "summary.csv",
        "paired.csv",
        "runs.csv",
        "guide.csv",
        "traces.csv",
        "success.png",
        "differences.png",
        *(f"{kind}-{row}.png" for kind in ("run", "formation") for row in summary_policies),
        "run.json",
        *KEPT,
    }
    runs = pd.read_csv(results / "runs.csv")
    summary = pd.read_csv(results / "summary.csv").set_index("policy")
    assert len(runs) == 3 * 40
    for policy, own in runs.groupby("policy"):
        assert own["success"].sum() == summary["successes"][policy]
    record = json.loads((results / "run.json").read_text())
    assert record["inputs"] == {
        "policies": ["naive", "constrained", "leader"],
        "runs": 40,
        "half_width": None,
        "seed": 5,
        "keep": 5,
        "workers": 1,
        "solver": "auto",
    }


def test_same_seed_gives_the_same_files_with_two_workers(simulated, tmp_path):
    casswarm(tmp_path, "simulate", "paper-1", "--runs", 40, "--seed", 5, "--workers", 2)
    for name in ("runs.csv", "summary.csv"):
        path = Path("results") / "simulate-paper-1" / name
        assert (tmp_path / path).read_bytes() == (simulated[0] / path).read_bytes()


def test_another_seed_gives_other_runs(simulated, tmp_path):
    casswarm(tmp_path, "simulate", "paper-1", "--runs", 40, "--seed", 6, "--policy", "naive")
    path = Path("results") / "simulate-paper-1" / "runs.csv"
    first = pd.read_csv(simulated[0] / path).query("policy == 'naive'")
    second = pd.read_csv(tmp_path / path)
    assert not (first["steps"].to_numpy() == second["steps"].to_numpy()).all()


def test_no_success_prints_an_upper_bound_and_not_zero(tmp_path):
    done = casswarm(
        tmp_path,
        "simulate",
        "paper-1",
        "--runs",
        10,
        "--policy",
        "naive",
        "--set",
        "hazard.alpha_1=400.0",
    )
    row = done.stdout.split("\n\n")[1].splitlines()[-1].split()
    assert row[:3] == ["naive", "10", "none"]
    assert float(row[5]) > 0.2


def test_settings_reach_the_simulation(tmp_path):
    done = casswarm(
        tmp_path,
        "simulate",
        "paper-1",
        "--runs",
        10,
        "--policy",
        "naive",
        "--set",
        "hazard.alpha_1=1e-6",
        "--json",
    )
    assert json.loads(done.stdout)["result"]["summary"][0]["successes"] == 10


def test_solvers_are_listed_with_what_they_can_do(tmp_path):
    out = casswarm(tmp_path, "solvers").stdout
    for name in ("auto", "spectral", "ipopt", "projected-gradient"):
        assert f"{name} " in out


def test_another_solver_can_be_named(tmp_path):
    done = casswarm(
        tmp_path, "simulate", "paper-1", "--runs", 3, "--policy", "leader", "--solver", "spectral"
    )
    assert "leader" in done.stdout


def test_scenarios_are_listed_with_their_descriptions(tmp_path):
    out = casswarm(tmp_path, "scenarios", "list").stdout
    assert "paper-1" in out
    assert "calibration" in out
    assert len(out.splitlines()) >= 6


def test_shown_scenario_is_a_valid_file(tmp_path):
    text = casswarm(tmp_path, "scenarios", "show", "wall").stdout
    (tmp_path / "shown.toml").write_text(text)
    assert "valid" in casswarm(tmp_path, "scenarios", "check", "shown.toml").stdout


def test_new_scenario_is_named_checked_and_never_overwritten(tmp_path):
    casswarm(tmp_path, "scenarios", "new", "mine.toml", "--from", "ring")
    text = (tmp_path / "mine.toml").read_text()
    assert 'name = "mine"' in text
    assert 'description = "made from ring"' in text  # not what the ring is described as
    assert "# Radius of the target zone, in units of length.\nradius = " in text
    assert "mine.toml" in casswarm(tmp_path, "scenarios", "check", "mine.toml").stdout
    done = casswarm(tmp_path, "scenarios", "new", "mine.toml", code=2)
    assert "--force" in done.stderr
    casswarm(tmp_path, "scenarios", "new", "mine.toml", "--force")


def test_check_reports_every_scenario_and_fails_if_one_is_wrong(tmp_path):
    (tmp_path / "wrong.toml").write_text("name = 3\n")
    done = casswarm(tmp_path, "scenarios", "check", "wrong.toml", "paper-1", code=2)
    assert "wrong.toml" in done.stderr
    assert "paper-1" in done.stdout


def test_rates_of_a_users_module_beside_the_file_are_used(tmp_path):
    (tmp_path / "mine.py").write_text(
        "def rate(positions, alive, strength):\n"
        "    return strength / (1 + (positions[:, 0] - 4) ** 2 + (positions[:, 1] - 4) ** 2)\n"
    )
    casswarm(tmp_path, "scenarios", "new", "own.toml", "--from", "single-agent")
    text = (tmp_path / "own.toml").read_text()
    head, _, rest = text.partition("[hazard]")
    _, _, tail = rest.partition("[guide]")
    (tmp_path / "own.toml").write_text(
        f'{head}[hazard]\nkind = "mine:rate"\n[hazard.parameters]\nstrength = 2.0\n\n[guide]{tail}'
    )
    done = casswarm(tmp_path, "simulate", "own.toml", "--runs", 20, "--workers", 2)
    assert "leader" in done.stdout
    told = casswarm(tmp_path, "plan", "own.toml").stdout
    assert "not certified: that needs a lower bound of your rates" in told
