"""casswarm --part and casswarm merge: the study of the parts is that of one process."""

from __future__ import annotations

import json
import os
import random
import signal
import subprocess
import sys
import time
from pathlib import Path

import pandas as pd
import pytest
from commands import casswarm

SIMULATION = ("simulate", "single-agent", "--policy", "naive", "--no-figures")
SWARM = ("simulate", "barricade", "--policy", "naive", "--policy", "leader", "--no-figures")
SWEEP = ("sweep", "alley", "--set", "n=1,2", "--policy", "naive", "--no-figures")
GRID = ("--set", "formation.rho=0.01:0.1:32", "--set", "n=1,2", "--policy", "naive")


def saved(folder: Path, command: tuple[str, ...], parts: int) -> list[str]:
    """Run all parts of a command; their folders."""
    for k in range(1, parts + 1):
        casswarm(folder, *command, "--part", f"{k}/{parts}", "--out", f"parts/{k}")
    return [f"parts/{k}" for k in range(1, parts + 1)]


def require_equal_tables(one: Path, other: Path) -> None:
    tables = {path.name for path in one.glob("*.csv")} - {"effort.csv"}  # of seconds
    assert tables
    for name in tables:
        assert (one / name).read_bytes() == (other / name).read_bytes(), name


@pytest.mark.slow
@pytest.mark.parametrize(
    ("command", "parts"),
    [
        ((*SIMULATION, "--runs", "50"), 2),
        pytest.param((*SWARM, "--runs", "50"), 3, marks=pytest.mark.slow),
        ((*SIMULATION, "--runs", "2"), 3),
        (SWEEP, 3),
    ],
    ids=["simulate", "two-policies", "fewer-runs-than-parts", "fewer-points-than-parts"],
)
def test_merged_parts_are_the_study(tmp_path: Path, command: tuple[str, ...], parts: int) -> None:
    folders = saved(tmp_path, command, parts)
    merged = casswarm(tmp_path, "merge", *reversed(folders), "--out", "merged")
    whole = casswarm(tmp_path, *command, "--out", "whole")
    assert merged.stdout == whole.stdout
    require_equal_tables(tmp_path / "whole", tmp_path / "merged")
    records = [
        json.loads((tmp_path / name / "run.json").read_text()) for name in ("merged", "whole")
    ]
    assert records[0]["inputs"] == records[1]["inputs"]
    again = casswarm(tmp_path, "merge", *folders, "--out", "merged")
    assert again.stdout == whole.stdout


def test_part_says_what_it_is(tmp_path: Path) -> None:
    command = (*SIMULATION, "--runs", "4")
    done = casswarm(tmp_path, *command, "--part", "2/3", "--out", "two", "--workers", "1")
    assert done.stdout == "part 2 of 3 is saved in two; casswarm merge joins all parts\n"
    written = json.loads((tmp_path / "two" / "part.json").read_text())
    assert written == {"part": 2, "parts": 3, "arguments": list(command)}
    done = casswarm(tmp_path, *command, "--part=2/3", "--out=two", "--resume", "--json")
    assert json.loads(done.stdout) == {**written, "arguments": [*command, "--json"]}
    assert {path.name for path in (tmp_path / "two").iterdir()} == {"checkpoint", "part.json"}


def test_refusals_name_what_helps(tmp_path: Path) -> None:
    command = (*SIMULATION, "--runs", "4")
    message = "--part: give every part a folder of its own, with --out"
    assert message in casswarm(tmp_path, *command, "--part", "1/2", code=2).stderr
    for wrong in ("3/2", "0/2", "1", "a/b", "1/1000000000"):
        done = casswarm(tmp_path, *command, "--part", wrong, "--out", "x", code=2)
        assert "is not of the form k/K, such as 3/64" in done.stderr
    casswarm(tmp_path, *command, "--part", "2/3", "--out", "two")
    done = casswarm(tmp_path, "merge", "two", "--out", "all", code=1)
    assert "of 3 parts, these are not there: 1, 3; run each of them as casswarm " in done.stderr
    assert "--runs 4 --part 1/3 --out DIR" in " ".join(done.stderr.split())
    casswarm(tmp_path, *SIMULATION, "--runs", "5", "--part", "1/3", "--out", "other")
    done = casswarm(tmp_path, "merge", "two", "other", "--out", "all", code=2)
    assert "other is a part of another study than two" in done.stderr
    (tmp_path / "none").mkdir()
    done = casswarm(tmp_path, "merge", "two", "none", "--out", "all", code=1)
    assert "none holds no finished part of a study" in done.stderr
    assert not (tmp_path / "all").exists()


@pytest.mark.parametrize(
    "text",
    ["", "[]", '{"part": 1, "parts": 1, "arguments": ["explore"]}', '{"part": 2, "parts": 1}'],
)
def test_other_files_are_no_parts(tmp_path: Path, text: str) -> None:
    (tmp_path / "part").mkdir()
    (tmp_path / "part" / "part.json").write_text(text)
    done = casswarm(tmp_path, "merge", "part", "--out", "all", code=1)
    assert "part holds no finished part of a study" in done.stderr


