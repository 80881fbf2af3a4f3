# ruff: noqa: ARG005
"""Results as HTML for notebooks: a table and a picture for every type."""

from __future__ import annotations

import base64
import re

import pytest

import casswarm as csw
from casswarm.results.display import html

RESULTS = {
    "Scenario": lambda scenario, guide: scenario,
    "Guide": lambda scenario, guide: guide,
    "SwarmPlan": lambda scenario, guide: csw.plan_swarm(scenario, guide=guide, time_limit=1.0),
    "Study": lambda scenario, guide: csw.simulate(scenario, ["naive", "leader"], 20, guide=guide),
    "OutcomeDistribution": lambda scenario, guide: csw.evaluate(
        scenario, "leader", 0.1, guide=guide
    ),
    "Comparison": lambda scenario, guide: csw.compare("quick", ["ipopt"], problems=1),
}
WORDS = {
    "Scenario": "5",
    "Guide": "not certified",
    "SwarmPlan": "success",
    "Study": "leader",
    "OutcomeDistribution": " to ",
    "Comparison": "ipopt",
}


@pytest.fixture(scope="module")
def scenario():
    return csw.load_scenario("paper-1")


@pytest.fixture(scope="module")
def guide(scenario):
    return csw.plan(scenario, certify=False)


@pytest.mark.parametrize("name", RESULTS)
def test_display_of_result_has_table_and_picture(scenario, guide, name):
    result = RESULTS[name](scenario, guide)
    assert type(result).__name__ == name
    text = result._repr_html_()
    table = re.search(r"<table>.*</table>", text, re.S)
    assert table is not None
    assert WORDS[name] in table[0]
    (picture,) = re.findall(r'src="data:image/png;base64,([^"]+)"', text)
    assert base64.b64decode(picture).startswith(b"\x89PNG")
    assert len(repr(result).splitlines()) == 1


def test_display_of_study_notes_counts_below_the_title(scenario, guide):
    study = csw.simulate(scenario, "constrained", 5, guide=guide)
    steps = study.summary["infeasible"][0]
    text = study._repr_html_()
    assert f"<br>constrained: {steps} infeasible steps (no feasible velocity)" in text
    assert "saturated" not in text
    assert '<div style="overflow-x: auto"><table>' in text


def test_display_escapes_texts(scenario):
    text = html(scenario.with_values({"description": "<script>"}))
    assert "&lt;script&gt;" in text
    assert "<script>" not in text


def test_display_of_another_object_is_its_repr():
    assert html("<b>") == "<pre>&#x27;&lt;b&gt;&#x27;</pre>"
