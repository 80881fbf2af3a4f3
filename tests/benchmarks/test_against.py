"""The benchmark of two versions, with the checkout's commit as the other one."""

from __future__ import annotations

import subprocess
from pathlib import Path

import pytest
from commands import python

ROOT = Path(__file__).parents[2]
AGAINST = ROOT / "benchmarks" / "against.py"


@pytest.mark.slow
def test_two_versions_are_timed_in_pairs() -> None:
    # on a shared machine a version can be slower than itself
    done = python(AGAINST, "HEAD", "leader-1", "--pairs", 3, code=None, timeout=600)
    assert done.returncode in (0, 1), done.stderr
    first, second, *_, row = done.stdout.split("\n\n")[0].splitlines()
    folders = [line.split(" in ")[1] for line in (first, second)]
    assert folders[0] != folders[1]
    name, checkout, commit, ratio, _, peaks, _ = [cell.strip() for cell in row.split("|")[1:-1]]
    assert name == "leader-1"
    assert checkout.endswith(" ms")
    assert commit.endswith(" ms")
    middle, _, low, _, high = ratio.replace("(", "( ").replace(")", " )").split()[:5]
    assert float(low) <= float(middle) <= float(high)
    assert all(50 < float(peak) < 5000 for peak in peaks.split(" / "))
    listed = subprocess.run(
        ["git", "-C", str(ROOT), "worktree", "list"], capture_output=True, text=True, check=True
    )
    assert not any(str(Path(folder).parents[1]) in listed.stdout for folder in folders[1:])


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["HEAD", "leader-2"], "unknown case leader-2; known: import"),
        (["HEAD", "--pairs", 0], "--pairs must be at least 1"),
        (["no-such-commit"], "no-such-commit cannot be installed: fatal: invalid reference"),
    ],
)
def test_wrong_arguments_are_explained(arguments: list[object], message: str) -> None:
    done = python(AGAINST, *arguments, code=None, timeout=600)
    assert done.returncode != 0
    assert message in done.stderr
    assert "Traceback" not in done.stderr
