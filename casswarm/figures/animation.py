"""Animation of a run: the members on the map, and a close-up of their formation.

Animations become GIF files, or players for browsers and notebooks, without other programs.
"""

from __future__ import annotations

import io
from collections.abc import Iterable, Iterator
from functools import cache
from pathlib import Path
from typing import Any, Protocol
from uuid import uuid4

import numpy as np
from matplotlib import rc_context
from matplotlib.animation import FuncAnimation
from matplotlib.artist import Artist
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure
from PIL import Image

from .._util.documents import data_uri, render
from .._util.figure_style import (
    BLUE,
    INK,
    MEMBERS,
    VERMILION,
    current_theme,
    marker,
    panels,
    scaled,
    settings,
    themed,
    wrap,
)
from .._util.text import counted, shown
from ..chain.monte_carlo import RunTrajectory
from ..guide.guide import Guide
from ..scenario import Scenario
from ..typing import FloatArray, Progress
from .formations import (
    COLLISION,
    Closeup,
    additional_agent_rates,
    caption,
    follows_guide,
    formation_centers,
    leader_at,
    legend_handles,
    member_marker,
    window,
)
from .maps import (
    LOSSES_NEAR,
    add_label,
    add_radars,
    clusters,
    count_of,
    draw_base_map,
    pixels,
)

_PIXELS = 110


def between(values: FloatArray, per_step: int) -> FloatArray:
    """Values (K T + 1, ...) of K frames per step, linear between those of steps (T+1, ...)."""
    frames = np.arange(per_step * (len(values) - 1) + 1)
    before, weights = np.divmod(frames, per_step)
    weights = (weights / per_step).reshape(-1, *(1,) * (values.ndim - 1))
    after = np.minimum(before + 1, len(values) - 1)
    return np.asarray(values[before] * (1 - weights) + values[after] * weights)


