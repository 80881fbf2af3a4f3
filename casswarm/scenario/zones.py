"""Zones that should not be entered: the tables `[[hazard.zone]]` of a scenario file."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np
from pydantic import Field

from .validation import Allowed, Point, Positive, Table

if TYPE_CHECKING:
    from ..hazard import Zone

MOST_ZONES, _MOST_VERTICES = 100, 100
_FLAT = 1e-9  # relative: three vertices this near to a line have no inside


class ZoneTable(Table):
    """A disc or convex polygon with a rate inside, which falls smoothly to zero around it."""

    center: Point | None = Field(
        None, examples=[[5.0, 1.0]], description="Centre [x, y] of a disc, in units of length."
    )
    radius: Positive | None = Field(
        None, examples=[0.5], description="Radius of a disc, in units of length."
    )
    vertices: (
        Annotated[
            tuple[Point, ...],
            Field(min_length=3, max_length=_MOST_VERTICES),
            Allowed(f"a list of 3 to {_MOST_VERTICES} vertices [x, y]"),
        ]
        | None
    ) = Field(
        None,
        examples=[[[4.0, 0.0], [6.0, 0.0], [5.0, 2.0]]],
        description="Vertices [x, y] of a convex polygon, in order, in place of a disc.",
    )
    rate: Positive = Field(
        description="Rate of a single agent inside, per unit time; like that of a radar, it is "
        "lower where members are dense."
    )
    edge: Positive = Field(
        description="Distance from the region at which the rate has fallen to zero, in units of "
        "length."
    )

    @property
    def zone(self) -> Zone:
        """The zone as hazards take it."""
        from ..hazard import Zone

        if self.vertices is None:
            return Zone((self.center,), self.radius or 0.0, self.rate, self.edge)  # type: ignore[arg-type]
        corners = np.array(self.vertices)
        if _turns(corners).sum() < 0:
            corners = corners[::-1]
        return Zone(tuple((x, y) for x, y in corners.tolist()), 0.0, self.rate, self.edge)

    def contains(self, point: tuple[float, float]) -> bool:
        """True if a point is in the region, its rim included."""
        if self.vertices is None:
            return float(np.hypot(*np.subtract(point, self.center))) <= (self.radius or 0.0)  # type: ignore[arg-type]
        corners = np.array(self.vertices)
        sides = _sides(corners)
        beside = sides[:, 0] * (point[1] - corners[:, 1]) - sides[:, 1] * (point[0] - corners[:, 0])
        return bool((beside >= 0).all() or (beside <= 0).all())

    @property
    def corners(self) -> np.ndarray:
        """Points (m, 2) whose bounding box contains the region."""
        if self.vertices is not None:
            return np.array(self.vertices)
        return np.add(self.center, np.multiply(self.radius or 0.0, [[-1, -1], [1, 1]]))  # type: ignore[arg-type]

    def mapped(self, points: Callable[[Any], Any]) -> dict[str, object]:
        """Keys and values with a map (..., 2) to (..., 2) of points applied."""
        values = self.model_dump(exclude_none=True)
        for key in values.keys() & {"center", "vertices"}:
            values[key] = points(values[key])
        return values

    def problems(self, key: str) -> Iterator[str]:
        """Contradictions, of a zone under a key."""
        disc = [name for name in ("center", "radius") if getattr(self, name) is not None]
        if self.vertices is None:
            missing = [name for name in ("center", "radius") if name not in disc]
            yield from (f"{key}.{name} is missing; a disc needs it" for name in missing)
            return
        for name in disc:
            yield f"{key}.{name} and {key}.vertices are both given; remove one of them"
        corners = np.array(self.vertices)
        turns = _turns(corners)
        lengths = np.hypot(*_sides(corners).T)
        least = _FLAT * lengths * np.roll(lengths, -1)
        if not ((turns > least).all() or (turns < -least).all()) or not _once_around(corners):
            yield (
                f"{key}.vertices are not those of a convex polygon, in order, without three on a "
                "line; write several zones for other regions"
            )


def _sides(corners: np.ndarray) -> np.ndarray:
    """Sides (m, 2) of a polygon, from each corner to the next."""
    return np.diff(corners, axis=0, append=corners[:1])


def _turns(corners: np.ndarray) -> np.ndarray:
    """Cross products (m,) of successive sides."""
    sides = _sides(corners)
    after = np.roll(sides, -1, axis=0)
    return np.asarray(sides[:, 0] * after[:, 1] - sides[:, 1] * after[:, 0])


def _once_around(corners: np.ndarray) -> bool:
    """True if the sides turn once, unlike those of a star."""
    sides = _sides(corners)
    after = np.roll(sides, -1, axis=0)
    turns = np.arctan2(_turns(corners), (sides * after).sum(axis=1))
    return bool(abs(turns.sum()) < 3 * np.pi)
