"""Maps: hazard rates as shades, guides, the runs of a swarm and joint plans."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib import colormaps
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.colors import Colormap, LinearSegmentedColormap, LogNorm, Normalize
from matplotlib.figure import Figure
from matplotlib.image import AxesImage
from matplotlib.patches import Circle, Polygon, Rectangle
from matplotlib.patheffects import withStroke
from matplotlib.text import Annotation

from .._util.figure_style import (
    BLUE,
    GREY,
    INK,
    MEMBERS,
    SKY,
    VERMILION,
    AxesLike,
    add_legend,
    add_title,
    current_theme,
    heading,
    marker,
    scaled,
    single_panel,
    themed,
    wrap,
)
from .._util.numbers import rounded_up
from .._util.text import counted
from ..chain.monte_carlo import RunTrajectory
from ..grid import CostToGoMap, ValueFunction
from ..guide.guide import Candidate, Guide
from ..hazard import Hazard
from ..motion.kinematics import integrate
from ..scenario import Scenario
from ..typing import FloatArray, IntArray
from .member_paths import SHARED, add_closeup, draw_paths, path_style

_OFFSET = 10.0  # points on a page from a point to the middle of its label
_MAP = 0.62  # about the width of a map, as a fraction of its figure's


class LabelPlaces:
    """Places that labels leave free on a map of this width: off paths (..., 2) and landmarks."""

    def __init__(self, scenario: Scenario, paths: Sequence[FloatArray], width: float) -> None:
        self.distance = width * scaled(_OFFSET) / (72 * _MAP * current_theme().width)
        radars = scenario.believed.hazard.radar_positions.reshape(-1, 2)
        points = np.vstack([path.reshape(-1, 2) for path in paths])
        targets = scenario.target.discs
        self.centers = np.vstack([points, radars, [disc.center for disc in targets]])
        self.radii = np.zeros(len(self.centers))
        self.radii[len(points) :] = 0.8 * self.distance
        self.radii[-len(targets) :] += [disc.radius for disc in targets]

    def add(self, axes: Axes, text: str, point: FloatArray) -> None:
        """Write a label beside a point (2,)."""
        direction = self.clearest_direction(point)
        self.centers = np.vstack([self.centers, point + self.distance * direction])
        self.radii = np.append(self.radii, 0.8 * self.distance)
        offset = (_OFFSET * float(direction[0]), _OFFSET * float(direction[1]))
        add_label(axes, text, point, offset, outlined=True, ha="center", va="center", zorder=7)

    def clearest_direction(self, point: FloatArray) -> FloatArray:
        """Direction (2,) from a point in which a label is farthest from what it avoids."""
        angles = np.pi / 4 * np.array([7, 5, 1, 3, 6, 2, 0, 4])  # of equals the first is taken
        directions = np.stack([np.cos(angles), np.sin(angles)], axis=1)
        offsets = (point + self.distance * directions)[:, None] - self.centers
        gaps = (np.linalg.norm(offsets, axis=2) - self.radii).min(axis=1)
        return np.asarray(directions[int(np.argmax(gaps.round(9)))])


def add_label(
    axes: Axes,
    text: str,
    point: Any,
    offset: tuple[float, float],
    outlined: bool = False,
    **options: Any,
) -> Annotation:
    """Write small text at an offset, in points on a page, from a point.

    An outline makes it readable on any background. `options` are those of ``Axes.annotate``.
    """
    if outlined:
        outline = withStroke(linewidth=scaled(1.8), foreground="white", alpha=0.85)
        options["path_effects"] = [outline]
    place = (scaled(offset[0]), scaled(offset[1]))
    return axes.annotate(
        text, point, place, textcoords="offset points", fontsize="small", **options
    )


_PIXELS = 300
_CORRIDOR_POINTS = 1000  # at most, of a path whose corridor is drawn: bounds time
_CAP = 0.995  # quantile of the rates at which the scale ends: near radars they are far higher
GREYS = LinearSegmentedColormap.from_list("greys", colormaps["Greys"](np.linspace(0.0, 0.72, 256)))


def base_map(
    scenario: Scenario,
    contents: Sequence[FloatArray],
    step: int | None = None,
    ax: AxesLike | None = None,
) -> tuple[Figure, Axes]:
    """Figure with a map of the hazard rates that holds all points (..., 2) of `contents`.

    Rates that depend on time are those after `step` steps, by default the last one; of a hazard
    that is not known they are the prior means.
    """
    scenario = scenario.believed
    fig, axes = single_panel(ax=ax)
    image = draw_base_map(axes, scenario, *scenario.extent(contents), step)
    when = f" after step {_shown(scenario, step)}" if scenario.hazard.changes else ""
    add_colorbar(axes, image, f"single-agent hazard rate{when}, per unit time", extend="max")
    return fig, axes


def _shown(scenario: Scenario, step: int | None) -> int:
    return scenario.n_steps if step is None else step


def add_colorbar(axes: Axes, image: AxesImage, label: str, **options: Any) -> None:
    """Add a colorbar beside a map, as high as it; `options` are those of ``Figure.colorbar``."""
    fig = axes.get_figure(root=True)
    assert fig is not None
    beside = axes.inset_axes((1.05, 0.0, 0.03, 1.0))
    fig.colorbar(image, cax=beside, label=wrap(label, 0.42), **options)


def set_extent(axes: Axes, low: FloatArray, high: FloatArray) -> None:
    """Make axes a map with these corners."""
    axes.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), aspect="equal", xlabel="x", ylabel="y")


def pixels(low: FloatArray, high: FloatArray, number: int = _PIXELS) -> FloatArray:
    """Centres (number, number, 2) of a map's pixels, row by row from the bottom."""
    size = (high - low) / number
    axis = np.arange(number) + 0.5
    return np.stack(np.meshgrid(*(low[k] + size[k] * axis for k in (0, 1))), axis=-1)


