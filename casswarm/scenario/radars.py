"""Radars that move or switch: the tables `[[hazard.radar]]` of a scenario file."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from itertools import pairwise
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np
from pydantic import Field

from .validation import Allowed, Number, Point, Positive, Table

if TYPE_CHECKING:
    from ..hazard import RadarTrack

Interval = Annotated[tuple[Number, Number], Allowed("[begin, end], two numbers")]
Waypoint = Annotated[tuple[Number, Number, Number], Allowed("[time, x, y], three numbers")]
MOST_RADARS, MOST_WAYPOINTS = 1000, 10_000
"""Largest numbers of tables `[[hazard.radar]]`, and of waypoints or intervals of one."""


class Radar(Table):
    """A radar that moves, switches, or has a strength of its own."""

    position: Point | None = Field(
        None,
        examples=[[3.0, 4.0]],
        description="Position [x, y] at time 0, in units of length; a radar with a path has none.",
    )
    strength: Positive = Field(1.0, description="Factor of the radar's rate.")
    velocity: Annotated[tuple[Number, Number], Allowed("[vx, vy], two numbers")] | None = Field(
        None,
        examples=[[0.1, 0.0]],
        description="Constant velocity [vx, vy], in units of length per time; at rest by default.",
    )
    path: (
        Annotated[
            tuple[Waypoint, ...],
            Field(min_length=1, max_length=MOST_WAYPOINTS),
            Allowed(f"a list of 1 to {MOST_WAYPOINTS} waypoints [time, x, y]"),
        ]
        | None
    ) = Field(
        None,
        examples=[[[0.0, 3.0, 4.0], [2.0, 5.0, 4.0]]],
        description="Waypoints [time, x, y], straight between them; at rest before the first and "
        "after the last.",
    )
    active: (
        Annotated[
            tuple[Interval, ...],
            Field(max_length=MOST_WAYPOINTS),
            Allowed("a list of intervals of time [begin, end]"),
        ]
        | None
    ) = Field(
        None,
        examples=[[[0.0, 2.0], [4.0, 6.0]]],
        description="Intervals of time [begin, end] in which the radar is active: in the steps "
        "that end after begin, and at end or before; by default always.",
    )

    @property
    def changes(self) -> bool:
        """True if it moves, or is not always active."""
        return self.velocity is not None or self.path is not None or self.active is not None

    @property
    def start(self) -> tuple[float, float]:
        """Position at time 0."""
        return self.track.position_at(0.0)

    @property
    def track(self) -> RadarTrack:
        """The radar as hazards take it."""
        from ..hazard import RadarTrack

        position = self.position or self.path[0][1:]  # type: ignore[index]
        still = (0.0, 0.0)
        return RadarTrack(
            position, self.strength, self.velocity or still, self.path or (), self.active
        )

    def moved_to(self, position: tuple[float, float]) -> dict[str, object]:
        """Keys and values of the radar with another position at time 0; its path moves with it."""
        values = self.model_dump(exclude_none=True)
        if self.path is None:
            return values | {"position": position}
        path = np.array(self.path)
        path[:, 1:] += np.subtract(position, self.start)
        return values | {"path": path}

    def mapped(self, points: Callable[[Any], Any]) -> dict[str, object]:
        """Keys and values with a linear map (..., 2) to (..., 2) of points and vectors applied."""
        values = self.model_dump(exclude_none=True)
        for key in values.keys() & {"position", "velocity"}:
            values[key] = points(values[key])
        if self.path is not None:
            path = np.array(self.path)
            values["path"] = np.column_stack([path[:, 0], points(path[:, 1:])])
        return values

    def problems(self, key: str) -> Iterator[str]:
        """Contradictions, of a radar under a key."""
        if self.path is None and self.position is None:
            yield f"{key}.position is missing; give [x, y], or a path of waypoints [time, x, y]"
        for other in ("position", "velocity"):
            if self.path is not None and getattr(self, other) is not None:
                yield f"{key}.{other} and {key}.path are both given; a path says it all, remove one"
        for before, after in pairwise(self.path or ()):
            if not before[0] < after[0]:
                yield (
                    f"{key}.path has a waypoint at time {after[0]:g} after one at {before[0]:g}; "
                    "times must increase"
                )
        for begin, end in self.active or ():
            if not begin < end:
                yield f"{key}.active has [{begin:g}, {end:g}]; an interval must end after it begins"
        for earlier, later in pairwise(self.active or ()):
            if later[0] < earlier[1]:
                yield (
                    f"{key}.active has {list(later)} after {list(earlier)}; intervals must be in "
                    "order and must not overlap"
                )
