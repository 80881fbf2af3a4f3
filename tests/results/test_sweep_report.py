"""The page of a sweep: its sliders choose among the computed points, in one file."""

from __future__ import annotations

import re

import pandas as pd
import pytest
from browser import opened, references
from commands import casswarm

COMMAND = ("sweep", "single-agent", "--set", "hazard.alpha_1=1,2,4", "--set", "swarm.v_max=0.1,2.0")
COMMAND += ("--policy", "naive", "--policy", "leader", "--report", "--no-figures", "--out", "out")

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


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A folder in which the command above was run; no target is reached at v_max = 0.1."""
    where = tmp_path_factory.mktemp("sweep")
    done = casswarm(where, *COMMAND)
    assert "report.html" in done.stderr
    return where / "out"


@pytest.fixture(scope="module")
def page(folder):
    return (folder / "report.html").read_text(encoding="utf-8")


def shown(row):
    return f"{row['success_low']:.4f} to {row['success_high']:.4f}"


def test_page_references_no_other_file(page):
    assert references(page) == []


def test_page_names_command_and_scenario(page):
    assert "--set hazard.alpha_1=1,2,4" in page
    assert re.search(r"at the 12 points of a sweep: proven bounds", page)


@pytest.mark.slow  # a browser
def test_sliders_show_numbers_of_table(folder, page, tmp_path):
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
def test_page_fits_a_phone(page, tmp_path):
    assert opened(page, tmp_path, width=500)["wide"] <= 0
