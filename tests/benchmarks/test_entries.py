"""Manifests of the leaderboards: complete, and verified by one command."""

from __future__ import annotations

from pathlib import Path

import pytest
from commands import python

import casswarm as csw

ROOT = Path(__file__).resolve().parents[2]
MANIFESTS = sorted((ROOT / "results" / "leaderboard" / "entries").glob("*.toml"))
PROGRAM = ROOT / "benchmarks" / "entries.py"
MANIFEST = """\
kind = "policy"
name = "mine"
source = "mine:leader"
summary = "the leader policy again"
authors = ["A. Author"]
licence = "MIT"
requires = ["casswarm"]

[claims]
single-agent = {claimed}
"""
CODE = """\
import casswarm as csw

def leader(scenario, guide):
    return csw.make_policy("leader", scenario, guide)
"""


@pytest.fixture
def entries(monkeypatch):
    monkeypatch.syspath_prepend(ROOT / "benchmarks")
    import entries

    return entries


@pytest.mark.parametrize("path", MANIFESTS, ids=lambda path: path.stem)
def test_manifest_is_short_and_claims_no_more_than_the_bound(entries, path):
    entry = entries.manifest(path)
    assert len(path.read_text("utf-8").splitlines()) <= 10
    if entry["kind"] == "policy":
        for name, claimed in entry["claims"].items():
            assert claimed <= csw.success_bound(csw.load_scenario(name), max_work=0).value


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ('licence = "MIT"\n', "", "not licence"),
        ('kind = "policy"', 'kind = "game"', "kind is policy or solver, not game"),
        ("single-agent = 0.7", "single-agent = 1.1", "numbers from 0 to 1"),
        ("single-agent = 0.7", "", "one or more numbers"),
        ('["A. Author"]', '"A. Author"', "authors is no list"),
        ("kind", "kind kind", "Expected"),
    ],
)
def test_wrong_manifest_is_one_line(entries, tmp_path, old, new, message):
    path = tmp_path / "mine.toml"
    path.write_text(MANIFEST.format(claimed=0.7).replace(old, new, 1))
    with pytest.raises(SystemExit, match=message) as refused:
        entries.manifest(path)
    assert "\n" not in str(refused.value)


@pytest.mark.slow
@pytest.mark.parametrize(("claimed", "code", "holds"), [(0.7, 0, "yes"), (0.72, 1, "no")])
def test_claim_is_measured(tmp_path, claimed, code, holds):
    path = tmp_path / "mine.toml"
    path.write_text(MANIFEST.format(claimed=claimed))
    (tmp_path / "mine.py").write_text(CODE)
    done = python(PROGRAM, path, code=code)
    cells = [cell.strip() for cell in done.stdout.splitlines()[-2].split("|")]
    assert cells[1:4] == ["mine", "single-agent", str(claimed)]
    assert cells[-2] == holds


@pytest.mark.slow
def test_solver_of_an_entry_solves_what_it_claims():
    done = python(PROGRAM, *(path for path in MANIFESTS if path.stem == "ipopt"))
    assert "| ipopt | quick | 1 | 5 of 5 problems |" in done.stdout
