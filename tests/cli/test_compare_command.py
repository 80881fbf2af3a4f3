"""casswarm compare, as a user runs it: stopped by Ctrl-C, gone on with, and read."""

import json
import os
import signal
import subprocess
import time

import pandas as pd
import pytest
from commands import CASSWARM, casswarm

OPTIONS = ("compare", "--family", "quick", "--solver", "ipopt", "--solver", "spectral")
OPTIONS += ("--time-limit", "30")  # where the machine is busy


@pytest.fixture(scope="module")
def compared(tmp_path_factory):
    """A folder, the number of cells when Ctrl-C came, what was said then, and the second run."""
    folder = tmp_path_factory.mktemp("compare")
    cells = folder / "results" / "compare" / "cells.jsonl"
    running = subprocess.Popen(
        [CASSWARM, *OPTIONS], cwd=folder, stderr=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    )
    deadline = time.monotonic() + 100
    while not (cells.exists() and cells.read_bytes()) and time.monotonic() < deadline:
        time.sleep(0.005)
    os.kill(running.pid, signal.SIGINT)
    _, error = running.communicate(timeout=60)
    assert running.returncode == 1, error
    kept = len(cells.read_bytes().splitlines())
    return folder, kept, error, casswarm(folder, *OPTIONS)


def test_ctrl_c_leaves_what_is_finished_and_the_same_command_goes_on(compared):
    folder, kept, error, _ = compared
    assert "repeat the same command" in error
    assert "Traceback" not in error
    assert 0 < kept < 20
    lines = (folder / "results" / "compare" / "cells.jsonl").read_text().splitlines()
    cells = [json.loads(line) for line in lines]
    assert len({(c["problem"], c["start"], c["solver"]) for c in cells}) == len(cells) == 20


def test_summary_is_printed_a_table_a_family_and_start(compared):
    out = compared[3].stdout
    for title in ("guides, cold", "guides, warm", "formations, cold", "formations, warm"):
        assert f"{title} start" in out
    assert "spectral" not in out.split("formations")[0]  # which cannot take a guide


def test_folder_holds_tables_figures_report_and_record(compared):
    results = compared[0] / "results" / "compare"
    record = json.loads((results / "run.json").read_text())
    names = {path.name for path in results.iterdir()}
    assert names == set(record["files"])
    assert {"cells.csv", "summary.csv", "problems.csv", "failures.csv"} <= names
    assert {"report.md", "report.html", "cells.jsonl", "inputs.json"} <= names
    assert "profile-formations-cold.png" in names
    assert record["inputs"]["seed"] == 0
    assert record["inputs"]["machine"]["cores"] >= 1
    assert "casadi" in record["versions"]
    cells = pd.read_csv(results / "cells.csv")
    assert len(cells) == 20
    taken = cells[cells["taken"]]
    assert len(taken) == 18
    assert (taken["violation"] <= 1e-6).all()
    assert taken["solved"].all()


def test_figures_are_drawn_again_from_the_cells(compared, tmp_path):
    results = compared[0] / "results" / "compare"
    done = casswarm(tmp_path, "plot", results, "--figure", "data-guides-cold", "--out", "here")
    assert done.stdout == "here/data-guides-cold.png\n"
    assert (tmp_path / done.stdout.strip()).read_bytes() == (
        results / "data-guides-cold.png"
    ).read_bytes()


def test_report_can_be_read_by_somebody_who_was_not_there(compared):
    results = compared[0] / "results" / "compare"
    text = (results / "report.md").read_text()
    for words in (
        "5 problems, 2 solvers, 20 cells",
        "Ipopt(tolerance=1e-08",
        "spectral cannot take guide[10]",
        "What counts as solved",
        "shift of 1 ms",
        "Gould",
    ):
        assert words in text
    for line in text.splitlines():
        if line.startswith("!["):
            assert (results / line.rpartition("(")[2].rstrip(")")).exists()
    page = (results / "report.html").read_text()
    assert page.count("data:image/png;base64,") == text.count("![")
    assert "<script" not in page


def test_another_comparison_is_refused_in_the_folder(compared):
    done = casswarm(compared[0], *OPTIONS, "--seed", 5, code=2)
    assert "holds another comparison" in done.stderr
    assert "seed: 0 there, 5 here" in done.stderr


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (("--family", "guide"), "did you mean 'guides'?"),
        (("--solver", "ipop"), "did you mean 'ipopt'?"),
        (("--time-limit", "0"), "--time-limit"),
    ],
)
def test_wrong_input_is_exit_code_2(tmp_path, options, words):
    assert words in casswarm(tmp_path, "compare", *options, code=2).stderr


def test_help_shows_an_example(tmp_path):
    assert "casswarm compare --family quick" in casswarm(tmp_path, "compare", "--help").stdout
