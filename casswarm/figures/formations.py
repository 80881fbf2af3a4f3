"""Formations: close-ups of their members, and several steps of a run."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Circle
from matplotlib.ticker import FixedLocator
from matplotlib.transforms import ScaledTranslation

from .._util.figure_style import (
    BLUE,
    GREY,
    INK,
    MEMBERS,
    VERMILION,
    AxesLike,
    add_legend,
    current_theme,
    heading,
    label_outer,
    marker,
    panels,
    scaled,
    themed,
)
from ..chain.monte_carlo import RunTrajectory
from ..guide.guide import Guide
from ..hazard import Hazard
from ..scenario import Scenario
from ..typing import BoolArray, FloatArray, IntArray
from .maps import GREYS, add_label, clusters, count_of, draw_field, pixels, set_extent

_PIXELS = 80
_MAX = 1.5  # relative rate up to which the boundary of dangerous regions is interpolated
_NEAR = 0.2  # of a window's half width: members this close share a label
COLLISION = "#E8A987"  # where members endanger each other
RELATIVE_RATES = GREYS.with_extremes(over=COLLISION)
"""Colours of hazard rates relative to an isolated agent: the better the protection, the lighter."""


def additional_agent_rates(
    hazard: Hazard, points: FloatArray, positions: FloatArray, alive: BoolArray
) -> FloatArray:
    """Hazard rates (...) of an agent added at points (..., 2) to a swarm at positions (n, 2)."""
    living = np.flatnonzero(alive)
    rates = hazard.of_members(living).additional_rates(points.reshape(-1, 2), positions[living])
    return np.asarray(rates.reshape(points.shape[:-1]))


def relative_rates(
    hazard: Hazard, points: FloatArray, positions: FloatArray, alive: BoolArray
) -> FloatArray:
    """Hazard rates (...) of an additional agent, relative to those of an isolated one."""
    isolated = hazard.single_agent_rates(points)
    rates = additional_agent_rates(hazard, points, positions, alive)
    return np.divide(rates, isolated, out=np.ones_like(isolated), where=isolated > 0)


class Closeup:
    """Axes, 2 `half` wide and high, that show the formation of a run at any step.

    The window's centre is one of `centers` (T+1, 2), `marked` or with a corridor around it. A loss
    is shown for `per_step` steps of the trajectory.
    """

    def __init__(
        self,
        axes: Axes,
        scenario: Scenario,
        trajectory: RunTrajectory,
        centers: FloatArray,
        half: float,
        *,
        marked: bool = False,
        corridors: bool = False,
        per_step: int = 1,
    ) -> None:
        self.axes, self.trajectory = axes, trajectory
        self.hazard = scenario.believed.hazard
        self.dt = scenario.time.dt / per_step
        self.centers, self.half, self.per_step = centers, half, per_step
        self.few = trajectory.alive.shape[1] <= len(MEMBERS)
        corner = np.full(2, half)
        set_extent(axes, -corner, corner)
        tick = float(f"{0.7 * half:.1g}")
        for axis in (axes.xaxis, axes.yaxis):
            axis.set_major_locator(FixedLocator([-tick, 0, tick]))
        self.nodes = pixels(-corner, corner, _PIXELS)
        # at 1 there is no protection; above, members endanger each other
        unit, norm = np.ones((_PIXELS, _PIXELS)), Normalize(0.0, 1.0)
        self.image = draw_field(axes, unit, norm, RELATIVE_RATES)
        if marked:
            axes.plot(0, 0, marker="+", color=BLUE, markersize=scaled(9), zorder=3)
        if corridors:
            radius = float(np.sqrt(scenario.formation.rho))
            axes.add_patch(Circle((0, 0), radius, fill=False, edgecolor=BLUE, zorder=3))
        self.artists: list[Artist] = []

    def show(self, step: int) -> None:
        """Replace what is shown by another step."""
        for artist in self.artists:
            artist.remove()
        self.artists = []
        alive, positions = self.trajectory.alive[step], self.trajectory.positions[step]
        center = self.centers[step]
        hazard = self.hazard.at(step * self.dt)
        rates = relative_rates(hazard, self.nodes + center, positions, alive)
        self.image.set_data(np.minimum(rates, _MAX))  # rates of collisions are unbounded
        lost = self.trajectory.alive[max(0, step - self.per_step)] & ~alive
        offsets = positions - center
        ghosts = self.trajectory.ghosts[step]
        self._draw(offsets, alive, leader_at(self.trajectory, step))
        self._draw(offsets, ghosts, leader_at(self.trajectory, step), hollow=True)
        self._draw_lost(offsets, alive, lost)
        if self.few:
            self._label(offsets, alive | ghosts, lost)
            self._label(offsets, lost, alive, crosses=True)

    def _draw(
        self, offsets: FloatArray, members: BoolArray, leader: int, hollow: bool = False
    ) -> None:
        for member in np.flatnonzero(members):
            leads = member == leader
            color = MEMBERS[member] if self.few else VERMILION if leads else BLUE
            style = member_marker(color, leads, 6.5 if self.few else 3.5, hollow)
            self.artists += self.axes.plot(*offsets[member], zorder=6 if leads else 5, **style)

    def _draw_lost(self, offsets: FloatArray, alive: BoolArray, lost: BoolArray) -> None:
        """Draw crosses, shifted where they would cover members that are alive."""
        style, members = marker("X", 7, edge_width=0.9), np.flatnonzero(lost)
        groups = clusters(offsets[members], _NEAR * self.half if not self.few else 0.0)
        for near in groups:
            point = offsets[members[near]].mean(axis=0)
            covers = self._near(offsets, point, np.flatnonzero(alive)).size
            shift = -scaled(7) / 72 if covers else 0.0
            translation = ScaledTranslation(shift, shift, self.axes.figure.dpi_scale_trans)
            place = self.axes.transData + translation
            self.artists += self.axes.plot(*point, transform=place, zorder=7, **style)
            if not self.few:
                below = (-13.0, -12.0) if covers else (-6.0, -5.0)
                label: dict[str, Any] = {"ha": "right", "va": "top", "zorder": 8, "outlined": True}
                text = count_of(near)
                self.artists.append(add_label(self.axes, text, point, below, **label))

    def _label(
        self, offsets: FloatArray, members: BoolArray, others: BoolArray, crosses: bool = False
    ) -> None:
        """Number members, once for all that are close, where no other label can be."""
        unlabelled = np.flatnonzero(members & (np.abs(offsets).max(axis=1) < self.half))
        while unlabelled.size:
            near = self._near(offsets, offsets[unlabelled[0]], unlabelled)
            unlabelled = np.setdiff1d(unlabelled, near)
            point = offsets[near].mean(axis=0)
            beside = self._near(offsets, point, np.flatnonzero(others)).size
            x, y = point / self.half
            if crosses:  # below on the left, unless that is outside the window
                right, above = x < -0.6, y < -0.6
            elif beside:  # above on the right
                right, above = x < 0.6, y < 0.6
            else:  # away from the centre
                right, above = not (x > 0.4 or -0.6 < x < -0.05), not (y > 0.6 or -0.6 < y < -0.05)
            gap = 13.0 if crosses and beside else 6.0
            place = (gap if right else -gap, gap - 1 if above else 1 - gap)
            style: dict[str, Any] = {"ha": "left" if right else "right", "zorder": 8}
            style |= {"va": "bottom" if above else "top", "outlined": True}
            self.artists.append(add_label(self.axes, _ranges(near), point, place, **style))

    def _near(self, offsets: FloatArray, point: FloatArray, members: IntArray) -> IntArray:
        """Members among `members` that are close to a point."""
        distances = np.hypot(*(offsets[members] - point).T)
        return np.asarray(members[distances < _NEAR * self.half])


def member_marker(color: str, leads: bool, size: float, hollow: bool = False) -> dict[str, Any]:
    """Marker of a member, a star if it leads; hollow if it is a ghost."""
    shape, size, edge, width = ("*", 12.0, INK, 0.8) if leads else ("o", size, "white", 0.5)
    return (
        marker(shape, size, "none", color, 1.1)
        if hollow
        else marker(shape, size, color, edge, width)
    )


def _ranges(numbers: IntArray) -> str:
    """Text of ascending numbers, consecutive ones as a range: 1, 3–5."""
    runs = np.split(numbers, np.flatnonzero(np.diff(numbers) > 1) + 1)
    return ", ".join(f"{run[0]}–{run[-1]}" if len(run) > 1 else f"{run[0]}" for run in runs)


def formation_centers(trajectory: RunTrajectory, guide: Guide | None) -> FloatArray:
    """Centres (T+1, 2) of the formation: the guide's points, or the means of its members."""
    if guide is not None:
        return np.stack([guide.reference(step) for step in range(len(trajectory.alive))])
    centers = []
    for step, alive in enumerate(trajectory.alive):
        shown = alive if alive.any() else trajectory.alive[max(0, step - 1)]
        centers.append(trajectory.positions[step][shown].mean(axis=0))
    return np.stack(centers)