def draw_base_map(
    axes: Axes,
    scenario: Scenario,
    low: FloatArray,
    high: FloatArray,
    step: int | None = None,
    radars: bool = True,
) -> AxesImage:
    """Make axes a map with these corners: hazard rates on a logarithmic scale, and landmarks.

    Radars that move or switch are drawn after `step` steps, by default the last one, with their
    paths; without `radars` only their paths.
    """
    set_extent(axes, low, high)
    hazard = scenario.hazard.after(_shown(scenario, step))
    rates = hazard.single_agent_rates(pixels(low, high))
    lowest = max(float(rates.min()), 1e-12 * float(rates.max())) or 1.0  # all rates may be zero
    norm = LogNorm(lowest, max(float(np.quantile(rates, _CAP)), lowest * 1.01))
    add_landmarks(axes, scenario, step=step, in_time=radars)
    return draw_field(axes, np.maximum(rates, lowest), norm)


def draw_field(
    axes: Axes, values: FloatArray, norm: Normalize, cmap: Colormap | str = GREYS
) -> AxesImage:
    """Draw values at the pixels of a map."""
    return axes.imshow(
        values,
        norm=norm,
        cmap=cmap,
        extent=(*axes.get_xlim(), *axes.get_ylim()),
        origin="lower",
        interpolation="bilinear",
    )


