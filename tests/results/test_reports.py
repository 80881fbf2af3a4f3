"""The pages of a simulation and a sweep: complete, true, in one file, and the same in a browser as
on paper.
"""

from __future__ import annotations

import json
import re
import shlex
from html import unescape

import pandas as pd
import pytest
from commands import casswarm
from devtools import opened, references

from casswarm import CheckpointError, load_scenario, save_scenario
from casswarm.results import ResultsFolder, simulation_page
from casswarm.studies import paired_texts, summary_texts

SETTING = "formation.rho=0.04"
COMMAND = ("simulate", "single-agent", "--runs", "60", "--seed", "3", "--set", SETTING)
COMMAND += ("--policy", "naive", "--policy", "leader", "--report", "--out", "a <b> & c")
SWEEP = ("sweep", "single-agent", "--set", "hazard.alpha_1=1,2,4", "--set", "swarm.v_max=0.1,2.0")
SWEEP += ("--policy", "naive", "--policy", "leader", "--report", "--no-figures", "--out", "out")


def reported(where, *command):
    """Results folder, the last word, of a command that writes a page, and the page."""
    assert "report.html" in casswarm(where, *command).stderr
    folder = where / command[-1]
    return folder, (folder / "report.html").read_text(encoding="utf-8")


@pytest.fixture(scope="module")
def simulated(tmp_path_factory):
    return reported(tmp_path_factory.mktemp("report"), *COMMAND)


@pytest.fixture
def folder(simulated):
    return simulated[0]


@pytest.fixture
def page(simulated):
    return simulated[1]


@pytest.fixture(scope="module")
def swept(tmp_path_factory):
    """No target is reached at v_max = 0.1."""
    return reported(tmp_path_factory.mktemp("sweep"), *SWEEP)


def plain(page):
    """Text of a page."""
    body = re.sub(r"<style>.*?</style>", "", page, flags=re.S)
    return " ".join(unescape(re.sub(r"<[^>]+>", " ", body)).split())


def test_page_references_no_other_file(page):
    assert references(page) == []
    assert "http" not in re.sub(r'src="data:[^"]*"', "", page)
    assert "<script" not in page


def test_page_shows_tables_of_folder(folder, page):
    text = plain(page)
    for row in summary_texts(pd.read_csv(folder / "summary.csv")).itertuples(index=False):
        assert " ".join(row) in text
    for row in paired_texts(pd.read_csv(folder / "paired.csv")).itertuples(index=False):
        assert " ".join(row) in text


def test_page_shows_success_bound(folder, page):
    bound = json.loads((folder / "run.json").read_text())["result"]["success_bound"]
    assert bound["certified"]
    shown = float(re.search(r"No policy can exceed (0\.\d+) \([a-z ]+\): proven", plain(page))[1])
    assert 0 <= shown - bound["bound"] < 1e-3


def test_page_figures_have_alt_texts(page):
    images = re.findall(r'<img src="data:image/svg\+xml;base64,[^"]+" [^>]*alt="([^"]*)"', page)
    assert images == [
        "Success probability by policy",
        "Differences in success between policies",
        "Map of the rates with the guide",
        "Trajectories of the members under naive",
        "Trajectories of the members under leader",
    ]  # a single agent has no formation
    assert page.count("<figcaption>") == len(images)


def test_page_shows_command_and_versions(folder, page):
    text = plain(page)
    assert f"casswarm {shlex.join(COMMAND)}" in text
    record = json.loads((folder / "run.json").read_text())
    for name, version in record["versions"].items():
        assert f"{name} {version}" in text
    assert "seed: 3" in text
    assert "report.html" in record["files"]


def test_page_scenario_equals_simulated_one(page, tmp_path):
    text = unescape(
        re.search(r"<summary>Scenario file</summary>\s*<pre><code>(.*?)</code>", page, re.S)[1]
    )
    (tmp_path / "again.toml").write_text(text)
    key, value = SETTING.split("=")
    expected = load_scenario("single-agent").with_values({key: float(value)})
    assert load_scenario(tmp_path / "again.toml") == expected


def test_page_is_reproducible(folder, page):
    record = json.loads((folder / "run.json").read_text())["files"]
    again = simulation_page(ResultsFolder.open(folder))
    added = ", ".join(record)
    before = ", ".join(name for name in record if name != "report.html")
    assert again.replace(added, before) == page


def test_page_escapes_text_of_users(folder):
    saved = ResultsFolder.open(folder)
    scenario = saved.scenario.with_values({"description": "<script>alert(1)</script>"})
    saved.__dict__["scenario"] = scenario
    page = simulation_page(saved)
    assert "&lt;script&gt;alert(1)" in page
    assert "<script" not in page


def test_page_of_another_command_raises(tmp_path):
    (tmp_path / "run.json").write_text('{"command": "plan"}')
    with pytest.raises(CheckpointError, match="expected one written by casswarm simulate"):
        simulation_page(ResultsFolder.open(tmp_path))


