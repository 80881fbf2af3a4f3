"""The loop of every bound: levels of growing work until a gap, the time or the memory ends it."""

from __future__ import annotations

import math
import time
from collections.abc import Generator
from dataclasses import dataclass, field
from typing import TypeVar

_Level = TypeVar("_Level")


@dataclass(frozen=True)
class Level:
    """Grid of a refinement.

    Parameters
    ----------
    stride, reach : int
        Time steps from one sample of a path to the next, and nodes by which a coordinate changes.
    spacing : float
        Side of a cell, in units of length.
    nodes : int
        Number of nodes over all samples.
    bound : float
        Lower bound on the risk of any guide, from the grids so far.
    seconds : float
        Since the start of the refinement.
    """

    stride: int
    reach: int
    spacing: float
    nodes: int
    bound: float
    seconds: float


@dataclass
class Clock:
    """Time since the start and the last level of a refinement, and until its end."""

    deadline: float = math.inf  # of `time.monotonic`
    started: float = field(default_factory=time.monotonic)
    begun: float = field(default_factory=time.monotonic)  # of the last level

    @property
    def seconds(self) -> float:
        """Time since the start."""
        return time.monotonic() - self.started

    def check(self) -> None:
        """Raise TimeoutError after the deadline."""
        if time.monotonic() > self.deadline:
            raise TimeoutError

    def begin(self, ratio: float = 0.0) -> None:
        """Begin a level of `ratio` times the work of the last one.

        Raise TimeoutError if it is expected to end after the deadline.
        """
        now = time.monotonic()
        if ratio > 0 and now + ratio * (now - self.begun) > self.deadline:
            raise TimeoutError
        self.begun = now


def refined(levels: Generator[_Level, None, str], late: str) -> tuple[tuple[_Level, ...], str]:
    """Levels of a refinement, and why it ended: what it returns, or `late` at a TimeoutError."""
    found: list[_Level] = []
    while True:
        try:
            found.append(next(levels))
        except StopIteration as end:
            return tuple(found), end.value
        except TimeoutError:
            return tuple(found), late
