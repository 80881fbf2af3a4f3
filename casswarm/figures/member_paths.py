"""Paths of members on a map: side by side where they coincide, and close up where they join."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.patches import PathPatch
from matplotlib.path import Path
from matplotlib.patheffects import AbstractPathEffect
from matplotlib.transforms import IdentityTransform

from .._util.figure_style import BLUE, INK, MEMBERS, scaled
from ..typing import FloatArray

_LINE = 1.1  # points on a page: width of a path
_GAP = 1.6  # points on a page: between the middles of paths side by side
SHARED = 0.008  # of a map's width: paths this close are drawn side by side
_INSET = 0.4  # side of a close-up, as a fraction of the map's shorter side
_LEAST_ZOOM = 1.5  # below, a close-up shows no more than the map


class SideShift(AbstractPathEffect):
    """Shift of a path to its left, by a distance in points for every vertex."""

    def __init__(self, distances: FloatArray) -> None:
        super().__init__()
        self.distances = distances

    def draw_path(
        self, renderer: Any, gc: Any, tpath: Path, affine: Any, rgbFace: Any = None
    ) -> None:
        """Draw the path shifted."""
        points = np.asarray(affine.transform(tpath.vertices))
        ahead = np.gradient(points, axis=0)
        left = np.stack([-ahead[:, 1], ahead[:, 0]], axis=1)
        left /= np.maximum(np.hypot(*left.T), 1e-12)[:, None]
        pixels = renderer.points_to_pixels(1.0) * self.distances
        shifted = Path(points + pixels[:, None] * left)
        renderer.draw_path(gc, shifted, IdentityTransform(), rgbFace)


def draw_paths(axes: Axes, paths: Sequence[FloatArray], near: float) -> bool:
    """Draw paths (T_k+1, 2), side by side where they are within the distance `near`.

    Paths of more members than there are colours are drawn alike, where they are. Returns whether
    any path is displaced.
    """
    few = len(paths) <= len(MEMBERS)
    shifts = side_shifts(paths, near) if few else []
    for member, path in enumerate(paths):
        style = path_style(member if few else -1)
        patch = PathPatch(Path(path), fill=False, capstyle="round", zorder=4, **style)
        if few:
            patch.set_path_effects([SideShift(scaled(_GAP) * shifts[member])])
        axes.add_patch(patch)
    return any(shift.any() for shift in shifts)


def path_style(member: int) -> dict[str, Any]:
    """Colour and width of a member's path; of those of many members if it is negative."""
    if member < 0:
        return {"color": BLUE, "linewidth": scaled(0.6), "alpha": 0.55}
    return {"color": MEMBERS[member], "linewidth": scaled(_LINE)}


def add_closeup(axes: Axes, paths: Sequence[FloatArray], obstacles: FloatArray) -> Axes | None:
    """Add a close-up of where paths join, in a place of a map without paths and `obstacles` (N, 2).

    There is none where paths do not join, the map shows that as well, or has no such place.
    """
    low, high = np.transpose([axes.get_xlim(), axes.get_ylim()])
    side = _INSET * float((high - low).min())
    joining = joining_window(paths)
    if joining is None or side / joining[1] < _LEAST_ZOOM:
        return None
    corner, width = joining
    shown = corner + width * np.array([[0, 0], [0, 1], [1, 0], [1, 1], [0.5, 0.5]])
    place = free_place(low, high, side, np.vstack([*paths, obstacles, shown]))
    if place is None:
        return None
    bounds = [*(place - low) / (high - low), *side / (high - low)]
    inset = axes.inset_axes((bounds[0], bounds[1], bounds[2], bounds[3]), zorder=5)
    inset.set(xlim=(corner[0], corner[0] + width), ylim=(corner[1], corner[1] + width))
    inset.set(xticks=[], yticks=[], facecolor="white")
    draw_paths(inset, paths, SHARED * width * float((high - low)[0]) / side)
    axes.indicate_inset_zoom(inset, edgecolor=INK, linewidth=scaled(0.6), alpha=0.8)
    return inset


def joining_window(paths: Sequence[FloatArray]) -> tuple[FloatArray, float] | None:
    """Corner (2,) and side of a square that holds all paths until they are half as far apart."""
    steps = min(map(len, paths))
    positions = np.stack([path[:steps] for path in paths], axis=1)
    spread = np.ptp(positions, axis=1).max(axis=1)
    joined = np.flatnonzero(spread <= 0.5 * spread[0])
    if spread[0] <= 0 or not joined.size:
        return None
    shown = positions[: joined[0] + 1].reshape(-1, 2)
    width = 1.3 * float(np.ptp(shown, axis=0).max())
    return np.asarray((shown.min(axis=0) + shown.max(axis=0) - width) / 2), width


def free_place(
    low: FloatArray, high: FloatArray, side: float, points: FloatArray
) -> FloatArray | None:
    """Lower left corner (2,) of a square without points (N, 2), nearest to the last of them."""
    margin = 0.03 * (high - low).min()
    ways = [np.linspace(low[k] + margin, high[k] - margin - side, 9) for k in (0, 1)]
    corners = np.stack(np.meshgrid(*ways), axis=-1).reshape(-1, 2)
    beyond = np.abs(points - (corners + side / 2)[:, None]) - side / 2
    free = corners[beyond.max(axis=2).min(axis=1) > margin]
    distances = np.linalg.norm(free + side / 2 - points[-1], axis=1)
    return np.asarray(free[int(np.argmin(distances))]) if len(free) else None


def side_shifts(paths: Sequence[FloatArray], near: float) -> list[FloatArray]:
    """Shifts (T_k+1,) to the left of every path, in units of a gap, so that none covers another.

    The paths that pass a point within the distance `near` have neighbouring places there, in their
    order and centred; a path on its own is not shifted.
    """
    shifts = []
    for member, path in enumerate(paths):
        present = np.stack([_distances(path, other) <= near for other in paths])
        present[member] = True
        shifts.append(present[:member].sum(axis=0) - (present.sum(axis=0) - 1) / 2)
    return shifts


def _distances(points: FloatArray, path: FloatArray) -> FloatArray:
    """Distances (N,) of points (N, 2) from a path (T+1, 2)."""
    if len(path) < 2:
        return np.asarray(np.hypot(*(points - path[0]).T))
    along = np.diff(path, axis=0)
    offsets = points[:, None] - path[:-1]
    squares = np.maximum((along**2).sum(axis=1), 1e-300)
    fractions = np.clip((offsets * along).sum(axis=2) / squares, 0.0, 1.0)
    return np.asarray(np.linalg.norm(offsets - fractions[:, :, None] * along, axis=2).min(axis=1))
