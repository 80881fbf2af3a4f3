"""The glossary explains every public name and every column of a results table."""

from __future__ import annotations

import csv
import re
import subprocess
import sys
from collections.abc import Iterable
from pathlib import Path

import pytest

import casswarm
from casswarm.policies import POLICIES

ROOT = Path(__file__).resolve().parents[2]
TERMS = set(re.findall(r"`([^`]+)`", (ROOT / "docs" / "glossary.md").read_text(encoding="utf-8")))
COMMANDS = (
    "plan paper-1 --solver projected-gradient",
    "plan-swarm single-agent",
    "simulate single-agent --runs 10 --workers 1",
    "evaluate single-agent",
    "evaluate paper-1 --policy leader --max-states 50 --runs 10",
    "sweep single-agent --set n=1,2 --policy leader",
    "compare --family quick --count 1 --time-limit 5 --solver spectral",
)


def unexplained(tables: Iterable[Path]) -> dict[str, list[str]]:
    """Columns without an entry, by table; names of policies and numbers are placeholders."""
    policies = re.compile(rf"^({'|'.join(sorted(POLICIES, key=len, reverse=True))})(?=_|$)")
    missing: dict[str, list[str]] = {}
    for table in tables:
        with table.open(encoding="utf-8", newline="") as file:
            header = next(csv.reader(file))
        for column in header:
            name = re.sub(r"(?<=_)\d+", "N", policies.sub("POLICY", column))
            if name not in TERMS:
                missing.setdefault(table.name, []).append(column)
    return missing


def test_glossary_has_every_public_name() -> None:
    assert sorted(set(casswarm.__all__) - TERMS) == []


def test_glossary_has_every_policy() -> None:
    names = {re.sub(r"mpc-\d+", "mpc-H", name) for name in POLICIES}
    assert sorted(names - TERMS) == []


def test_glossary_has_every_column_of_kept_results() -> None:
    assert unexplained((ROOT / "results").glob("p*/*.csv")) == {}


@pytest.mark.slow
@pytest.mark.parametrize("command", COMMANDS)
def test_glossary_has_every_column_that_command_writes(command: str, tmp_path: Path) -> None:
    code = "from casswarm.cli import main; main(prog_name='casswarm')"
    arguments = [*command.split(), "--quiet", "--out", "results"]
    done = subprocess.run(
        [sys.executable, "-c", code, *arguments],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    tables = list((tmp_path / "results").glob("*.csv"))
    assert tables
    assert unexplained(tables) == {}