class RunFigure:
    """Figure with a map and a close-up that shows any frame of a run, `per_step` of every step."""

    def __init__(
        self,
        scenario: Scenario,
        trajectory: RunTrajectory,
        guide: Guide | None,
        title: str,
        per_step: int = 1,
    ) -> None:
        rho = scenario.formation.rho
        center = guide if guide and follows_guide(trajectory, guide, rho) else None
        centers = formation_centers(trajectory, center)
        self.half, self.marked = window(trajectory, centers), center is not None
        self.centers = between(centers, per_step)
        self.trajectory = RunTrajectory(
            between(trajectory.positions, per_step),
            np.repeat(trajectory.alive, per_step, axis=0)[: len(self.centers)],
            np.repeat(trajectory.leaders, per_step),
            np.repeat(trajectory.alive | trajectory.ghosts, per_step, axis=0)[: len(self.centers)],
        )
        self.scenario, self.guide, self.per_step = scenario.believed, guide, per_step
        self.title = title
        self.settings = settings(current_theme())
        self.few = trajectory.alive.shape[1] <= len(MEMBERS)
        self.artists: list[Artist] = []
        self.figure = self._build()

    @themed
    def _build(self) -> Figure:
        """Draw what all frames have in common."""
        trajectory, guide = self.trajectory, self.guide
        contents = [trajectory.positions.reshape(-1, 2)]
        if guide is not None:
            contents.append(guide.positions)
        low, high = self.scenario.extent(contents)
        self.nodes = pixels(low, high, _PIXELS)
        ratios = (1.0, (high[1] - low[1]) / (high[0] - low[0]))
        fig, (self.map, close) = panels(2, 2, 0.62, width_ratios=ratios)
        self.image = draw_base_map(self.map, self.scenario, low, high, radars=False)
        what: dict[str, Any] = {"marked": self.marked, "per_step": self.per_step}
        self.closeup = Closeup(close, self.scenario, trajectory, self.centers, self.half, **what)
        close.set_ylabel("")
        for image, label in (
            (self.image, "hazard rate of an additional agent"),
            (self.closeup.image, "relative to an isolated agent"),
        ):
            bar = fig.colorbar(image, ax=image.axes, extend="max", location="bottom", pad=0.02)
            bar.set_label(label)
        handles = [*self.map.get_legend_handles_labels()[0], *legend_handles(trajectory)]
        handles[-1].set_label("lost")
        if guide is not None:
            line = self.map.plot(*guide.positions.T, color=INK, lw=scaled(0.8), ls=":", zorder=3)
            line[0].set_label("guide")
            handles += line
        columns = 3 if current_theme().narrow else len(handles)
        fig.legend(handles=handles, loc="outside lower center", ncols=columns)
        self.heading = fig.suptitle(self._heading(0))
        return fig

    def show(self, frame: int) -> list[Artist]:
        """Show a frame."""
        with rc_context(self.settings):
            positions, alive = self.trajectory.positions[frame], self.trajectory.alive[frame]
            hazard = self.scenario.hazard.at(frame * self.scenario.time.dt / self.per_step)
            rates = additional_agent_rates(hazard, self.nodes, positions, alive)
            self.image.set_data(rates)
            self.closeup.show(frame)
            self.heading.set_text(self._heading(frame))
            for artist in self.artists:
                artist.remove()
            self.artists = add_radars(self.map, hazard) if self.scenario.hazard.changes else []
            self._draw_members(frame)
        return self.artists

    def pictures(self, dpi: int) -> Iterator[Image.Image]:
        """Pictures of all frames; what does not move is laid out and drawn once."""
        figure, axes = self.figure, (self.map, self.closeup.axes)
        before = figure.get_dpi(), figure.get_layout_engine(), figure.canvas
        canvas, axis = FigureCanvasAgg(figure), [axis for a in axes for axis in (a.xaxis, a.yaxis)]
        moving: list[Artist] = [self.heading]
        try:
            figure.set_dpi(dpi)
            with rc_context(self.settings):
                self.show(0)
                figure.draw_without_rendering()
                figure.set_layout_engine("none")
                moving += [part for a in axes for part in a.get_children() if part not in axis]
                _set_visible(moving, False)
                canvas.draw()  # type: ignore[no-untyped-call]
                _set_visible(moving, True)
            _set_visible(axis, False)
            background = canvas.copy_from_bbox(figure.bbox)  # type: ignore[no-untyped-call]
            for frame in range(len(self.centers)):
                canvas.restore_region(background)  # type: ignore[no-untyped-call]
                with rc_context(self.settings):
                    self.show(frame)
                    for artist in (*axes, self.heading):
                        figure.draw_artist(artist)
                pixels = np.asarray(canvas.buffer_rgba())  # type: ignore[no-untyped-call]
                yield Image.fromarray(pixels[..., :3].copy())
        finally:
            _set_visible([*moving, *axis], True)
            figure.set_dpi(before[0])
            figure.set_layout_engine(before[1])
            figure.set_canvas(before[2])

    def _draw_members(self, frame: int) -> None:
        """Draw the members with their paths so far, those destroyed as crosses, and ghosts."""
        alive, leader = self.trajectory.alive[frame], leader_at(self.trajectory, frame)
        ghosts, size = self.trajectory.ghosts[frame], 6.5 if self.few else 4.5
        ends = np.minimum(frame, self.trajectory.last_steps())
        for member, end in enumerate(ends):
            color = MEMBERS[member] if self.few else BLUE
            path = self.trajectory.positions[: end + 1, member]
            self.artists += self.map.plot(*path.T, color=color, lw=scaled(0.9), alpha=0.7, zorder=4)
            leads = member == leader
            if alive[member] or ghosts[member]:
                color = VERMILION if leads and not self.few else color
                style = member_marker(color, leads, size, hollow=bool(ghosts[member]))
                at = self.trajectory.positions[frame, member]
                self.artists += self.map.plot(*at, zorder=7 if leads else 6, **style)
        self._draw_lost(frame)

    def _draw_lost(self, frame: int) -> None:
        """Draw crosses of the members lost so far; one of several at a place has their number."""
        lost = np.flatnonzero(~self.trajectory.alive[frame])
        ends = np.minimum(frame, self.trajectory.last_steps())[lost]
        last = self.trajectory.positions[ends, lost]
        style = marker("X", 6.5 if self.few else 4.5, edge_width=0.7)
        for near in clusters(last, LOSSES_NEAR * float(np.ptp(self.map.get_xlim()))):
            point = last[near].mean(axis=0)
            self.artists += self.map.plot(*point, zorder=6, **style)
            label = {"ha": "left", "va": "bottom", "zorder": 8}
            self.artists.append(
                add_label(self.map, count_of(near), point, (3, 3), outlined=True, **label)
            )

    def _heading(self, frame: int) -> str:
        alive, ghosts = self.trajectory.alive[frame], int(self.trajectory.ghosts[frame].sum())
        text = f"{self.title}: {caption(frame // self.per_step, alive)}"
        return wrap(text + (f", {counted(ghosts, 'ghost')}" if ghosts else ""))


