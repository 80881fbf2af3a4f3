"""casswarm compare: interrupted by Ctrl-C and resumed, its report, own files and solvers."""

import json
import os
import signal
import subprocess
import time
from pathlib import Path

import casadi as ca
import pandas as pd
import pytest
from commands import CASSWARM, casswarm

import casswarm as csw

OPTIONS = ("compare", "--family", "quick", "--solver", "ipopt", "--solver", "spectral")
OPTIONS += ("--time-limit", "30", "--copies", "1")  # the limit is for a busy machine


@pytest.fixture(scope="module")
def compared(tmp_path_factory):
    """Folder, number of runs saved at Ctrl-C, the error printed then, and the resumed run."""
    folder = tmp_path_factory.mktemp("compare")
    records = folder / "results" / "compare" / "checkpoint"
    running = subprocess.Popen(
        [CASSWARM, *OPTIONS], cwd=folder, stderr=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    )
    deadline = time.monotonic() + 100
    while not list(records.glob("[!.]*.npz")) and time.monotonic() < deadline:
        time.sleep(0.005)
    os.kill(running.pid, signal.SIGINT)
    _, error = running.communicate(timeout=60)
    assert running.returncode == 1, error
    saved = len(list(records.glob("[!.]*.npz")))
    return folder, saved, error, casswarm(folder, *OPTIONS)


@pytest.mark.slow
def test_compare_continues_after_ctrl_c(compared):
    folder, saved, error, _ = compared
    assert "repeat the same command" in error
    assert "Traceback" not in error
    assert 0 < saved < 40
    runs = pd.read_csv(folder / "results" / "compare" / "runs.csv")
    keys = ["problem", "copy", "start", "solver"]
    assert len(runs[keys].drop_duplicates()) == len(runs) == 40


@pytest.mark.slow
def test_compare_prints_table_per_family_and_start(compared):
    out = compared[3].stdout
    for title in ("guides, cold", "guides, warm", "formations, cold", "formations, warm"):
        assert f"{title} start" in out
    assert "spectral" not in out.split("formations")[0]  # not applicable to guides
    assert out.count("ipopt") == 4
    assert out.count("spectral") == 2  # a row per solver that is applicable
    assert " rank " in out
    assert "probability" in out


@pytest.mark.slow
def test_compare_ranks_every_applicable_solver(compared):
    results = compared[0] / "results" / "compare"
    ranking = pd.read_csv(results / "ranking.csv")
    assert len(ranking) == 6
    assert ranking["probability"].isna().all()  # of one and of four problems
    sensitivity = pd.read_csv(results / "sensitivity.csv")
    assert "without copies" in set(sensitivity["criterion"])


@pytest.mark.slow
def test_compare_folder_contains_tables_figures_and_report(compared):
    results = compared[0] / "results" / "compare"
    record = json.loads((results / "run.json").read_text())
    names = {path.name for path in results.iterdir()}
    assert names - {"checkpoint"} == set(record["files"])
    assert {"runs.csv", "summary.csv", "problems.csv", "failures.csv"} <= names
    assert {"ranking.csv", "sensitivity.csv", "traits.csv", "iterates.csv"} <= names
    assert {"report.md", "report.html"} <= names
    assert {"overview.png", "profiles-formations-cold.png", "convergence-guides-warm.png"} <= names
    assert record["inputs"]["seed"] == 0
    assert record["inputs"]["machine"]["cores"] >= 1
    assert "casadi" in record["versions"]
    runs = pd.read_csv(results / "runs.csv")
    assert len(runs) == 40
    applicable = runs[runs["applicable"]]
    assert len(applicable) == 36
    assert (applicable["violation"] <= 1e-6).all()
    assert applicable["solved"].all()


@pytest.mark.slow
def test_plot_draws_figure_of_comparison_again(compared, tmp_path):
    results = compared[0] / "results" / "compare"
    done = casswarm(tmp_path, "plot", results, "--figure", "bands-guides-cold", "--out", "here")
    assert done.stdout == "here/bands-guides-cold.png\n"
    assert (tmp_path / done.stdout.strip()).read_bytes() == (
        results / "bands-guides-cold.png"
    ).read_bytes()


