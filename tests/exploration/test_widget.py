"""The widget: the page's module as a notebook gets it, and the present objects."""

from __future__ import annotations

import re

import pytest
from small_scenarios import three_members

import casswarm as csw
from casswarm.exploration.frontends import static_text

pytest.importorskip("anywidget", reason="needs the extra explore")


@pytest.fixture
def widget():
    made = csw.explore(three_members(), "naive")
    yield made
    made.close()


def test_widget_has_present_scenario_and_module_of_the_page(widget):
    assert widget.scenario == three_members()
    assert widget.session.policy == "naive"
    widget.session.move("radar", 0, (1.2, 1.0))
    assert widget.scenario.hazard_table.radars == ((1.2, 1.0),)
    assert widget._esm == static_text("explore.js")
    assert widget._css == static_text("explore.css")


def test_module_loads_nothing():
    text = static_text("explore.js") + static_text("explore.css")
    assert not re.search(r"\bimport\b|fetch\(|url\(|@import", text)
    assert set(re.findall(r"https?://[^\"]*", text)) == {"http://www.w3.org/2000/svg"}


def test_messages_of_the_front_end_reach_the_session(widget, monkeypatch):
    sent = []
    monkeypatch.setattr(widget._view, "_send", sent.append)
    change = {"type": "change", "key": "swarm.a_max", "value": 0.4, "number": 1}
    widget._handle_custom_msg(change, [])
    assert widget.scenario.swarm.a_max == 0.4
    assert sent == [{"handled": 1}]


def test_revision_is_a_trait_that_the_front_end_sets(widget):
    seen = []
    widget.observe(lambda change: seen.append(change["new"]), "revision")
    widget.session.move("radar", 0, (1.2, 1.0))
    assert seen == []  # the view says when nothing moves any more
    widget._handle_msg(
        {"content": {"data": {"method": "update", "state": {"revision": 1}}}, "buffers": []}
    )
    assert seen == [widget.session.revision] == [1]


@pytest.mark.slow
def test_guide_and_study_wait_until_they_are_computed(widget):
    widget.session.choose_policy("leader")
    assert widget.guide.risk == pytest.approx(csw.plan(widget.scenario).risk, rel=1e-6)
    assert list(widget.study.summary["policy"]) == ["leader"]