def _set_visible(artists: Iterable[Artist], visible: bool) -> None:
    for artist in artists:
        artist.set_visible(visible)


DPI = 110
_PER_STEP = 3  # frames at most
_SHORTEST = 40.0  # milliseconds of a frame
_LAST = 1500  # milliseconds for which a GIF shows the last one


class RunAnimation(FuncAnimation):
    """Animation of a run, with several frames of every step."""

    def __init__(self, shown: RunFigure, interval: float) -> None:
        super().__init__(
            shown.figure,
            shown.show,
            frames=len(shown.centers),
            init_func=lambda: [],
            interval=interval,
            repeat_delay=_LAST,
            cache_frame_data=False,
        )
        self.shown, self.interval = shown, round(interval)
        self._draw_was_started = True  # matplotlib warns of animations that it has not drawn

    def images(self, dpi: int, progress: Progress | None) -> Iterator[Image.Image]:
        """Frames in one palette, so that files are small and the background is still."""
        for frame, picture in enumerate(self.shown.pictures(dpi)):
            if progress is not None:
                progress("drawing frames", frame + 1, len(self.shown.centers))
            yield picture.quantize(palette=_palette(), dither=Image.Dither.NONE)

    def _repr_html_(self) -> str:
        """Player, which a notebook shows."""
        return player(self)


class Simulated(Protocol):
    """What is animated of a study: `casswarm.Study` has it."""

    scenario: Scenario
    guide: Guide
    trajectories: dict[str, tuple[RunTrajectory, ...]]


def animate(
    scenario: Scenario | Simulated,
    trajectory: RunTrajectory | None = None,
    guide: Guide | None = None,
    *,
    policy: str | None = None,
    run: int = 0,
    title: str = "",
    steps_per_second: float = 4.0,
) -> RunAnimation:
    """Animate a run: positions, leaders, losses, and mutual protection.

    On the left a map of the hazard rate of an additional agent, given the positions of the members
    at that time; on the right a close-up of the formation, with that rate relative to an isolated
    agent. All scales are the same in every frame. Between steps members move at constant velocity,
    in up to three frames per step.

    Parameters
    ----------
    scenario : Scenario or Study
        A study has the trajectories and the guide.
    trajectory : RunTrajectory
        For instance ``study.trajectories["leader"][0]``; of a scenario only.
    guide : Guide, optional
        Drawn on the map; if the swarm follows it, the close-up is centred on it.
    policy : str, optional
        Policy of a study's run, by default the last one.
    run : int
        Index of a study's run, one of those whose trajectories were saved.
    title : str
        By default the scenario's name, and the policy and run of a study.
    steps_per_second : float

    Returns
    -------
    RunAnimation
        A `matplotlib.animation.FuncAnimation`, which a notebook shows in a `player` where a cell
        ends with it.

    Raises
    ------
    ValueError
        `steps_per_second` is not positive; a study has no trajectory of the policy's run.
    TypeError
        A scenario without a trajectory, or a study with one.

    Examples
    --------
    >>> import casswarm as csw
    >>> study = csw.simulate(csw.load_scenario("single-agent"), "naive", runs=1)
    >>> type(csw.animate(study)).__name__
    'RunAnimation'
    """
    if not isinstance(scenario, Scenario):
        if not hasattr(scenario, "trajectories"):
            kind = type(scenario).__name__
            raise TypeError(f"animate a study, or a scenario with a run's trajectory, not a {kind}")
        if trajectory is not None or guide is not None:
            raise TypeError("a study has its trajectories and its guide: name a policy= and a run=")
        study = scenario
        name, trajectory = _saved_run(study.trajectories, policy, run)
        scenario, guide = study.scenario, study.guide
        title = title or f"{scenario.name}, {name}, run {run}"
    elif trajectory is None or policy is not None or run:
        raise TypeError(
            "animate a study, with policy= and run=, or a scenario with the trajectory of a run"
        )
    if not steps_per_second > 0:
        raise ValueError(f"steps_per_second = {shown(steps_per_second)}; allowed: above 0")
    per_step = int(np.clip(1000.0 / (steps_per_second * _SHORTEST), 1, _PER_STEP))
    figure = RunFigure(scenario, trajectory, guide, title or scenario.name, per_step)
    return RunAnimation(figure, 1000.0 / (steps_per_second * per_step))


