"""The filter: which trial points of a line search are accepted."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ....typing import BoolArray, FloatArray, IntArray

_FEASIBLE, _FAR = 1e-4, 1e4  # of the initial violation: where progress in f counts, the limit
_MARGIN, _ARMIJO = 1e-5, 1e-4
_ROUNDING = 10 * np.finfo(float).eps


@dataclass(eq=False)
class Filter:
    """Pairs of constraint violation and barrier function that no later step may reach, b times.

    Parameters
    ----------
    entries : (b, m, 2)
    scale : (b,)
        Violation at the beginning, at least 1.
    """

    entries: FloatArray
    scale: FloatArray

    @classmethod
    def empty(cls, violation: FloatArray) -> Filter:
        """Filters without entries, from the violations (b,) at the beginning."""
        return cls(np.empty((len(violation), 0, 2)), np.maximum(1.0, violation))

    def __getitem__(self, rows: BoolArray) -> Filter:
        return Filter(self.entries[rows], self.scale[rows])

    def joined(self, other: Filter) -> Filter:
        """These filters, then those of another batch."""
        size = max(self.entries.shape[1], other.entries.shape[1])
        entries = np.full((len(self.scale) + len(other.scale), size, 2), np.inf)
        entries[: len(self.scale), : self.entries.shape[1]] = self.entries
        entries[len(self.scale) :, : other.entries.shape[1]] = other.entries
        return Filter(entries, np.concatenate([self.scale, other.scale]))

    def clear(self, rows: BoolArray) -> None:
        """Forget all entries of some filters, for a new barrier function."""
        self.entries[rows] = np.inf
        self.entries = self.entries[:, np.isfinite(self.entries).any(axis=(0, 2))]


@dataclass(frozen=True, eq=False)
class LineSearch:
    """One line search of b instances.

    Parameters
    ----------
    filter : Filter
    violation, merit, slope : (b,)
        Constraint violation and barrier function at the current point, and the slope of the barrier
        function along the step.
    """

    filter: Filter
    violation: FloatArray
    merit: FloatArray
    slope: FloatArray

    def accepts(
        self, rows: IntArray, length: FloatArray, violation: FloatArray, merit: FloatArray
    ) -> BoolArray:
        """Whether trial points of some instances, after steps of a length, are accepted."""
        entries, scale = self.filter.entries[rows], self.filter.scale[rows]
        before, allowed = self.violation[rows], self._rounded(rows)
        reached = (violation[:, None] >= entries[..., 0]) & (merit[:, None] >= entries[..., 1])
        feasible = before <= _FEASIBLE * scale
        sufficient = np.where(
            feasible & self._switches(rows, length),
            merit <= allowed + _ARMIJO * length * self.slope[rows],
            (violation <= (1 - _MARGIN) * before) | (merit <= allowed - _MARGIN * before),
        )
        within = violation <= _FAR * scale
        return np.asarray(sufficient & within & ~reached.any(axis=1) & np.isfinite(merit))

    def remember(self, rows: IntArray, length: FloatArray, merit: FloatArray) -> None:
        """Add the current point to the filter where a step was not one that reduces f."""
        reduced = merit <= self._rounded(rows) + _ARMIJO * length * self.slope[rows]
        added = rows[~(self._switches(rows, length) & reduced)]
        if not added.size:
            return
        entry = np.full((len(self.filter.scale), 1, 2), np.inf)
        entry[added, 0, 0] = (1 - _MARGIN) * self.violation[added]
        entry[added, 0, 1] = self.merit[added] - _MARGIN * self.violation[added]
        self.filter.entries = np.concatenate([self.filter.entries, entry], axis=1)

    def _rounded(self, rows: IntArray) -> FloatArray:
        return np.asarray(self.merit[rows] + _ROUNDING * abs(self.merit[rows]))

    def _switches(self, rows: IntArray, length: FloatArray) -> BoolArray:
        """Whether the slope promises more than the violation can cost."""
        promised = length * np.maximum(-self.slope[rows], 0.0) ** 2.3
        return np.asarray(promised > self.violation[rows] ** 1.1)