@pytest.mark.slow
def test_damaged_records_are_computed_again(tmp_path: Path) -> None:
    command = (*SIMULATION, "--runs", "20")
    folders = saved(tmp_path, command, 2)
    for record in (tmp_path / "parts/1/checkpoint").glob("*naive.npz"):
        record.write_bytes(record.read_bytes()[:-1])
    merged = casswarm(tmp_path, "merge", *folders, "--out", "merged")
    assert merged.stdout == casswarm(tmp_path, *command, "--out", "whole").stdout
    require_equal_tables(tmp_path / "whole", tmp_path / "merged")


@pytest.mark.parametrize("words", [["--policy", "own:fly"], ["--policy=own:fly"], ["--allow-code"]])
def test_code_that_parts_name_needs_consent(tmp_path: Path, words: list[str]) -> None:
    folder = tmp_path / "part"
    folder.mkdir()
    arguments = ["simulate", "paper-1", *words]
    (folder / "part.json").write_text(json.dumps({"part": 1, "parts": 1, "arguments": arguments}))
    done = casswarm(tmp_path, "merge", "part", "--out", "all", code=2)
    assert "the parts' command names code" in done.stderr
    done = casswarm(tmp_path, "merge", "part", "--out", "all", "--allow-code", code=2)
    assert "part holds no part of a study" in done.stderr


def killed(folder: Path, arguments: list[str], records: Path) -> bool:
    """Kill a command as soon as it has begun to save; whether it was killed in time."""
    running = subprocess.Popen(
        [sys.executable, "-m", "casswarm", *arguments],
        cwd=folder,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )
    while running.poll() is None and not (records / "inputs.json").exists():
        time.sleep(0.005)
    if running.poll() is None:
        os.kill(running.pid, signal.SIGKILL)
    return running.wait() != 0


@pytest.mark.slow
def test_64_parts_in_random_order_of_which_ten_are_killed(tmp_path: Path) -> None:
    rng, parts = random.Random(0), 64
    order = rng.sample(range(1, parts + 1), parts)
    command = ["sweep", "paper-1", *GRID, "--no-figures"]
    doomed, kills = set(rng.sample(order, 10)), 0
    for k in order:
        part = [*command, "--part", f"{k}/{parts}", "--out", f"parts/{k}"]
        if k in doomed:
            kills += killed(tmp_path, part, tmp_path / f"parts/{k}/checkpoint")
        casswarm(tmp_path, *part, "--resume")
    assert kills >= 5
    folders = [f"parts/{k}" for k in rng.sample(order, parts)]
    casswarm(tmp_path, "merge", *folders, "--out", "merged")
    casswarm(tmp_path, *command, "--out", "whole")
    require_equal_tables(tmp_path / "whole", tmp_path / "merged")
    assert len(pd.read_csv(tmp_path / "merged" / "sweep.csv")) == parts


@pytest.mark.slow
def test_parts_of_a_comparison(tmp_path: Path) -> None:
    command = ("compare", "--family", "quick", "--solver", "spectral", "--solver", "ipopt")
    folders = saved(tmp_path, (*command, "--no-figures"), 2)
    casswarm(tmp_path, "merge", *folders, "--out", "merged")
    merged = pd.read_csv(tmp_path / "merged" / "runs.csv")
    casswarm(tmp_path, *command, "--no-figures", "--out", "whole")
    whole = pd.read_csv(tmp_path / "whole" / "runs.csv")
    same = ["problem", "copy", "start", "solver", "status", "objective"]
    pd.testing.assert_frame_equal(merged[same], whole[same])


@pytest.mark.slow
def test_slurm_script_of_the_page_runs_a_part(tmp_path: Path) -> None:
    """The job array, with a stub for Slurm: the script, its task's number and the largest one."""
    page = (Path(__file__).parents[2] / "docs" / "clusters.md").read_text(encoding="utf-8")
    script = page.split("<!-- slurm -->\n```sh\n")[1].split("```")[0]
    assert "#SBATCH --array=1-64\n" in script
    (tmp_path / "study.sh").write_text(script)
    environment = dict(
        os.environ,
        PATH=f"{Path(sys.executable).parent}:{os.environ['PATH']}",
        SLURM_ARRAY_TASK_ID="7",
        SLURM_ARRAY_TASK_MAX="64",
    )
    command = ["sh", "study.sh"]
    for _ in range(2):  # requeued
        done = subprocess.run(
            command, cwd=tmp_path, env=environment, capture_output=True, text=True, check=True
        )
        assert done.stdout == "part 7 of 64 is saved in parts/7; casswarm merge joins all parts\n"
    assert json.loads((tmp_path / "parts/7/part.json").read_text())["part"] == 7
