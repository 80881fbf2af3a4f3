"""Figure of a run with a map of its members and a close-up of their formation, frame by frame."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib import rc_context
from matplotlib.artist import Artist
from matplotlib.figure import Figure

from ..chain.trajectories import RunTrajectory
from ..planning.guide import Guide
from ..scenario import Scenario
from ..typing import FloatArray
from .base_map import draw_base_map, extent, pixels
from .closeups import (
    Closeup,
    additional_agent_rates,
    follows_guide,
    formation_centers,
    leader_at,
    window,
)
from .formations import caption, legend_handles
from .style import (
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
        )
        self.scenario, self.guide, self.per_step = scenario, guide, per_step
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
        low, high = extent(self.scenario, contents)
        self.nodes = pixels(low, high, _PIXELS)
        ratios = (1.0, (high[1] - low[1]) / (high[0] - low[0]))
        fig, (self.map, close) = panels(2, 2, 0.62, width_ratios=ratios)
        self.image = draw_base_map(self.map, self.scenario, low, high)
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
            rates = additional_agent_rates(self.scenario.hazard, self.nodes, positions, alive)
            self.image.set_data(rates)
            self.closeup.show(frame)
            self.heading.set_text(self._heading(frame))
            for artist in self.artists:
                artist.remove()
            self.artists = []
            self._draw_members(frame)
        return self.artists

    def _draw_members(self, frame: int) -> None:
        """Draw the members with their paths so far, those destroyed as crosses."""
        alive, leader = self.trajectory.alive[frame], leader_at(self.trajectory, frame)
        ends = np.minimum(frame, self.trajectory.last_steps())
        for member, end in enumerate(ends):
            color = MEMBERS[member] if self.few else BLUE
            path = self.trajectory.positions[: end + 1, member]
            self.artists += self.map.plot(*path.T, color=color, lw=scaled(0.9), alpha=0.7, zorder=4)
            leads, size = member == leader, 6.5 if self.few else 4.5
            if leads:
                style = marker("*", 11, color if self.few else VERMILION, edge_width=0.7)
            elif alive[member]:
                style = marker("o", size, color, "white", 0.7)
            else:
                style = marker("X", size, edge_width=0.7)
            self.artists += self.map.plot(*path[-1], zorder=7 if leads else 6, **style)

    def _heading(self, frame: int) -> str:
        alive = self.trajectory.alive[frame]
        return f"{self.title}: {caption(frame // self.per_step, alive)}"
