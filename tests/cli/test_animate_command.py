"""Animations of runs: frames, colours, sizes, and players that load nothing."""

from __future__ import annotations

import matplotlib as mpl
import numpy as np
import pytest
from commands import casswarm
from devtools import opened, references
from figure_cases import GUIDE, RUN, SCENARIO
from matplotlib.animation import FuncAnimation
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.colors import to_rgb
from matplotlib.lines import Line2D
from PIL import Image

import casswarm as csw
from casswarm._util.figure_style import MEMBERS
from casswarm.figures import player, save_gif
from casswarm.figures.animation import RunFigure
from casswarm.figures.formations import additional_agent_rates
from casswarm.results import ResultsFolder

STEPS = 4
FRAMES = 10  # three of every step, and the last one


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Results folder of two policies."""
    folder = tmp_path_factory.mktemp("animate")
    results = ResultsFolder.create("simulate", SCENARIO, folder)
    results.write_objects(guide=GUIDE, trajectories={"naive": (RUN,), "leader": (RUN, RUN)})
    results.write_record({}, {})
    return folder


@pytest.fixture(scope="module")
def gif(folder):
    """Default animation of that folder."""
    done = casswarm(folder.parent, "animate", folder.name, "--fps", 5)
    assert done.stdout == f"{folder.name}/animation-leader-0.gif\n"
    assert f"{STEPS} steps" in done.stderr
    return folder / "animation-leader-0.gif"


@pytest.fixture(scope="module")
def page():
    """The same run as a page, by the library."""
    moving = csw.animate(SCENARIO, RUN, GUIDE, steps_per_second=50)
    return player(moving, 60, title="a <run>", page=True)


def test_gif_has_three_frames_per_step_and_repeats(gif):
    with Image.open(gif) as image:
        assert image.n_frames == FRAMES
        assert image.info["loop"] == 0
        durations = []
        for number in range(FRAMES):
            image.seek(number)
            durations.append(image.info["duration"])
    assert durations == [60] * 9 + [1500]
    assert gif.stat().st_size < 1e6
    assert "animation-leader-0.gif" in (gif.parent / "run.json").read_text()


def test_gif_keeps_member_colours(gif):
    colors = np.round(255 * np.array([to_rgb(color) for color in MEMBERS[:3]]))
    with Image.open(gif) as image:
        pixels = np.asarray(image.convert("RGB")).reshape(-1, 3)
    for color in colors:
        assert (np.abs(pixels - color).max(axis=1) <= 1).any()


def test_gif_frames_differ_only_where_things_move(gif):
    frames = []
    with Image.open(gif) as image:
        for number in range(FRAMES):
            image.seek(number)
            frames.append(np.asarray(image.convert("RGB")).astype(int))
    assert all((frames[k] != frames[k + 1]).any() for k in range(FRAMES - 1))
    height = frames[0].shape[0]
    for frame in frames[1:]:  # scales and legend
        np.testing.assert_array_equal(frame[int(0.8 * height) :], frames[0][int(0.8 * height) :])


def member_marks(stage):
    """Lines of a single point."""
    lines = [artist for artist in stage.artists if isinstance(artist, Line2D)]
    return [line for line in lines if len(line.get_xdata()) == 1]


def test_stage_shows_rates_members_and_losses_of_a_step():
    stage = RunFigure(SCENARIO, RUN, GUIDE, "mine")
    limits = stage.image.get_clim()
    for step in (0, 3, 1, 2):
        stage.show(step)
        rates = additional_agent_rates(
            SCENARIO.hazard, stage.nodes, RUN.positions[step], RUN.alive[step]
        )
        np.testing.assert_array_equal(stage.image.get_array(), rates)
        assert stage.image.get_clim() == limits
    assert stage.heading.get_text() == "mine: step 2: 2 of 3 alive"
    ends = member_marks(stage)
    assert [line.get_marker() for line in ends] == ["*", "o", "X"]
    for member, line in zip((0, 2, 1), ends, strict=True):  # the lost ones are drawn last
        np.testing.assert_array_equal(np.ravel(line.get_data()), RUN.positions[2, member])
    assert len(stage.map.get_lines()) == 2 + 2 * 3  # guide and radar, paths and members


def test_stage_between_steps_moves_members_at_constant_velocity():
    stage = RunFigure(SCENARIO, RUN, GUIDE, "mine", per_step=2)
    stage.show(3)
    ends = member_marks(stage)
    halfway = (RUN.positions[1] + RUN.positions[2]) / 2
    np.testing.assert_allclose([np.ravel(line.get_data()) for line in ends], halfway)
    assert stage.heading.get_text() == "mine: step 1: 3 of 3 alive"  # the second is lost at step 2
    for frame, lost in ((3, 0), (4, 1), (5, 1), (6, 0)):
        stage.show(frame)
        crosses = [line for line in stage.closeup.axes.get_lines() if line.get_marker() == "X"]
        assert len(crosses) == lost  # during all frames of the step


@pytest.mark.slow
def test_animate_returns_a_matplotlib_animation():
    moving = csw.animate(SCENARIO, RUN, GUIDE)
    assert isinstance(moving, FuncAnimation)
    assert moving.event_source.interval == 83
    with mpl.rc_context({"animation.embed_limit": 50}):
        assert moving.to_jshtml().count("data:image/png;base64,") == FRAMES
    with pytest.raises(ValueError, match="steps_per_second = 0; allowed: above 0"):
        csw.animate(SCENARIO, RUN, steps_per_second=0)
    with pytest.raises(ValueError, match=r"steps_per_second = -1\.5; allowed: above 0"):
        csw.animate(SCENARIO, RUN, steps_per_second=np.float64(-1.5))


@pytest.mark.slow
def test_notebook_shows_an_animation_in_a_player():
    shown = csw.animate(SCENARIO, RUN, GUIDE)._repr_html_()
    assert shown.count("data:image/png;base64,") == FRAMES + 1  # the first from the start
    assert "<html" not in shown


@pytest.mark.slow
def test_animate_without_guide_or_leaders_writes_all_frames(tmp_path):
    no_leaders = type(RUN)(RUN.positions, RUN.alive, np.full(3, -1))
    path = save_gif(csw.animate(SCENARIO, no_leaders), tmp_path / "run.gif", 40)
    with Image.open(path) as image:
        assert image.n_frames == FRAMES


def test_player_embeds_frames_and_loads_nothing(page):
    assert page.count("data:image/png;base64,") == STEPS + 1  # the first is shown from the start
    assert references(page) == []
    assert "a &lt;run&gt;" in page
    assert "<run>" not in page


def test_references_finds_every_kind_of_reference():
    for text in (
        '<img src="a.png">',
        "<img src=b.png>",
        '<link rel="stylesheet" href="https://example.org/x.css">',
        "<style>@import url(x.css);</style>",
        '<p style="background: url(y.png)">',
        '<script>fetch("/data")</script>',
        '<script src="x.js"></script>',
    ):
        assert references(f"<html><head></head>{text}</html>"), text
    assert not references('<img src="data:image/png;base64,AA=="><a href="#top">top</a>')


def test_player_plays_in_a_browser(page, tmp_path):
    script = """
      const slider = document.querySelector("input");
      document.querySelector("[data-do=next]").click();
      const second = [slider.value, document.querySelector("img").src];
      document.querySelector(".casswarm-player").dispatchEvent(
        new KeyboardEvent("keydown", {key: "ArrowRight"}));
      const third = [slider.value, document.querySelector("img").src];
      window.answer = [second[0], third[0], second[1] !== third[1]];
    """
    outcome = opened(page, tmp_path, script)
    assert outcome["mistakes"] == []
    assert outcome["requests"] == []
    assert outcome["answer"] == ["1", "2", True]
    assert [image[0] > 100 for image in outcome["images"]] == [True]


@pytest.mark.slow
def test_player_with_frames_between_steps_counts_steps(tmp_path):
    page = player(csw.animate(SCENARIO, RUN, GUIDE), 30, page=True)
    assert page.count("data:image/png;base64,") == FRAMES + 1
    script = """
      const slider = document.querySelector("input"), step = document.querySelector("output");
      document.querySelector("[data-do=next]").click();
      const first = [slider.value, step.textContent, document.querySelector("img").src];
      slider.value = slider.max; slider.dispatchEvent(new Event("input"));
      const last = [slider.max, step.textContent];
      document.querySelector("[data-do=previous]").click();
      document.querySelector("[data-do=previous]").click();
      const back = document.querySelector("img").src === first[2];
      window.answer = [first[0], first[1], ...last, step.textContent, back];
    """
    outcome = opened(page, tmp_path, script, width=400)
    assert outcome["answer"] == ["1", "1", "3", "3", "1", True]
    assert outcome["wide"] <= 0


@pytest.mark.parametrize("html", [(), ("--html",)])
def test_animate_with_html_writes_one_file(folder, tmp_path, html):
    options = (*html, "--policy", "naive", "--dpi", 40, "--quiet", "--out", "run.html")
    assert casswarm(tmp_path, "animate", folder, *options).stdout == "run.html\n"
    text = (tmp_path / "run.html").read_text()
    assert references(text) == []
    assert "small, naive, run 0" in text
    assert {path.name for path in tmp_path.iterdir()} == {"run.html"}


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (("--policy", "leder"), "did you mean 'leader'"),
        (("--out", "run.gif", "--html"), "must end in .html"),
        (("--out", "run.png"), "must end in .gif, or .html for a page"),
    ],
)
def test_animate_with_wrong_options_is_explained(folder, options, message):
    assert message in casswarm(folder.parent, "animate", folder.name, *options, code=2).stderr


def test_study_is_animated_by_policy_and_run():
    study = csw.simulate(SCENARIO, ["naive", "leader"], 2, guide=GUIDE, save_trajectories=2)
    shown = csw.animate(study).shown
    assert shown.title == f"{SCENARIO.name}, leader, run 0"
    assert shown.guide is study.guide
    trajectory = study.trajectories["naive"][1]
    shown = csw.animate(study, policy="naive", run=1, steps_per_second=50).shown
    np.testing.assert_array_equal(shown.trajectory.positions, trajectory.positions)
    for options, expected in (({"run": 2}, "run 2 of 'leader'"), ({"policy": "x"}, "run 0 of 'x'")):
        with pytest.raises(ValueError, match=expected):
            csw.animate(study, **options)
    with pytest.raises(TypeError, match="name a policy= and a run="):
        csw.animate(study, trajectory)
    for arguments, options in (((SCENARIO,), {}), ((SCENARIO, RUN), {"run": 1})):
        with pytest.raises(TypeError, match="with the trajectory of a run"):
            csw.animate(*arguments, **options)
    with pytest.raises(TypeError, match="not a str"):
        csw.animate("single-agent")


def test_picture_equals_figure_that_is_drawn_as_a_whole():
    stage = RunFigure(SCENARIO, RUN, GUIDE, "mine")
    before = stage.figure.get_dpi(), stage.figure.canvas
    next(drawn := stage.pictures(60))
    drawn.close()  # as after an interrupt
    assert (stage.figure.get_dpi(), stage.figure.canvas) == before
    assert stage.map.xaxis.get_visible()
    pictures = list(stage.pictures(60))
    stage.show(2)
    stage.figure.set_dpi(60)
    canvas = FigureCanvasAgg(stage.figure)
    canvas.draw()
    difference = np.subtract(pictures[2], np.asarray(canvas.buffer_rgba())[..., :3], dtype=float)
    assert (difference != 0).mean() < 1e-3  # where tick marks touch the panels
    assert np.abs(difference).max() < 32
