"""The local page in headless Chromium: drags, keys, touch, refusals, its end, and its requests."""

from __future__ import annotations

import json
import time
from contextlib import contextmanager

import pytest
from small_scenarios import small

import casswarm as csw

pytest.importorskip("websockets", reason="needs the extra explore")

from devtools import opened_page

from casswarm.exploration.frontends import page_server
from casswarm.exploration.session import Session

pytestmark = pytest.mark.slow  # a browser, and a process that computes

GUIDE = "JSON.stringify([...document.querySelector('.csw-guide').points].map((p) => [p.x, p.y]))"
PROBLEM = "document.querySelector('.csw-problem').textContent"
UNDO = "document.querySelector('.csw-bar button')"
READY = (
    "document.querySelector('.csw') && document.querySelector('.csw').dataset.busy === 'false' "
    "&& document.querySelector('.csw-guide').points.length"
)
RADAR, MEMBER, TARGET = (f"[data-point='{name} 0']" for name in ("radar", "member", "target"))


@pytest.fixture(scope="module")
def session():
    positions = [(0.0, 0.0), (0.0, 0.4)]
    return Session(small(positions, (6.0, 0.0), [(3.0, 0.8)], 20))


@pytest.fixture(scope="module")
def address(session):
    with page_server(session) as address:
        yield address


@pytest.fixture(scope="module")
def chromium(tmp_path_factory):
    with opened_page(tmp_path_factory.mktemp("chromium")) as page:
        yield page


@pytest.fixture
def page(chromium, session, address):
    """The page of the session's first state, once its answer is complete."""
    chromium.open("about:blank")
    chromium.wait("location.href === 'about:blank'")  # events of another test's page are over
    chromium.requests.clear()
    chromium.errors.clear()
    chromium.open(address)
    while session.history.can_undo:
        session.undo()
    session.wait(120)
    chromium.wait(f"{READY} && {UNDO}.disabled", 120)
    return chromium


def guide(page):
    return json.loads(page.value(GUIDE))


def drag(page, selector, by):
    x, y = page.center(selector)
    page.drag(selector, (x + by[0], y + by[1]))


@contextmanager
def another_guide(page):
    """The block changes the guide that is drawn."""
    before = page.value(GUIDE)
    yield
    page.wait(f"{GUIDE} !== {json.dumps(before)}", 60)
    page.wait(READY, 120)


def test_radar_dragged_into_the_way_is_gone_round(page, session):
    x, y = page.center(RADAR)
    below = max(point[1] for point in guide(page))  # in pixels from the top
    _, line = page.center(TARGET)
    with another_guide(page):
        page.drag(RADAR, (x, 2 * line - y))  # its mirror image
    above = min(point[1] for point in guide(page))
    frame = page.value("document.querySelector('.csw-map').getBoundingClientRect().y")
    assert below + frame > line + 10
    assert above + frame < line - 10
    (radar,) = session.scenario.hazard_table.radars
    assert radar == pytest.approx((3.0, -0.8), abs=0.05)
    assert session.guide.positions[:, 1].max() > 0.1
    assert session.history.can_undo
    page.click(".csw-bar button")  # Undo: the whole drag is one step
    page.wait(f"{UNDO}.disabled")
    assert session.scenario == session.history.first.scenario
    assert page.errors == []


def test_numbers_are_those_of_the_library(page, session):
    survival = page.value("document.querySelector('.csw-survival').textContent")
    success = page.value("document.querySelector('.csw-success').textContent")
    planned = csw.plan(session.scenario)
    assert float(survival.split()[0]) == pytest.approx(planned.survival, abs=2e-4)
    low, high = (float(number) for number in success.split(" to "))
    exact = csw.evaluate(session.scenario, "leader", 1e-6, guide=session.guide).success
    assert low <= exact.high
    assert exact.low <= high


def test_impossible_scenario_says_why_and_keeps_last_answer(page, session):
    before = page.value(GUIDE)
    page.drag(RADAR, page.center(MEMBER))
    page.wait(f"{PROBLEM}.includes('hazard.radars[0]')")
    page.wait(READY, 120)
    refused = session.scenario.hazard_table.radars
    assert refused != ((0.0, 0.0),)
    drag(page, RADAR, (0, -5))
    page.wait(f"{PROBLEM} === ''")
    assert page.errors == []
    session.change({"swarm.v_max": 0.95, "time.t_f": 6.6})  # just enough for the straight line
    assert not session.change({"swarm.v_max": 0.5})
    page.wait(f"{PROBLEM}.includes('out of reach')")
    assert len(guide(page)) == len(json.loads(before))


