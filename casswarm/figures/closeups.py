"""Axes that show a formation close up: where its members are, and how well they protect."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any, SupportsInt

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.colors import Colormap, Normalize
from matplotlib.image import AxesImage
from matplotlib.patches import Circle
from matplotlib.transforms import ScaledTranslation

from ..chain.trajectories import RunTrajectory
from ..hazard import Hazard
from ..planning.guide import Guide
from ..scenario import Scenario
from ..typing import BoolArray, FloatArray
from .base_map import GREYS, frame, pixels
from .style import BLUE, INK, MEMBERS, VERMILION, scaled, text_outline

_PIXELS = 80
_MAX = 1.5  # share to which the edge of the danger is drawn smooth
_NEAR = 0.2  # of a window's half width: members that near share a label
OVER = "#E8A987"  # where members endanger each other
RELATIVE_RATE_NORM = Normalize(0.0, 1.0)
"""Of a lone member's rate: nobody is protected at 1; above it, members endanger each other."""


def shades() -> Colormap:
    """Colours of `RELATIVE_RATE_NORM`: the better the protection, the lighter."""
    return GREYS.with_extremes(over=OVER)


def relative_rates(
    hazard: Hazard, places: FloatArray, positions: FloatArray, alive: BoolArray
) -> FloatArray:
    """Rates that one more member would have at places (..., 2), as shares of a lone member's.

    Parameters
    ----------
    hazard : Hazard
    places : (..., 2)
    positions : (n, 2)
        Of the swarm.
    alive : (n,) bool
    """
    lone = hazard.single_agent_rates(places)
    found = np.ones_like(lone)
    return np.divide(
        additional_agent_rates(hazard, places, positions, alive), lone, out=found, where=lone > 0
    )


def additional_agent_rates(
    hazard: Hazard, places: FloatArray, positions: FloatArray, alive: BoolArray
) -> FloatArray:
    """Rates (...) that one more member would have at places (..., 2), given a swarm."""
    flat = places.reshape(-1, 2)
    others = np.broadcast_to(positions[alive], (len(flat), int(alive.sum()), 2))
    states = np.concatenate([flat[:, None], others], axis=1)
    return np.asarray(hazard.rates(states)[:, 0].reshape(places.shape[:-1]))