@pytest.mark.slow
def test_compare_report_is_self_contained(compared):
    results = compared[0] / "results" / "compare"
    text = (results / "report.md").read_text()
    for message in (
        "5 problems, 2 solvers, 40 runs",
        "Every problem is also posed in 1 perturbed copy",
        "Ipopt(tolerance=1e-08",
        "spectral cannot take guide[10]",
        "A solver has solved a problem if",
        "shift of 1 ms",
        "Gould",
    ):
        assert message in text
    for line in text.splitlines():
        if line.startswith("!["):
            assert (results / line.rpartition("(")[2].rstrip(")")).exists()
    page = (results / "report.html").read_text()
    assert page.count("data:image/png;base64,") == text.count("![")
    assert "<script" not in page


@pytest.mark.slow
def test_compare_against_an_earlier_comparison_states_agreement(tmp_path):
    results = Path(__file__).parents[2] / "results" / "comparison" / "first"
    options = ("--time-limit", 30, "--no-figures", "--no-iterates", "--copies", 1)
    families = ("--family", "formations", "--count", 1, "--solver", "spectral")
    done = casswarm(tmp_path, "compare", *families, *options, "--against", results, "--json")
    assert "agreement.csv" in {path.name for path in (tmp_path / "results/compare").iterdir()}
    agreement = json.loads(done.stdout)["agreement"]
    assert agreement["agrees"]  # a single solver has rank 1
    assert "problems" not in agreement["different"]
    assert len(pd.read_csv(tmp_path / "results/compare/iterates.csv")) == 0


@pytest.mark.slow
def test_compare_refuses_folder_of_other_results(compared):
    done = casswarm(compared[0], *OPTIONS, "--against", "results/compare", code=2)
    assert "is the folder of the results" in done.stderr
    done = casswarm(compared[0], *OPTIONS, "--seed", 5, code=2)
    assert "belongs to other inputs" in done.stderr
    assert "seed: 0 there, 5 now" in done.stderr


# --- files and solvers of one's own

MODULE = """
from dataclasses import dataclass
from casswarm.solvers import Ipopt

@dataclass(frozen=True)
class Mine(Ipopt):
    name = "mine"

"""
X = ca.SX.sym("x", 2)


@pytest.fixture
def folder(tmp_path):
    (tmp_path / "my_module.py").write_text(MODULE)
    (tmp_path / "files").mkdir()
    for name in ("one", "two"):
        problem = csw.Problem.from_casadi({"x": X, "f": ca.sumsqr(X - 1)}, name)
        problem.to_nl(tmp_path / "files" / f"{name}.nl")
    (tmp_path / "files" / "cut.nl").write_text("g3 1 1 0\n 2 0 1\n")
    return tmp_path


@pytest.mark.slow
def test_compare_solves_files_with_own_solver(folder):
    options = ("--solver", "ipopt", "--solver", "my_module:Mine", "--time-limit", 60)
    done = casswarm(folder, "compare", "--problems", "files", *options, "--no-figures")
    assert (
        "left out: files/cut.nl, line 2: the file ends too early: is it truncated?" in done.stderr
    )
    assert "files, given initial guess, 2 problems" in done.stdout
    runs = pd.read_csv(folder / "results" / "compare" / "runs.csv")
    assert sorted(set(runs["solver"])) == ["ipopt", "mine"]
    assert runs["solved"].all()


@pytest.mark.slow
def test_compare_solves_problems_of_scenarios(folder):
    options = ("--solver", "ipopt", "--count", 1, "--time-limit", 60, "--policy", "leader")
    done = casswarm(folder, "compare", "single-agent", "wall", *options, "--no-figures")
    for family in ("single-agent guides", "wall guides", "wall formations"):
        assert f"{family}, cold start, 1 problem" in done.stdout


def test_compare_to_which_no_solver_applies_is_refused(folder):
    options = ("--problems", "files", "--solver", "spectral")
    done = casswarm(folder, "compare", *options, code=2)
    reason = "none of the solvers is applicable to any of the problems; spectral: "
    assert reason in done.stderr
    assert not (folder / "results" / "compare" / "runs.csv").exists()