def add_landmarks(
    axes: Axes,
    scenario: Scenario,
    radars: str = VERMILION,
    step: int | None = None,
    in_time: bool = True,
) -> None:
    """Draw target, zones and radars; those in time after a step, unless not `in_time`."""
    for k, disc in enumerate(scenario.target.discs):
        style: dict[str, Any] = {"facecolor": "white", "edgecolor": INK, "hatch": "////"}
        style["label"] = "_" if k else "target"
        axes.add_patch(Circle(disc.center, disc.radius, **style)).set_zorder(2)
    for k, zone in enumerate(scenario.hazard_table.zone):
        style = {"facecolor": "none", "edgecolor": radars, "lw": scaled(1.1)}
        style |= {"hatch": "xx", "hatch_linewidth": 0.4, "label": "_" if k else "zone"}
        region = Circle(zone.center, zone.radius, **style) if zone.center and zone.radius else None
        axes.add_patch(region or Polygon(zone.corners, **style)).set_zorder(2)
    if not scenario.hazard.changes:
        add_radars(axes, scenario.hazard, radars)
        return
    after = [scenario.hazard.after(k) for k in range(scenario.n_steps + 1)]
    paths = np.stack([hazard.radar_positions for hazard in after], axis=1)
    for index, path in enumerate(paths[np.ptp(paths, axis=1).any(axis=1)] if len(paths) else ()):
        label = "_" if index else "path of a radar"  # a single entry of the legend
        axes.plot(*path.T, color=radars, lw=scaled(0.9), ls=":", zorder=4, label=label)
    if in_time:
        add_radars(axes, after[_shown(scenario, step)], radars)


def add_radars(axes: Axes, hazard: Hazard, color: str = VERMILION) -> list[Artist]:
    """Draw the radars of a hazard; those that are not active fainter."""
    positions = hazard.radar_positions
    on = getattr(hazard, "radar_strengths", np.ones(len(positions))) > 0
    style = marker("^", 9, color, edge="white" if color != "white" else INK)
    drawn: list[Artist] = []
    if on.any():
        drawn += axes.plot(*positions[on].T, zorder=5, label="radar", **style)
    if not on.all():
        off = axes.plot(*positions[~on].T, zorder=5, label="radar, not active", **style)
        off[0].set_alpha(0.35)
        drawn += off
    return drawn


def add_start(axes: Axes, positions: FloatArray, label: str = "start") -> None:
    """Draw initial positions (n, 2) as circles."""
    axes.plot(*positions.T, zorder=5, label=label, **marker("o", 4.5))


def add_starts(axes: Axes, scenario: Scenario, label: str) -> None:
    """Draw the initial positions of the members, in grey those of members that do not count."""
    counting = scenario.swarm.counting
    add_start(axes, scenario.positions[counting], label)
    if not counting.all():
        style = marker("o", 4.5, GREY)
        axes.plot(*scenario.positions[~counting].T, zorder=5, label="does not count", **style)


def member_name(scenario: Scenario, member: int) -> str:
    """Name of a member in a legend, with its kind if it has one."""
    kind = scenario.swarm.kind
    return f"member {member}" if kind is None else f"member {member}, {kind[member]}"


def add_corridor(axes: Axes, path: FloatArray, rho: float) -> None:
    """Draw the corridor: points within the square root of `rho` of a point of the path (T, 2)."""
    pad = 1.1 * np.sqrt(rho)
    nodes = pixels(path.min(axis=0) - pad, path.max(axis=0) + pad, 2 * _PIXELS)
    nearest = np.full(nodes.shape[:2], np.inf)
    shown = np.linspace(0, len(path) - 1, min(len(path), _CORRIDOR_POINTS)).round().astype(int)
    for point in path[shown]:
        np.minimum(nearest, ((nodes - point) ** 2).sum(axis=-1), out=nearest)
    east, north = nodes[0, :, 0], nodes[:, 0, 1]
    axes.contourf(east, north, nearest, [-1.0, rho], colors=SKY, alpha=0.45, zorder=2.5)
    axes.add_patch(Rectangle(path[0], 0, 0, color=SKY, alpha=0.45, linewidth=0, label="corridor"))


LOSSES_NEAR = 0.03  # of a map's width: loss markers this close share a label


