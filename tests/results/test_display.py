# ruff: noqa: ARG005
"""Results as HTML for notebooks: a table and a picture for every type."""

from __future__ import annotations

import base64
import re
from functools import cache

import pytest
from commands import PNG
from matplotlib.figure import Figure

import casswarm as csw
from casswarm._util.display import Displayed
from casswarm.figures import THEMES
from casswarm.results.notebook_display import html, view

RESULTS = {
    "Scenario": lambda scenario, guide: scenario,
    "Guide": lambda scenario, guide: guide,
    "MixedGuide": lambda scenario, guide: csw.plan(scenario, ambiguity="mean", certify=False),
    "MixedPlan": lambda scenario, guide: csw.plan_swarm_mixture(
        scenario, "mean", guide=guide, certify=False, time_limit=1.0
    ),
    "SwarmPlan": lambda scenario, guide: csw.plan_swarm(scenario, guide=guide, time_limit=1.0),
    "Study": lambda scenario, guide: csw.simulate(scenario, ["naive", "leader"], 20, guide=guide),
    "OutcomeDistribution": lambda scenario, guide: csw.evaluate(
        scenario, "leader", 0.1, guide=guide
    ),
    "Sweep": lambda scenario, guide: csw.sweep(
        scenario, {"formation.rho": [0.1, 0.2]}, ["naive"], runs=5
    ),
    "Comparison": lambda scenario, guide: csw.compare("quick", ["ipopt"], count=1),
    "Convergence": lambda scenario, guide: csw.compare("quick", ["ipopt"], count=1).convergence(),
}
WORDS = {
    "Scenario": "5",
    "Guide": "not certified",
    "MixedGuide": "not certified",
    "MixedPlan": "best single joint plan",
    "SwarmPlan": "success",
    "Study": "leader",
    "OutcomeDistribution": " to ",
    "Sweep": "formation.rho",
    "Comparison": "ipopt",
    "Convergence": "ipopt",
}


@pytest.fixture(scope="module")
def scenario():
    return csw.load_scenario("paper-1")


@pytest.fixture(scope="module")
def guide(scenario):
    return csw.plan(scenario, certify=False)


@pytest.fixture(scope="module")
def results(scenario, guide):
    """Results by the name of their type, computed when they are needed."""
    return cache(lambda name: RESULTS[name](scenario, guide))


@pytest.mark.parametrize("name", RESULTS)
def test_display_of_result_has_table_and_picture(results, name):
    result = results(name)
    assert type(result).__name__ == name
    text = result._repr_html_()
    table = re.search(r"<table>.*</table>", text, re.S)
    assert table is not None
    assert WORDS[name] in table[0]
    (picture,) = re.findall(r'src="data:image/png;base64,([^"]+)"', text)
    assert base64.b64decode(picture).startswith(b"\x89PNG")
    assert len(repr(result).splitlines()) == 1


@pytest.mark.slow
@pytest.mark.parametrize("name", RESULTS)
def test_plot_of_result_is_figure_of_theme(results, name):
    for theme, size in THEMES.items():
        figure = results(name).plot(theme=theme)
        assert isinstance(figure, Figure)
        assert figure.get_figwidth() == size.width
        with csw.figures.theme(theme):
            assert results(name).plot().get_figwidth() == size.width
    assert figure._repr_png_().startswith(PNG)  # without the backend of a notebook


@pytest.mark.parametrize("name", ["Guide", "SwarmPlan"])
def test_plot_with_scenario_draws_its_landmarks(results, scenario, name):
    labels = [
        {text.get_text() for legend in figure.legends for text in legend.get_texts()}
        for figure in (results(name).plot(), results(name).plot(scenario))
    ]
    assert "radar" not in labels[0]
    assert "radar" in labels[1]


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


def test_every_displayed_type_has_table_and_picture():
    types = [t for t in Displayed.__subclasses__() if t.__module__.startswith("casswarm.")]
    assert {t.__name__ for t in types} == set(RESULTS)
    for kind in types:
        assert view.dispatch(kind) is not view.dispatch(object)