def test_page_notes_counts_that_are_not_zero(folder, page):
    assert "<li>" not in page
    assert "No step was infeasible" in plain(page)
    saved = ResultsFolder.open(folder)
    summary = saved.table("summary")
    summary.loc[1, ["infeasible", "saturated"]] = 7, 1
    saved.table = {"summary": summary, "paired": saved.paired}.__getitem__
    noted = plain(simulation_page(saved))
    assert "leader: 7 infeasible steps (no feasible velocity), 1 saturated velocity (" in noted
    assert "No step was infeasible" not in noted


@pytest.mark.parametrize("width", [1280, 500])
def test_page_fits_in_a_browser(page, tmp_path, width):
    script = """
      const rights = Array.from(document.images, (i) => i.getBoundingClientRect().right);
      window.answer = Math.max(...rights) <= window.innerWidth;
    """
    found = opened(page, tmp_path, script, width)
    assert found["answer"]  # figures are not cut off
    assert found["mistakes"] == []
    assert found["requests"] == []
    assert len(found["images"]) == 5
    for natural_width, natural_height, _ in found["images"]:
        assert natural_width > 300
        assert natural_height > 100
    assert found["wide"] <= 0  # only tables scroll sideways, in their own frames


# --- a sweep

CHOOSE = """
const move = (k, value) => {
  const slider = document.querySelectorAll("#settings input")[k];
  slider.value = value; slider.dispatchEvent(new Event("input"));
};
const cells = () => Array.from(document.querySelectorAll("#rows tr"), (row) =>
  Array.from(row.cells, (cell) => cell.textContent));
const first = cells();
move(0, 2); move(1, 1);
const axis = document.getElementById("axis");
axis.value = 1; axis.dispatchEvent(new Event("change"));
window.answer = {
  first, last: cells(),
  values: Array.from(document.querySelectorAll("#settings output"), (o) => o.textContent),
  marks: document.querySelectorAll("#chart circle").length,
};
"""


def shown(row):
    return f"{row['success_low']:.4f} to {row['success_high']:.4f}"


@pytest.mark.slow
def test_page_of_sweep_names_command_and_points(swept):
    _, page = swept
    assert references(page) == []
    assert "--set hazard.alpha_1=1,2,4" in page
    assert re.search(r"at the 12 points of a sweep: proven bounds", page)


@pytest.mark.slow  # a browser
def test_sliders_show_numbers_of_table(swept, tmp_path):
    folder, page = swept
    probe = opened(page, tmp_path, CHOOSE)
    assert probe["mistakes"] == probe["requests"] == []
    answer, table = probe["answer"], pd.read_csv(folder / "sweep.csv")
    assert [float(value) for value in answer["values"]] == [4, 2]
    for cells, at in ((answer["first"], (1, 0.1)), (answer["last"], (4, 2))):
        rows = table[(table["hazard.alpha_1"] == at[0]) & (table["swarm.v_max"] == at[1])]
        assert [row[0] for row in cells] == list(rows["policy"])
        for (_, success, *_), row in zip(cells, rows.to_dict("records"), strict=True):
            assert success == (shown(row) if row["status"] == "ok" else row["reason"])
    assert answer["marks"] == 2 + 2  # of the legend; two policies at v_max = 2


@pytest.mark.slow
def test_page_of_sweep_fits_a_phone(swept, tmp_path):
    assert opened(swept[1], tmp_path, width=500)["wide"] <= 0


# --- texts of others

NAME = "a <img src=x onerror=document.title='run'> \"' {{7*7}} % é"
TEXT = f"</title></script><script>document.title = 'run'</script> {NAME} $x$ \\frac"


@pytest.mark.slow  # browsers
def test_pages_run_no_script_of_names_and_descriptions(tmp_path):
    scenario = load_scenario("single-agent").with_values({"name": NAME, "description": TEXT})
    save_scenario(scenario, tmp_path / "-s <b> p.toml")
    common = ("--policy", "naive", "--report", "--quiet")
    file = "./-s <b> p.toml"
    casswarm(tmp_path, "simulate", file, "--runs", "5", *common, "--out", "sim <i>")
    casswarm(tmp_path, "sweep", file, "--set", "hazard.alpha_1=1,2", *common, "--out", "sweep")
    casswarm(tmp_path, "animate", "sim <i>", "--html", "--out", "-run $x$.html")
    pages = list(tmp_path.rglob("*.html"))
    assert len(pages) == 3
    for number, page in enumerate(pages):
        (tmp_path / str(number)).mkdir()
        script = "window.answer = document.title"
        seen = opened(page.read_text("utf-8"), tmp_path / str(number), script)
        assert NAME in seen["answer"]
        assert seen["mistakes"] == seen["requests"] == []