@themed
def guide_map(
    scenario: Scenario,
    guide: Guide,
    others: Sequence[Candidate | FloatArray] = (),
    title: str | None = "",
    *,
    ax: AxesLike | None = None,
) -> Figure:
    """Guide with its corridor on the hazard rates of an isolated agent.

    Parameters
    ----------
    scenario : Scenario
    guide : Guide
    others : sequence of Candidate, or of paths (T+1, 2)
        Drawn thin and dashed; the guide itself among them is left out.
    title, ax
        As in all `casswarm.figures`.
    """
    paths = [
        integrate(guide.positions[0], other.velocities, guide.dt)
        if isinstance(other, Candidate)
        else other
        for other in others
    ]
    shape, tie = guide.positions.shape, 1e-12 * np.abs(guide.positions).max()
    paths = [p for p in paths if p.shape != shape or np.abs(p - guide.positions).max() > tie]
    shown = [guide.positions, scenario.positions, *paths]
    fig, axes = base_map(scenario, shown, guide.arrival, ax)
    for number, path in enumerate(paths):
        label = "other candidate paths" if number == 0 else None
        axes.plot(*path.T, color=INK, lw=scaled(0.9), ls=(0, (4, 3)), zorder=3, label=label)
    if scenario.n > 1:
        add_corridor(axes, guide.positions, scenario.formation.rho)
    (line,) = axes.plot(*guide.positions.T, color=BLUE, marker="o", zorder=4)
    line.set(markersize=scaled(3.2), linewidth=scaled(1.6))
    line.set_label(f"guide, {counted(guide.arrival, 'step')}")
    add_starts(axes, scenario, "initial positions" if scenario.n > 1 else "start")
    add_legend(axes)
    default = f"guide, single-agent survival {guide.survival:.3g}"
    add_title(axes, heading(title, scenario.name, default))
    return fig


@themed
def cost_to_go_map(
    scenario: Scenario,
    value: ValueFunction | CostToGoMap,
    guide: Guide,
    step: int = 0,
    title: str | None = "",
    *,
    ax: AxesLike | None = None,
) -> Figure:
    """Survival to go at a step: that of the optimal path from every position, and its direction.

    Limits of acceleration are neglected, as by `ValueFunction.velocities`. A `CostToGoMap` has its
    own step.
    """
    low, high = scenario.extent([guide.positions, scenario.positions])
    costs = (
        value
        if isinstance(value, CostToGoMap)
        else CostToGoMap.from_value_function(value, low, high, step)
    )
    default = f"optimal direction at step {costs.step}"
    fig, axes = single_panel(None, heading(title, scenario.name, default), ax)
    set_extent(axes, low, high)
    survival = np.where(costs.survival > 0, costs.survival, np.nan)
    image = draw_field(axes, survival, Normalize(0.0, 1.0), "viridis")
    image.set_extent((costs.low[0], costs.high[0], costs.low[1], costs.high[1]))
    add_colorbar(axes, image, "single-agent survival from here")
    _draw_arrows(axes, costs)
    axes.plot(*guide.positions.T, color=VERMILION, lw=scaled(1.8), zorder=4, label="guide")
    add_landmarks(axes, scenario, radars="white", step=costs.step)
    add_legend(axes)
    return fig


def _draw_arrows(axes: Axes, costs: CostToGoMap) -> None:
    """Draw velocities as arrows as long as fit side by side, outlined to be seen on any colour."""
    speeds = np.hypot(*costs.velocities.T)
    moving = speeds > 0
    spacing = np.sqrt(np.prod(costs.high - costs.low) / len(costs.positions))
    arrows = 0.7 * spacing * costs.velocities[moving] / max(float(speeds.max()), 1e-12)
    style: dict[str, Any] = {"color": "white", "edgecolor": INK, "linewidth": scaled(0.5)}
    style |= {"angles": "xy", "scale_units": "xy", "scale": 1.0, "pivot": "mid", "width": 0.005}
    style |= {"headwidth": 3.6, "headlength": 3.6, "headaxislength": 3.2}
    axes.quiver(*costs.positions[moving].T, *arrows.T, zorder=3, **style)


