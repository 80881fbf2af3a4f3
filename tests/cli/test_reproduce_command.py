"""casswarm reproduce as a user runs it."""

import json

import pandas as pd
import pytest
from commands import PNG, casswarm
from PIL import Image
from reproduced import CHECKED_IN, checked_in

from casswarm.reproduction import FIGURES, TABLES, Reproduction, page

QUICK = ("table-1", "geometry", "infeasible", "interpretations")
PARTS = ("table-1", "geometry", "table-2", "infeasible", "interpretations", "figures")


def twice(folder, parts):
    """A folder with some parts, reproduced twice (the figures once), and what was printed."""
    names = [word for name in parts for word in ("--only", name)]
    first = casswarm(folder, "reproduce", *names)
    tables = names[:-2] if parts[-1] == "figures" else names
    options = "--out", "again", "--json", "--quiet", "--width", "column"
    return folder, first, casswarm(folder, "reproduce", *tables, *options)


@pytest.fixture(scope="module")
def quick(tmp_path_factory):
    return twice(tmp_path_factory.mktemp("quick"), QUICK)


@pytest.fixture(scope="module")
def reproduced(tmp_path_factory):
    return twice(tmp_path_factory.mktemp("reproduced"), PARTS)


@pytest.mark.slow
def test_reproduce_prints_tables_and_progress(reproduced):
    _, first, second = reproduced
    assert "Table II: success probabilities in scenario I" in first.stdout
    assert "0.32 (0.208 to 0.458)" in first.stdout
    assert " s  table-2" in first.stderr
    assert second.stderr == ""
    result = json.loads(second.stdout)["result"]
    assert [row["policy"] for row in result["table-2"]] == ["naive", "constrained", "leader"]


@pytest.mark.slow
def test_reproduce_writes_tables_figures_and_record(reproduced):
    results = reproduced[0] / "results" / "reproduce"
    for name in PARTS[:-1]:
        assert list(pd.read_csv(results / f"{name}.csv").columns) == list(checked_in(name).columns)
    for number in range(1, 5):
        assert (results / f"figure-{number}.png").read_bytes().startswith(PNG)
    record = json.loads((results / "run.json").read_text())
    assert record["inputs"] == {"runs": 2000, "only": list(PARTS), "seed": 0}
    assert {"casswarm", "casadi", "numpy"} <= set(record["versions"])
    assert not (results / "README.md").exists()


@pytest.mark.slow
def test_reproduce_figures_have_requested_width(reproduced):
    for folder, inches in (("results/reproduce", 7.16), ("again", 3.5)):
        with Image.open(reproduced[0] / folder / "table-2.png") as image:
            assert image.width == pytest.approx(200 * inches, abs=1)


@pytest.mark.slow
def test_plot_of_reproduce_is_refused_with_advice(reproduced):
    done = casswarm(reproduced[0], "plot", "results/reproduce", code=2)
    assert "casswarm reproduce again, which takes --format, --width and --dpi" in done.stderr


@pytest.mark.slow
@pytest.mark.parametrize("parts", ["quick", pytest.param("reproduced", marks=pytest.mark.slow)])
def test_reproduce_twice_gives_same_tables(parts, request):
    folder = request.getfixturevalue(parts)[0]
    for path in sorted((folder / "again").glob("*.csv")):
        assert path.read_bytes() == (folder / "results" / "reproduce" / path.name).read_bytes()


def test_reproduce_writes_beside_what_the_repository_has(quick):
    assert [path.name for path in (quick[0] / "results").iterdir()] == ["reproduce"]


def test_reproduced_tables_equal_those_in_repository(quick):
    for name in ("table-1", "geometry", "interpretations"):
        text = (quick[0] / "again" / f"{name}.csv").read_text()
        assert text == (CHECKED_IN / f"{name}.csv").read_text()


def test_report_in_repository_follows_from_tables():
    """The text of README.md follows from the tables beside it."""

    class OfGuide:
        survival = checked_in("beyond")["guide_survival"][0]

    tables = {name: checked_in(name) for name in TABLES}
    tables["interpretations"] = tables["interpretations"].fillna("")
    reproduction = Reproduction(
        tables,
        dict.fromkeys(FIGURES),
        OfGuide(),
        2000,
        0,
    )
    assert reproduction.complete
    assert page(reproduction) == (CHECKED_IN / "README.md").read_text(encoding="utf-8")