class Closeup:
    """Axes that show the formation of a run at a step, and can be shown another one.

    Parameters
    ----------
    axes : Axes
    scenario : Scenario
    trace : Trace
    guide : Guide or None
    half : float
        Half the width of the window.
    corridors : bool
    """

    def __init__(
        self,
        axes: Axes,
        scenario: Scenario,
        trace: RunTrajectory,
        guide: Guide | None,
        half: float,
        corridors: bool,
    ) -> None:
        self.axes, self.hazard, self.trace = axes, scenario.hazard, trace
        self.guide, self.half = guide, half
        corner = np.full(2, half)
        frame(axes, -corner, corner)
        tick = float(f"{0.7 * half:.1g}")
        axes.set(xticks=[-tick, 0, tick], yticks=[-tick, 0, tick])
        self.nodes = pixels(-corner, corner, _PIXELS)
        self.image: AxesImage = axes.imshow(
            np.ones((_PIXELS, _PIXELS)),
            norm=RELATIVE_RATE_NORM,
            cmap=shades(),
            extent=(-half, half, -half, half),
            origin="lower",
            interpolation="bilinear",
        )
        if guide is not None:
            axes.plot(0, 0, marker="+", color=BLUE, markersize=scaled(9), zorder=3)
        if corridors:
            radius = float(np.sqrt(scenario.formation.rho))
            axes.add_patch(Circle((0, 0), radius, fill=False, edgecolor=BLUE, zorder=3))
        self.artists: list[Artist] = []
        root = axes.get_figure(root=True)
        assert root is not None
        self._scale = root.dpi_scale_trans

    def show(self, step: int) -> None:
        """Show a step instead of what is shown."""
        for artist in self.artists:
            artist.remove()
        self.artists = []
        alive, center = self.trace.alive[step], middle(self.trace, self.guide, step)
        positions = self.trace.positions[step]
        found = relative_rates(self.hazard, self.nodes + center, positions, alive)
        self.image.set_data(np.minimum(found, _MAX))  # rates of collisions have no end
        before = self.trace.alive[step - 1] if step else alive
        offsets = positions - center
        self._members(offsets, alive, leader_at(self.trace, step))
        lost = before & ~alive
        self._lost(offsets, alive, lost)
        self._labels(offsets, alive, lost)
        self._labels(offsets, lost, alive, crosses=True)

    def _members(self, offsets: FloatArray, alive: BoolArray, leader: int) -> None:
        few = len(alive) <= len(MEMBERS)
        for member in np.flatnonzero(alive):
            color = MEMBERS[member] if few else BLUE
            leads = member == leader
            self.artists += self.axes.plot(
                *offsets[member],
                marker="*" if leads else "o",
                color=VERMILION if leads and not few else color,
                markeredgecolor=INK if leads else "white",
                markeredgewidth=scaled(0.8 if leads else 0.5),
                markersize=scaled(12 if leads else (6.5 if few else 3.5)),
                zorder=6 if leads else 5,
            )

    def _lost(self, offsets: FloatArray, alive: BoolArray, lost: BoolArray) -> None:
        """Crosses, beside the living where these stand at the same place."""
        for member in np.flatnonzero(lost):
            beside = self._near(offsets, offsets[member], list(np.flatnonzero(alive)))
            away_by = -scaled(7) / 72 if beside else 0.0
            shift = ScaledTranslation(away_by, away_by, self._scale)
            self.artists += self.axes.plot(
                *offsets[member],
                marker="X",
                color="white",
                markeredgecolor=INK,
                markeredgewidth=scaled(0.9),
                markersize=scaled(7.0),
                transform=self.axes.transData + shift,
                zorder=7,
            )
            self.artists[-1].set_clip_on(True)

    def _labels(
        self, offsets: FloatArray, members: BoolArray, others: BoolArray, crosses: bool = False
    ) -> None:
        """Numbers of members, once for all that stand together, clear of the others and theirs."""
        if len(members) > len(MEMBERS):
            return
        inside = np.abs(offsets).max(axis=1) < self.half
        left = list(np.flatnonzero(members & inside))
        while left:
            near = self._near(offsets, offsets[left[0]], left)
            left = [member for member in left if member not in near]
            place = offsets[near].mean(axis=0)
            x, y = place / self.half
            right, above = not (x > 0.4 or -0.6 < x < -0.05), not (y > 0.6 or -0.6 < y < -0.05)
            beside = self._near(offsets, place, list(np.flatnonzero(others)))
            if crosses:  # have theirs below them on the left, if there is room
                right, above = bool(x < -0.6), bool(y < -0.6)
            elif beside:
                right, above = bool(x < 0.6), bool(y < 0.6)
            gap = 13.0 if crosses and beside else 6.0
            self.artists.append(
                self.axes.annotate(
                    _numbers(near),
                    place,
                    ((gap if right else -gap) * scaled(), (gap - 1) * scaled(1 if above else -1)),
                    textcoords="offset points",
                    ha="left" if right else "right",
                    va="bottom" if above else "top",
                    fontsize="small",
                    path_effects=text_outline(),
                    zorder=8,
                )
            )

    def _near(self, offsets: FloatArray, place: FloatArray, members: list[Any]) -> list[Any]:
        """Those of `members` that stand near a place."""
        return [m for m in members if np.hypot(*(offsets[m] - place)) < _NEAR * self.half]


def _numbers(members: Iterable[SupportsInt]) -> str:
    """Members as they are counted from 1, neighbours as a range: 1, 3–5."""
    runs: list[list[int]] = []
    for member in map(int, members):
        if runs and member == runs[-1][-1] + 1:
            runs[-1].append(member)
        else:
            runs.append([member])
    return ", ".join(f"{run[0] + 1}–{run[-1] + 1}" if run[1:] else f"{run[0] + 1}" for run in runs)


def middle(trace: RunTrajectory, guide: Guide | None, step: int) -> FloatArray:
    """The point (2,) in the middle of the formation at a step: the guide's, or a mean."""
    if guide is not None:
        return guide.reference(step)
    alive = trace.alive[step] if trace.alive[step].any() else trace.alive[max(0, step - 1)]
    return np.asarray(trace.positions[step][alive].mean(axis=0))


def follows(trace: RunTrajectory, guide: Guide, rho: float) -> bool:
    """Whether a swarm keeps near a guide: within twice the root of `rho` at most steps."""
    away = [
        np.hypot(*(trace.positions[step][alive] - guide.reference(step)).T).min()
        for step, alive in enumerate(trace.alive)
        if alive.any()
    ]
    return bool(np.median(away) <= 2 * np.sqrt(rho))


def leader_at(trace: RunTrajectory, step: int) -> int:
    """Who leads at a step, -1 if nobody: at the last one, who led there if alive."""
    if not len(trace.leaders):
        return -1
    leader = int(trace.leaders[min(step, len(trace.leaders) - 1)])
    return leader if leader >= 0 and trace.alive[step, leader] else -1


def window(trace: RunTrajectory, guide: Guide | None) -> float:
    """Half the width of a window around the formation in which nearly everybody is, always."""
    away = [
        np.abs(trace.positions[step][trace.alive[step]] - middle(trace, guide, step)).max(axis=1)
        for step in range(len(trace.alive))
    ]
    return 1.25 * max(0.05, float(np.quantile(np.concatenate(away), 0.98)))
