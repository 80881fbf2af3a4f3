"""The README's commands, example and table are correct."""

import re
import subprocess
from pathlib import Path

import pytest
from commands import casswarm_program, python

ROOT = Path(__file__).resolve().parents[2]
README = (ROOT / "README.md").read_text(encoding="utf-8")
SETUP = "python3 -m venv .venv && .venv/bin/pip install "


def block(mark):
    """The fenced block after the line <!-- mark -->."""
    found = re.search(rf"^<!-- {mark} -->\n```\w*\n(.*?)^```$", README, re.M | re.S)
    assert found, f"README.md has no block marked {mark}"
    return found[1]


def table(text, heading="policy "):
    """Rows of the printed table that begins with `heading`, by their first cell."""
    paragraph = next(part for part in text.split("\n\n") if part.startswith(heading))
    rows = [re.split(r"  +", line.strip()) for line in paragraph.splitlines()[1:]]
    return {row[0]: row for row in rows if len(row) > 1}  # without the notes below


@pytest.mark.parametrize("mark", ["run", "test"])
def test_command_installs_and_runs_in_one_line(mark):
    assert block(mark).count("\n") == 1
    assert block(mark).startswith(SETUP)


def test_test_command_runs_pytest():
    assert ".venv/bin/pytest" in block("test")
    assert "'.[test]'" in block("test")


@pytest.mark.slow
def test_run_command_prints_table(tmp_path):
    program, *arguments = block("run").removeprefix(SETUP + ". && .venv/bin/").split()
    assert program == "casswarm"
    done = casswarm_program(tmp_path, *arguments)
    printed, shown = table(done.stdout), table(block("table"))
    assert list(printed) == list(shown) == ["naive", "constrained", "leader"]
    for policy, row in shown.items():
        assert printed[policy][1] == row[1]
        # runs that depend on the last digit of a solve may differ between processors
        assert float(printed[policy][2]) == pytest.approx(float(row[2]), abs=0.002)
    for text in (done.stdout, block("table")):
        assert "constrained: 10939 infeasible steps" in text
        assert "solver failure" not in text
    pairs, shown = (table(text, "difference in success ") for text in (done.stdout, block("table")))
    assert list(pairs) == list(shown)
    for pair in list(shown)[:3]:
        assert float(pairs[pair][1]) == pytest.approx(float(shown[pair][1]), abs=0.003)


@pytest.mark.slow
def test_exact_bounds_match_evaluate():
    from casswarm import evaluate, load_scenario, plan

    after = README.split("exact bounds:")[1]
    shown = [float(number) for number in re.findall(r"\b0\.\d{4}\b", after)]
    scenario = load_scenario("paper-1")
    guide = plan(scenario)
    policies = ("naive", "constrained", "leader")
    for policy, low, high in zip(policies, shown[0:6:2], shown[1:6:2], strict=True):
        exact = evaluate(scenario, policy, 1e-3, guide=guide).success
        assert low - 2e-4 <= exact[0] <= exact[1] <= high + 2e-4


def test_example_runs(tmp_path):
    assert len([line for line in block("example").splitlines() if line.strip()]) <= 10
    (tmp_path / "example.py").write_text(block("example"))
    assert "homing" in python("example.py", folder=tmp_path).stdout


def test_repository_has_no_machine_paths():
    listed = subprocess.run(
        ["git", "ls-files"], cwd=ROOT, capture_output=True, text=True, check=False
    )
    if listed.returncode != 0:
        pytest.skip("not a git checkout")
    home = re.compile(r"/(home|root|Users|tmp)/\w")
    for name in listed.stdout.splitlines():
        path = ROOT / name
        if path.suffix in {".py", ".md", ".toml", ".cff"} and path.exists():
            assert not home.search(path.read_text(encoding="utf-8")), name
