"""`casswarm reproduce` in a process of its own."""

import json

import pandas as pd
import pytest
from commands import PNG, casswarm
from PIL import Image
from reproduced import CHECKED_IN, checked_in

from casswarm.reproduction import TABLES, Reproduction, page
from casswarm.reproduction.reproduce import FIGURES

QUICK = ("table-1", "geometry", "table-2", "infeasible", "readings", "figures")


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """A folder in which the quick parts were made twice, and what was printed."""
    folder = tmp_path_factory.mktemp("reproduced")
    names = [word for name in QUICK for word in ("--only", name)]
    first = casswarm(folder, "reproduce", *names)
    options = names[:-2], ("--out", "again", "--json", "--quiet")  # the figures once
    second = casswarm(folder, "reproduce", *options[0], *options[1], "--width", "column")
    return folder, first, second


def test_it_prints_tables_and_tells_progress_on_standard_error(made):
    _, first, second = made
    assert "Table II: success probabilities in scenario I" in first.stdout
    assert "0.32 (0.208 to 0.458)" in first.stdout
    assert " s  table-2" in first.stderr
    assert second.stderr == ""
    result = json.loads(second.stdout)["result"]
    assert [row["policy"] for row in result["table-2"]] == ["naive", "constrained", "leader"]


def test_it_leaves_tables_figures_and_how_they_were_made(made):
    results = made[0] / "results" / "paper"
    for name in QUICK[:-1]:
        assert list(pd.read_csv(results / f"{name}.csv").columns) == list(checked_in(name).columns)
    for number in range(1, 5):
        assert (results / f"figure-{number}.png").read_bytes().startswith(PNG)
    record = json.loads((results / "run.json").read_text())
    assert record["inputs"] == {"runs": 10_000, "only": list(QUICK), "seed": 0}
    assert {"casswarm", "casadi", "numpy"} <= set(record["versions"])
    assert not (results / "README.md").exists()


def test_figures_have_the_width_that_is_asked_for(made):
    for folder, inches in (("results/paper", 7.16), ("again", 3.5)):
        with Image.open(made[0] / folder / "table-2.png") as image:
            assert image.width == pytest.approx(200 * inches, abs=1)


def test_they_are_not_drawn_again_from_the_folder_and_that_is_told(made):
    done = casswarm(made[0], "plot", "results/paper", code=2)
    assert "casswarm reproduce again, which takes --format, --width and --dpi" in done.stderr


def test_twice_gives_the_same_bytes(made):
    folder = made[0]
    for path in sorted((folder / "again").glob("*.csv")):
        assert path.read_bytes() == (folder / "results" / "paper" / path.name).read_bytes()


def test_tables_are_those_checked_in(made):
    for name in ("table-1", "geometry", "readings"):
        text = (made[0] / "again" / f"{name}.csv").read_text()
        assert text == (CHECKED_IN / f"{name}.csv").read_text()


def test_unknown_part_is_told_with_what_there_is(tmp_path):
    done = casswarm(tmp_path, "reproduce", "--only", "table-3", code=2)
    assert "--only 'table-3' is unknown" in done.stderr
    assert "table-2" in done.stderr
    assert not (tmp_path / "results").exists()


def test_page_checked_in_is_that_of_its_tables():
    """The words of README.md follow from the tables beside it."""

    class OfGuide:
        survival = checked_in("beyond")["guide_survival"][0]

    found = Reproduction(
        {name: checked_in(name).fillna("") for name in TABLES},
        dict.fromkeys(FIGURES),
        OfGuide(),
        10_000,
        0,
    )
    assert found.complete
    assert page(found) == (CHECKED_IN / "README.md").read_text(encoding="utf-8")