@themed
def comparison_map(
    scenario: Scenario,
    guides: Mapping[str, Guide],
    title: str | None = "",
    *,
    ax: AxesLike | None = None,
) -> Figure:
    """Several guides with their single-agent survival and arrival, by name.

    The default title has the best known upper bound on survival.
    """
    labels = [
        f"{name},\nsurvival {guide.survival:.3g}, {counted(guide.arrival, 'step')}"
        for name, guide in guides.items()
    ]
    paths = [guide.positions for guide in guides.values()]
    fig, axes = _paths_map(scenario, paths, labels, ax=ax)
    add_start(axes, np.unique([path[0] for path in paths], axis=0))
    add_legend(axes)
    bounds = [g.survival_bound for g in guides.values() if g.survival_bound is not None]
    bound = f"; upper bound {rounded_up(min(bounds)):.4f}" if bounds else ""
    default = f"single-agent survival of guides{bound}"
    add_title(axes, heading(title, scenario.name, default))
    return fig


@themed
def swarm_map(
    scenario: Scenario,
    trajectory: RunTrajectory,
    guide: Guide | None = None,
    title: str | None = "",
    corridors: bool = False,
    *,
    ax: AxesLike | None = None,
) -> Figure:
    """Paths of a run's members, with numbered crosses where they were destroyed.

    Paths of ghosts, members that are lost and not known to be, are dashed.

    Parameters
    ----------
    scenario : Scenario
    trajectory : RunTrajectory
    guide : Guide, optional
        Drawn dotted.
    title, ax
        As in all `casswarm.figures`.
    corridors : bool
        Whether to draw the corridor around the guide.
    """
    ends = trajectory.last_steps()
    paths = [trajectory.positions[: end + 1, member] for member, end in enumerate(ends)]
    followed = np.empty((0, 2)) if guide is None else guide.positions
    fig, axes = _paths_map(scenario, paths, contents=[followed], ax=ax)
    if guide is not None:
        if corridors:
            add_corridor(axes, guide.positions, scenario.formation.rho)
        dots = (0, (1, 4))  # paths remain visible between them
        axes.plot(*guide.positions.T, color=INK, lw=scaled(0.9), ls=dots, zorder=5, label="guide")
    _mark_losses(axes, scenario, trajectory)
    _add_ghost_paths(axes, trajectory)
    _close_up(axes, scenario, paths, followed)
    add_legend(axes)
    add_title(axes, heading(title, scenario.name, ending(trajectory)))
    return fig


def _add_ghost_paths(axes: Axes, trajectory: RunTrajectory) -> None:
    """Add a dashed path of every member from its loss until that is known."""
    few, label = trajectory.alive.shape[1] <= len(MEMBERS), "ghost"
    for member, path in enumerate(trajectory.ghost_paths()):
        if len(path) > 1:
            style = path_style(member if few else -1) | {"ls": (0, (2, 2)), "zorder": 4}
            axes.plot(*path.T, label=label, **style)
            label = "_ghost"


def ending(trajectory: RunTrajectory) -> str:
    """How a run ends, in words."""
    steps, alive = counted(len(trajectory.alive) - 1, "step"), trajectory.alive[-1]
    where = "" if trajectory.case is None else f", case {trajectory.case}"
    return f"{int(alive.sum())} of {len(alive)} alive after {steps}{where}"