def _saved_run(
    trajectories: dict[str, tuple[RunTrajectory, ...]], policy: str | None, run: int
) -> tuple[str, RunTrajectory]:
    """Name of a policy, by default the last one, and the trajectory of one of its runs."""
    name = policy or list(trajectories)[-1]
    saved = trajectories.get(name, ())
    if not 0 <= run < len(saved):
        has = ", ".join(f"{len(runs)} of {known!r}" for known, runs in trajectories.items())
        advice = f": simulate(..., save_trajectories={run + 1}) saves it"
        raise ValueError(
            f"the study has no trajectory of run {run} of {name!r}; it has those of {has}"
            + advice * (name in trajectories and run >= 0)
        )
    return name, saved[run]


def save_gif(
    animation: RunAnimation, path: Path | str, dpi: int = DPI, progress: Progress | None = None
) -> Path:
    """Write an animation as a GIF that repeats, with a pause at the last frame."""
    first, *others = animation.images(dpi, progress)
    durations = [animation.interval] * len(others) + [_LAST]
    first.save(path, format="GIF", save_all=True, append_images=others, duration=durations, loop=0)
    return Path(path)


def player(
    animation: RunAnimation,
    dpi: int = DPI,
    *,
    title: str = "Run of a swarm",
    page: bool = False,
    progress: Progress | None = None,
) -> str:
    """HTML that plays an animation, also step by step, with the mouse or the arrow keys.

    It is self-contained: nothing is loaded from the network.

    Parameters
    ----------
    animation : RunAnimation
        As `animate` returns it.
    dpi : int
    title : str
        Name for screen readers.
    page : bool
        Whether to return a whole page; otherwise it is an element of one, for
        ``IPython.display.HTML`` in a notebook.
    progress : Progress, optional
    """
    images = list(animation.images(dpi, progress))
    width, height = images[0].size
    return render(
        "player.html",
        name=f"run-{uuid4().hex[:8]}",
        title=title,
        page=page,
        frames=[_png_uri(image) for image in images],
        interval=animation.interval,
        per_step=animation.shown.per_step,
        width=width,
        height=height,
    )


def _png_uri(image: Image.Image) -> str:
    buffer = io.BytesIO()
    image.save(buffer, "PNG", optimize=True)
    return data_uri(buffer.getvalue(), "image/png")


@cache
def _palette() -> Image.Image:
    """Greys of the hazard rates, and the other colours of an animation with their soft edges."""
    colors = 255 * np.array([to_rgb(color) for color in (*MEMBERS, COLLISION)])
    tints = [
        weight * colors + (1 - weight) * background
        for background, weights in ((255, (1.0, 0.75, 0.5, 0.25)), (190, (0.7, 0.4)), (34, (0.5,)))
        for weight in weights
    ]
    # no grey just below white: Pillow finds the nearest colour on a coarse grid
    greys = np.append(np.linspace(20, 247, 255 - 7 * len(colors)), 255)
    palette = Image.new("P", (1, 1))
    rows = np.vstack([*tints, np.repeat(greys[:, None], 3, axis=1)])
    palette.putpalette(rows.round().astype(int).ravel().tolist())
    return palette