def follows_guide(trajectory: RunTrajectory, guide: Guide, rho: float) -> bool:
    """Return True if the median of a run's least distances to the guide is <= 2 sqrt(`rho`)."""
    distances = [
        np.hypot(*(trajectory.positions[step][alive] - guide.reference(step)).T).min()
        for step, alive in enumerate(trajectory.alive)
        if alive.any()
    ]
    return bool(np.median(distances) <= 2 * np.sqrt(rho))


def leader_at(trajectory: RunTrajectory, step: int) -> int:
    """Leader at a step, or -1; at the last step the previous leader if it is believed to live."""
    if not len(trajectory.leaders):
        return -1
    leader = int(trajectory.leaders[min(step, len(trajectory.leaders) - 1)])
    believed = trajectory.alive[step] | trajectory.ghosts[step]
    return leader if leader >= 0 and believed[leader] else -1


def window(trajectory: RunTrajectory, centers: FloatArray) -> float:
    """Half the width of a window around the formation that nearly always holds all members."""
    distances = [
        np.abs(trajectory.positions[step][alive] - centers[step])
        for step, alive in enumerate(trajectory.alive)
    ]
    return 1.25 * max(0.05, float(np.quantile(np.concatenate(distances).max(axis=1), 0.98)))


@themed
def formation_chart(
    scenario: Scenario,
    trajectory: RunTrajectory,
    guide: Guide | None = None,
    title: str | None = "",
    *,
    steps: Sequence[int] | None = None,
    corridors: bool = False,
    ax: AxesLike | None = None,
) -> Figure:
    """Close-ups of the formation at several steps, centred on the guide.

    Shades are the hazard rate that an additional agent would have, relative to an isolated agent:
    the lighter, the better the swarm protects. Members close to each other share a label.

    Parameters
    ----------
    scenario : Scenario
    trajectory : RunTrajectory
    guide : Guide, optional
        Centre of every panel; by default that is the mean of the members alive.
    title, ax
        As in all `casswarm.figures`.
    steps : sequence of int, optional
        By default the first and the last, those at which members are lost, and some in between.
    corridors : bool
        Whether to draw the corridor around the guide.

    Raises
    ------
    ValueError
        A step is beyond the end of the run.
    """
    narrow = current_theme().narrow
    across = max(2, min(4, int(current_theme().characters / 22)))  # captions fit
    if steps is None:
        steps = representative_steps(trajectory, 6 if across == 3 else 8)
    chosen = list(steps)
    last = len(trajectory.alive) - 1
    if not chosen or min(chosen) < 0 or max(chosen) > last:
        raise ValueError(f"steps = {chosen}; allowed: from 0 to {last}, at least 1")
    columns = min(across, len(chosen))
    shape = (1.05 if narrow else 0.95) * -(-len(chosen) // columns) / columns
    aspect = shape + (0.16 if narrow else 0.06)
    text = heading(title, scenario.name, formation_title(guide))
    fig, axes = panels(len(chosen), columns, aspect, text, ax, sharex=True, sharey=True)
    centers = formation_centers(trajectory, guide)
    half = window(trajectory, centers)
    what = {"marked": guide is not None, "corridors": corridors}
    for panel, step in zip(axes, chosen, strict=True):
        Closeup(panel, scenario, trajectory, centers, half, **what).show(step)
        panel.set_title(caption(step, trajectory.alive[step]), fontsize="small")
        label_outer(panel)
    fig.colorbar(
        axes[0].images[0],
        ax=axes,
        extend="max",
        location="bottom" if narrow else "right",
        pad=0.02,
        label="hazard rate\nrelative to an isolated agent",
    )
    handles = legend_handles(trajectory, guide is not None, corridors)
    add_legend(axes[-1], handles, 2 if narrow else len(handles))
    return fig


def formation_title(guide: Guide | None) -> str:
    """What close-ups are centred on, in words."""
    return f"formation around {'its mean' if guide is None else 'the guide'}"


def representative_steps(trajectory: RunTrajectory, number: int) -> list[int]:
    """First and last step, those of losses, and others in between, as evenly as possible."""
    last = len(trajectory.alive) - 1
    losses = np.flatnonzero((trajectory.alive[:-1] & ~trajectory.alive[1:]).any(axis=1)) + 1
    if len(losses) > number - 2:
        losses = losses[np.linspace(0, len(losses) - 1, number - 2).round().astype(int)]
    chosen = {0, last, *map(int, losses)}
    while len(chosen) < min(number, last + 1):
        steps = sorted(chosen)
        gaps = np.diff(steps)
        widest = int(np.argmax(gaps))
        chosen.add(steps[widest] + int(gaps[widest]) // 2)
    return sorted(chosen)


def caption(step: int, alive: BoolArray) -> str:
    """Number of a step, and of the members alive (n,) then."""
    return f"step {step}: {int(alive.sum())} of {len(alive)} alive"


def legend_handles(
    trajectory: RunTrajectory, guide: bool = False, corridors: bool = False
) -> list[Line2D]:
    """Handles of a legend of close-ups of a run."""
    styles = {"leader": marker("*", 11, GREY)} if (trajectory.leaders >= 0).any() else {}
    styles |= {"alive": marker("o", 6.5, GREY, "white"), "lost in this step": marker("X", 7.5)}
    if trajectory.ghosts.any():
        styles = {"ghost": marker("o", 6.5, "none", GREY)} | styles
    if guide:
        styles["guide"] = marker("+", 9, edge=BLUE)
    edge = {"markeredgewidth": 1.0}  # the same in all themes
    handles = [Line2D([], [], label=label, **style | edge) for label, style in styles.items()]
    if corridors:
        handles.append(Line2D([], [], color=BLUE, lw=scaled(0.8), label="corridor"))
    return handles