@themed
def joint_map(
    scenario: Scenario,
    positions: FloatArray,
    survival: FloatArray | None = None,
    title: str | None = "",
    *,
    ax: AxesLike | None = None,
) -> Figure:
    """Paths of a joint plan up to the members' arrivals, with their survival in the legend.

    Parameters
    ----------
    scenario : Scenario
    positions : (T+1, n, 2)
    survival : (T+1, n), optional
        Survival probability of every member.
    title, ax
        As in all `casswarm.figures`.
    """
    paths, labels = [], None
    for path in np.moveaxis(positions, 1, 0):
        inside = np.flatnonzero(scenario.target.contains(path[1:]))
        paths.append(path[: inside[0] + 2] if inside.size else path)
    if survival is not None:
        labels = [
            f"{member_name(scenario, member)},\nsurvival {survival[len(path) - 1, member]:.3f}"
            for member, path in enumerate(paths)
        ]
    fig, axes = _paths_map(scenario, paths, labels, [positions.reshape(-1, 2)], ax)
    add_starts(axes, scenario, "start")
    _close_up(axes, scenario, paths, np.empty((0, 2)))
    add_legend(axes)
    add_title(axes, heading(title, scenario.name))
    return fig


def _paths_map(
    scenario: Scenario,
    paths: Sequence[FloatArray],
    labels: Sequence[str] | None = None,
    contents: Sequence[FloatArray] = (),
    ax: AxesLike | None = None,
) -> tuple[Figure, Axes]:
    """Base map with paths (T_k+1, 2), by default of members, side by side where they coincide."""
    fig, axes = base_map(scenario, [*paths, *contents], ax=ax)
    displaced = draw_paths(axes, paths, SHARED * float(np.ptp(axes.get_xlim())))
    if len(paths) > len(MEMBERS):
        axes.plot([], [], label="members", **path_style(-1))
        return fig, axes
    for member, label in enumerate(labels or [member_name(scenario, k) for k in range(len(paths))]):
        axes.plot([], [], label=label, **path_style(member))
    if displaced:
        axes.plot([], [], linestyle="", label="paths that coincide\nare drawn side by side")
    return fig, axes


def _close_up(
    axes: Axes, scenario: Scenario, paths: Sequence[FloatArray], others: FloatArray
) -> None:
    """Add a close-up of where few paths join, clear of landmarks and of `others` (N, 2)."""
    if not 1 < len(paths) <= len(MEMBERS):
        return
    cross = np.array([[0, 0], [0, 1], [1, 0], [0, -1], [-1, 0]])
    targets = [np.asarray(disc.center) + disc.radius * cross for disc in scenario.target.discs]
    radars = scenario.believed.hazard.radar_positions.reshape(-1, 2)
    obstacles = np.vstack([*targets, radars, others])
    add_closeup(axes, paths, obstacles)


def _mark_losses(axes: Axes, scenario: Scenario, trajectory: RunTrajectory) -> None:
    """Draw crosses where members were destroyed, with their numbers (large swarms: how many)."""
    lost = np.flatnonzero(~trajectory.alive[-1])
    if not lost.size:
        return
    few = trajectory.alive.shape[1] <= len(MEMBERS)
    last = trajectory.positions[trajectory.last_steps()[lost], lost]
    width = float(np.ptp(axes.get_xlim()))
    groups = clusters(last, LOSSES_NEAR * width)
    points = np.array([last[near].mean(axis=0) for near in groups])
    crosses = last if few else points
    axes.plot(*crosses.T, zorder=6, label="destroyed", **marker("X", 7 if few else 6))
    labels = LabelPlaces(scenario, [*trajectory.positions, points], width)
    for near, point in zip(groups, points, strict=True):
        numbers = ", ".join(map(str, lost[near]))
        labels.add(axes, numbers if few else count_of(near), point)


def clusters(points: FloatArray, reach: float) -> list[IntArray]:
    """Indices of points (N, 2) in groups, each within a distance of its first one."""
    groups, left = [], np.arange(len(points))
    while left.size:
        near = np.hypot(*(points[left] - points[left[0]]).T) <= reach
        groups.append(left[near])
        left = left[~near]
    return groups


def count_of(members: IntArray) -> str:
    """Text beside a cross that stands for several members."""
    return f"×{len(members)}" if len(members) > 1 else ""
