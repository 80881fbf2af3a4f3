"""The filter: which points no later step may reach."""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np

from ....typing import BoolArray, FloatArray, IntArray

_ROOM = 8  # entries of a new filter


@dataclass(eq=False)
class Filter:
    """Pairs of constraint violation and barrier function that no later step may reach, b times.

    Parameters
    ----------
    entries : (2, m, b)
    numbers : (b,) int
        How many of the entries are there.
    scale : (b,)
        Violation at the beginning, at least 1.
    """

    entries: FloatArray
    numbers: IntArray
    scale: FloatArray

    @classmethod
    def empty(cls, violation: FloatArray) -> Filter:
        """Filters without entries, from the violations (b,) at the beginning."""
        size = len(violation)
        scale = np.maximum(1.0, violation)
        return cls(np.zeros((2, _ROOM, size)), np.zeros(size, np.int64), scale)

    def take(self, places: IntArray, axis: int = -1) -> Filter:
        """Some of the filters, like `numpy.ndarray.take`."""
        return Filter(*(getattr(self, part.name).take(places, axis) for part in fields(self)))

    def joined(self, other: Filter) -> Filter:
        """These filters, then those of another batch."""
        size = max(self.entries.shape[1], other.entries.shape[1])
        return Filter(
            np.concatenate([self._wide(size), other._wide(size)], axis=-1),
            np.concatenate([self.numbers, other.numbers]),
            np.concatenate([self.scale, other.scale]),
        )

    def make_room(self) -> None:
        """Have a place for one more entry in every filter."""
        room = self.entries.shape[1]
        if self.numbers.max(initial=0) == room:
            self.entries = self._wide(2 * room)

    def add(self, violation: FloatArray, merit: FloatArray) -> None:
        """Add a point to every filter."""
        from .search_kernels import add_entries

        self.make_room()
        add_entries(self.entries, self.numbers, violation, merit)

    def accepts(self, violation: FloatArray, merit: FloatArray) -> BoolArray:
        """Which filters accept points (b,)."""
        there = np.arange(self.entries.shape[1])[:, None] < self.numbers
        reached = (violation >= self.entries[0]) & (merit >= self.entries[1]) & there
        return np.asarray(~reached.any(axis=0) & np.isfinite(merit))

    def clear(self, rows: BoolArray) -> None:
        """Forget all entries of some filters, for a new barrier function."""
        self.numbers[rows] = 0

    def _wide(self, size: int) -> FloatArray:
        return np.pad(self.entries, ((0, 0), (0, size - self.entries.shape[1]), (0, 0)))