def test_keyboard_alone_moves_undoes_and_chooses(page, session):
    page.value("document.body.focus()")
    for _ in range(20):
        page.key("Tab")
        if page.value("document.activeElement.dataset.point") == "radar 0":
            break
    assert page.value("document.activeElement.dataset.point") == "radar 0"
    outline = "getComputedStyle(document.activeElement.querySelector('.csw-reach')).stroke"
    assert page.value(outline) != "none"
    label = "document.activeElement.getAttribute('aria-label')"
    assert page.value(label).startswith("Radar 0 at 3, 0.8")
    with another_guide(page):
        for _ in range(4):
            page.key("ArrowDown")
    ((x, y),) = session.scenario.hazard_table.radars
    assert x == pytest.approx(3.0, abs=1e-6)
    assert y < 0.8
    page.key("z", modifiers=2)
    page.wait(f"{UNDO}.disabled")
    assert session.scenario == session.history.first.scenario
    for _ in range(30):
        page.key("Tab")
        if page.value("document.activeElement.name") == "policy":
            break
    page.key("ArrowUp")
    page.wait("document.querySelector('select[name=policy]').value === 'constrained'")
    page.wait(READY, 120)
    assert session.policy == "constrained"
    page.wait("document.querySelector('.csw-detail').textContent.startsWith('constrained')")


def test_plain_keys_stay_in_the_view_and_shortcuts_leave_it(page):
    """A notebook deletes its cell when D is typed twice, and saves with Ctrl+S."""
    page.value(
        "(window.heard = [], window.hear = (event) => window.heard.push(event.key),"
        " document.addEventListener('keydown', window.hear), null)"
    )
    for selector in (RADAR, "select[name=policy]", "input[name='swarm.v_max']", ".csw summary"):
        page.value(f"document.querySelector({selector!r}).focus()")
        for key in ("d", "d", "ArrowDown", "ArrowUp"):
            page.key(key)
        page.key("k", modifiers=2)
    assert page.value("window.heard") == ["k"] * 4
    page.value("document.removeEventListener('keydown', window.hear)")


def test_slider_changes_parameter_in_one_step(page, session):
    change = (
        "(() => { const s = document.querySelector('input[name=\"hazard.alpha_1\"]');"
        " for (const v of [120, 130, 140]) { s.value = v;"
        " s.dispatchEvent(new Event('input')); } s.dispatchEvent(new Event('change')); })()"
    )
    before = session.scenario.hazard_table.alpha_1
    number = "document.querySelector('.csw-row input[type=number]')"
    assert page.value(f"getComputedStyle({number}).boxSizing") == "border-box"  # in <details> too
    page.value(change)
    page.wait(f"!{UNDO}.disabled")
    session.wait(120)
    expected = pytest.approx(before * 4 ** (2 * 0.7 - 1), 1e-2)
    assert session.scenario.hazard_table.alpha_1 == expected
    session.undo()
    assert session.scenario == session.history.first.scenario


def test_run_plays_to_its_end(page):
    page.click(".csw-player button")
    page.wait("document.querySelectorAll('.csw-run > *').length === 2")
    page.wait("document.querySelector('.csw-player button').textContent === 'Play'", 30)
    text = page.value("document.querySelector('.csw-player output').textContent")
    step, last = text.split(",")[0].removeprefix("step ").split(" of ")
    assert step == last


def test_copied_text_is_the_scenario(page, session):
    page.click(".csw-bar button:nth-of-type(4)")
    text = page.wait("(document.querySelector('.csw-text textarea') || {}).value")
    assert text == session.scenario.to_toml()


