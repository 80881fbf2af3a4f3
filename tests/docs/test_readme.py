"""The README's commands, example and table are true."""

import re
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
README = (ROOT / "README.md").read_text(encoding="utf-8")
BIN = Path(sys.executable).parent
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
    return {row[0]: row for row in rows}


@pytest.mark.parametrize("mark", ["run", "test"])
def test_commands_set_up_and_run_in_one_line(mark):
    assert block(mark).count("\n") == 1
    assert block(mark).startswith(SETUP)


def test_test_command_runs_these_tests():
    assert ".venv/bin/pytest" in block("test")
    assert "'.[test]'" in block("test")


def test_run_command_prints_the_readmes_table(tmp_path):
    command = block("run").removeprefix(SETUP + ". && .venv/bin/").split()
    done = subprocess.run(
        [BIN / command[0], *command[1:]], cwd=tmp_path, capture_output=True, text=True, check=True
    )
    printed, told = table(done.stdout), table(block("table"))
    assert list(printed) == list(told) == ["naive", "constrained", "leader"]
    for policy, row in told.items():
        assert printed[policy][1] == row[1]
        # runs whose fate hangs on the last digit of a solve may differ between processors
        assert float(printed[policy][2]) == pytest.approx(float(row[2]), abs=0.002)
        assert int(printed[policy][7]) == int(row[7]) == 0  # solver failures
    pairs, told = (table(text, "difference in success ") for text in (done.stdout, block("table")))
    assert list(pairs) == list(told)
    for pair in list(told)[:3]:
        assert float(pairs[pair][1]) == pytest.approx(float(told[pair][1]), abs=0.003)


def test_exact_brackets_of_the_readme_are_those_of_evaluate():
    from casswarm import evaluate, load_scenario, plan

    after = README.split("brackets of")[1]
    told = [float(number) for number in re.findall(r"\b0\.\d{4}\b", after)]
    scenario = load_scenario("paper-1")
    guide = plan(scenario)
    policies = ("naive", "constrained", "leader")
    for policy, low, high in zip(policies, told[0:6:2], told[1:6:2], strict=True):
        exact = evaluate(scenario, policy, 1e-3, guide=guide).success
        assert low - 2e-4 <= exact[0] <= exact[1] <= high + 2e-4


def test_example_runs_as_it_stands(tmp_path):
    assert len([line for line in block("example").splitlines() if line.strip()]) <= 10
    (tmp_path / "example.py").write_text(block("example"))
    done = subprocess.run(
        [sys.executable, "-W", "error", "example.py"],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    assert "homing" in done.stdout


def test_files_that_the_readme_links_exist():
    for link in re.findall(r"\]\((?!https?:)([^)]+)\)", README):
        assert (ROOT / link).exists(), link


def test_no_path_of_a_machine_is_in_the_repository():
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
