"""Types that every room uses: arrays, expressions, intervals, progress."""

from __future__ import annotations

from typing import Any, Literal, NamedTuple, Protocol, TypeAlias

import numpy as np
from numpy.typing import NDArray

FloatArray: TypeAlias = NDArray[np.float64]
BoolArray: TypeAlias = NDArray[np.bool_]
IntArray: TypeAlias = NDArray[np.int64]
States: TypeAlias = tuple[FloatArray, FloatArray, BoolArray]  # positions, velocities, alive
Expr: TypeAlias = Any
"""A CasADi expression or Function; CasADi has no type hints."""

Seed: TypeAlias = int | np.random.Generator  # of a generator, the next 64 bits are drawn
Search: TypeAlias = Literal["local", "global"]
Objective: TypeAlias = Literal["success", "arrivals", "survivors"]
LeaderSelection: TypeAlias = Literal["nearest", "first", "safest"]
ThemeName: TypeAlias = Literal["column", "page", "slide"]


class Interval(NamedTuple):
    """A number known to lie between two others.

    Parameters
    ----------
    low, high : float

    Examples
    --------
    >>> success = Interval(0.25, 0.5)
    >>> success.midpoint, success.width, 0.3 in success
    (0.375, 0.25, True)
    """

    low: float
    high: float

    @property
    def midpoint(self) -> float:
        """Half-way between the ends."""
        return 0.5 * (self.low + self.high)

    @property
    def width(self) -> float:
        """Distance of the ends."""
        return self.high - self.low

    def __contains__(self, value: object) -> bool:
        return isinstance(value, int | float) and self.low <= value <= self.high


class Progress(Protocol):
    """What long computations call to report progress: ``progress(task, done, total)``.

    `task` names what is being done, `done` counts up to `total`, which is None where it is not
    known.
    """

    def __call__(self, task: str, done: float, total: float | None, /) -> None:
        """Report that `done` of `total` is done."""
