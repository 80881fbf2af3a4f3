"""The page of a simulation: complete, true, in one file, and the same in a browser as on paper."""

from __future__ import annotations

import json
import re
import shlex
from html import unescape

import pandas as pd
import pytest
from browser import opened, references
from commands import casswarm

from casswarm import CheckpointError, load_scenario
from casswarm.results.folder import Saved
from casswarm.results.simulation_report import paired_rows, simulation_page, summary_rows

SETTING = "formation.rho=0.04"
COMMAND = ("simulate", "single-agent", "--runs", "60", "--seed", "3", "--set", SETTING)
COMMAND += ("--policy", "naive", "--policy", "leader", "--report", "--out", "a <b> & c")


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A folder in which the command above was run."""
    where = tmp_path_factory.mktemp("report")
    done = casswarm(where, *COMMAND)
    assert "report.html" in done.stderr
    return where / "a <b> & c"


@pytest.fixture(scope="module")
def page(folder):
    return (folder / "report.html").read_text(encoding="utf-8")


def plain(page):
    """The words of a page."""
    body = re.sub(r"<style>.*?</style>", "", page, flags=re.S)
    return " ".join(unescape(re.sub(r"<[^>]+>", " ", body)).split())


def test_the_page_needs_nothing_but_itself(page):
    assert references(page) == []
    assert "http" not in re.sub(r'src="data:[^"]*"', "", page)
    assert "<script" not in page


def test_the_page_has_the_tables_of_the_folder(folder, page):
    text = plain(page)
    for row in summary_rows(pd.read_csv(folder / "summary.csv")):
        assert " ".join(row.values()) in text
    for row in paired_rows(pd.read_csv(folder / "paired.csv")):
        assert " ".join(row.values()) in text


def test_the_page_tells_what_no_policy_can_exceed(folder, page):
    bound = json.loads((folder / "run.json").read_text())["result"]["success_bound"]
    assert bound["certified"]
    told = float(re.search(r"No policy can exceed (0\.\d+): proven", plain(page))[1])
    assert 0 <= told - bound["bound"] < 1e-3


def test_the_page_has_every_figure_with_words_for_who_cannot_see_it(page):
    images = re.findall(r'<img src="data:image/svg\+xml;base64,[^"]+" [^>]*alt="([^"]*)"', page)
    assert images == [
        "Success probability by policy",
        "Differences in success between policies",
        "Map of the rates with the guide",
        "The way of the members under naive",
        "The way of the members under leader",
    ]  # a lone member has no formation
    assert page.count("<figcaption>") == len(images)


def test_the_page_tells_how_to_make_it_again(folder, page):
    text = plain(page)
    assert f"casswarm {shlex.join(COMMAND)}" in text
    record = json.loads((folder / "run.json").read_text())
    for name, version in record["versions"].items():
        assert f"{name} {version}" in text
    assert "seed: 3" in text
    assert "report.html" in record["files"]


def test_the_scenario_of_the_page_is_the_one_that_was_simulated(page, tmp_path):
    text = unescape(
        re.search(r"<summary>Scenario file</summary>\s*<pre><code>(.*?)</code>", page, re.S)[1]
    )
    (tmp_path / "again.toml").write_text(text)
    key, value = SETTING.split("=")
    expected = load_scenario("single-agent").with_values({key: float(value)})
    assert load_scenario(tmp_path / "again.toml") == expected


def test_the_same_results_make_the_same_page(folder, page):
    record = json.loads((folder / "run.json").read_text())["files"]
    again = simulation_page(Saved.of(folder))
    added = ", ".join(record)
    before = ", ".join(name for name in record if name != "report.html")
    assert again.replace(added, before) == page


def test_texts_of_users_are_shown_and_not_obeyed(folder):
    saved = Saved.of(folder)
    scenario = saved.scenario.with_values({"description": "<script>alert(1)</script>"})
    saved.__dict__["scenario"] = scenario
    page = simulation_page(saved)
    assert "&lt;script&gt;alert(1)" in page
    assert "<script" not in page


def test_only_a_simulation_has_this_page(tmp_path):
    (tmp_path / "run.json").write_text('{"command": "plan"}')
    with pytest.raises(CheckpointError, match="give one that casswarm simulate left"):
        simulation_page(Saved.of(tmp_path))


@pytest.mark.parametrize("width", [1200, 500])
def test_the_page_is_whole_in_a_browser(page, tmp_path, width):
    found = opened(page, tmp_path, width=width)
    assert found["mistakes"] == []
    assert found["requests"] == []
    assert len(found["images"]) == 5
    for natural_width, natural_height, _ in found["images"]:
        assert natural_width > 300
        assert natural_height > 100
    assert found["wide"] <= 0  # only tables and figures scroll sideways, in their own frames