def test_save_writes_file_and_names_it(page, session, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    page.click(".csw-bar button:nth-of-type(5)")
    page.wait("document.querySelector('.csw-notice').textContent.startsWith('saved as')")
    (file,) = tmp_path.iterdir()
    assert csw.load_scenario(file) == session.scenario
    session._file = None


def test_phone_fits_and_finger_drags(page, session):
    page.phone()
    try:
        page.wait("innerWidth === 360")
        assert page.value("document.documentElement.scrollWidth") <= 360
        x, y = page.center(RADAR)
        page.touch(RADAR, (x + 30, y - 20))
        page.wait(f"!{UNDO}.disabled")
        page.wait(READY, 120)
        ((moved_x, moved_y),) = session.scenario.hazard_table.radars
        assert moved_x > 3.2
        assert moved_y > 0.9
        assert page.value("scrollY") == 0  # the finger moved the radar, not the page
        size = page.value(
            "document.querySelector('.csw-radar .csw-reach').getBoundingClientRect().width"
        )
        assert size >= 24
    finally:
        page.call("Emulation.clearDeviceMetricsOverride")
        page.call("Emulation.setTouchEmulationEnabled", enabled=False)


def test_nothing_is_requested_from_other_hosts(page, address):
    host = address.split("/")[2]
    drag(page, RADAR, (10, 10))
    page.wait(READY, 120)
    asked = [url for url in page.requests if not url.startswith("data:")]
    assert len(asked) >= 5
    assert {url.split("/")[2] for url in asked} == {host}
    assert (
        page.value("fetch('https://example.org').then(() => 'loaded', () => 'refused')")
        == "refused"
    )


def test_closed_page_ends_the_work_and_next_one_continues(page, session, address):
    drag(page, RADAR, (0, -40))
    label = f"document.querySelector({RADAR!r}).getAttribute('aria-label')"
    before = page.value(label)
    process = session._worker._child.process
    assert process.is_alive()
    page.open("about:blank")
    end = time.monotonic() + 20
    while process.is_alive() and time.monotonic() < end:
        time.sleep(0.05)
    assert not process.is_alive()
    page.open(address)
    page.wait(READY, 120)
    assert page.value(label) == before
    assert session.history.can_undo


def test_ghosts_of_a_run_are_drawn_where_news_are_late(chromium, tmp_path):
    positions = [(0.0, 0.0), (0.0, 0.4), (0.0, -0.4)]
    radars = [(3.0, 1.0), (3.0, -1.0)]
    deadly = small(positions, (6.0, 0.0), radars, 20, hazard__alpha_1=10.0)
    session = Session(deadly)
    with page_server(session) as address:
        chromium.open(address)
        session.wait(120)
        chromium.wait(READY, 120)
        slider = "document.querySelector('input[type=range][name=\"information.delay\"]')"
        assert chromium.value(f"[{slider}.min, {slider}.max, {slider}.value].join()") == "0,20,0"
        chromium.value(f"{slider}.value = 20; {slider}.dispatchEvent(new Event('input'))")
        chromium.wait(f"{UNDO}.disabled === false", 60)
        session.wait(120)
        chromium.wait(READY, 120)
        assert session.scenario.delay is None
        (runs,) = session.study.trajectories.values()
        number, run = max(enumerate(runs), key=lambda item: item[1].ghosts.sum())
        (step, *_), _ = run.ghosts.nonzero()
        shown = (
            "const [choice, time] = ['select[aria-label=run]', '.csw-player input']"
            ".map((name) => document.querySelector(name));"
            f"choice.value = {number}; choice.dispatchEvent(new Event('change'));"
            f"time.value = {step}; time.dispatchEvent(new Event('input'));"
        )
        chromium.value(f"(() => {{ {shown} }})()")
        ghosts = int(run.ghosts[step].sum())
        assert chromium.value("document.querySelectorAll('.csw-run .csw-ghost').length") == ghosts
        assert chromium.value("document.querySelectorAll('.csw-run .csw-lost').length") == ghosts
        text = chromium.value("document.querySelector('.csw-player output').textContent")
        assert text.endswith(f"{ghosts} ghost{'s' if ghosts > 1 else ''}")
        chromium.screenshot(tmp_path / "ghosts.png")
    assert chromium.errors == []


def test_cloud_of_cases_is_dragged_and_ambiguity_slid_from_mean_to_worst(chromium, tmp_path):
    base = small([(0.0, 0.0), (0.0, 0.4)], (6.0, 0.0), [(3.0, 3.0)], 20)
    cases = [{"radars": [[3.0, 3.0], [3.0, y]], "weight": w} for y, w in ((-1.0, 3), (1.0, 1))]
    session = Session(base.with_values({"hazard.case": cases}))
    text = "document.querySelector('.csw-results').innerText"
    radars = "[...document.querySelectorAll('.csw-radar path')]"
    shades = f"{radars}.map((path) => path.getAttribute('fill-opacity'))"
    with page_server(session) as address:
        chromium.errors.clear()
        chromium.open(address)
        session.wait(120)
        chromium.wait(READY, 120)
        assert "mixture's survival, mean" in chromium.value(text)
        certain, likely, unlikely = (float(shade) for shade in chromium.value(shades))
        assert certain == likely == 1.0
        assert unlikely == pytest.approx(0.12 + 0.88 / 3)
        for share, name in ((0.5, "tv 1"), (1, "worst")):
            slider = "document.querySelector('input[type=range][name=ambiguity]')"
            chromium.value(f"{slider}.value = {share}; {slider}.dispatchEvent(new Event('input'))")
            chromium.value(f"{slider}.dispatchEvent(new Event('change'))")
            chromium.wait(f"{text}.includes({name + ':'!r})", 60)
        session.wait(120)
        chromium.wait(READY, 120)
        worst = csw.plan(session.scenario, ambiguity="worst")
        survival = chromium.value("document.querySelector('.csw-survival').textContent")
        assert float(survival.split()[0]) == pytest.approx(worst.value.low, rel=1e-3)
        paths = chromium.value("document.querySelectorAll('.csw-mixture polyline').length")
        assert paths == len(session.mixture.paths)
        before = chromium.value("document.querySelector('.csw-survival').textContent")
        drag(chromium, "[data-point='radar 1']", (0, -40))
        chromium.wait(f"document.querySelector('.csw-survival').textContent !== {before!r}", 60)
        session.wait(120)
        chromium.wait(READY, 120)
        (_, low), (_, high) = (case.scenario.hazard_table.radars for case in session.scenario.cases)
        assert high[1] - low[1] == pytest.approx(2.0)
        assert low[1] > -0.9
        rows = chromium.value("document.querySelectorAll('.csw-cases tr').length")
        assert rows == 1 + len(session.scenario.cases)
        chromium.screenshot(tmp_path / "cases.png")
    assert chromium.errors == []
