"""Constraints of the joint plan as numbers, with their derivatives, for b instances.

All are squared lengths: of changes of velocity, which join two steps, and of differences of
positions in one step. `Constraints` has them by block, in the order of the program.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from ..typing import FloatArray


def backward_sums(array: FloatArray, axis: int) -> FloatArray:
    """Sums over an entry and all later ones of an axis, in place: positions to velocities."""
    steps = np.moveaxis(array, axis, 0)
    for t in reversed(range(len(steps) - 1)):
        steps[t] += steps[t + 1]
    return array


@dataclass(frozen=True, eq=False)
class Constraints:
    """Differences whose squared lengths are constrained, at a point of each instance.

    Parameters
    ----------
    names : sequence of str
        Of acceleration, arrival, outside, separation; the first two at least.
    changes : (b, T, n, 2)
        Of velocity, in every step.
    to_center : (b, T, n, 2)
        From the target's centre.
    arrivals : (b, T, n)
        1 at a member's arrival step, else 0.
    """

    names: Sequence[str]
    changes: FloatArray
    to_center: FloatArray
    arrivals: FloatArray

    @classmethod
    def at(
        cls, names: Sequence[str], velocities: FloatArray, p: Mapping[str, FloatArray]
    ) -> Constraints:
        """Constraints at velocities (b, T, n, 2) with parameters (b, ...) by name."""
        first = p["initial_velocities"].reshape(velocities[:, :1].shape)
        start = p["start"].reshape(first.shape)
        changes = np.diff(velocities, axis=1, prepend=first)
        positions = start + np.cumsum(velocities, axis=1)
        return cls(names, changes, positions - p["center"][:, None], p["arrivals"])

    @property
    def values(self) -> FloatArray:
        """All rows of g."""
        squares = _dot(self.to_center, self.to_center)
        apart = self._pairs(self.to_center)
        return self._joined(_dot(self.changes, self.changes), squares, _dot(apart, apart))

    def times(self, velocities: FloatArray) -> FloatArray:
        """Change of all rows with a change (b, T, n, 2) of the velocities."""
        positions = np.cumsum(velocities, axis=1)
        changes = np.diff(velocities, axis=1, prepend=0.0)
        return 2.0 * self._joined(
            _dot(self.changes, changes),
            _dot(self.to_center, positions),
            _dot(self._pairs(self.to_center), self._pairs(positions)),
        )

    def transposed_times(self, rows: FloatArray) -> FloatArray:
        """Gradients (b, T, n, 2) of the sums of all rows with some weights."""
        changes, points, pairs = self._split(rows)
        by_position = points[..., None] * self.to_center
        by_position += self._incidence.T @ (pairs[..., None] * self._pairs(self.to_center))
        by_velocity = backward_sums(by_position, 1)
        by_change = changes[..., None] * self.changes
        by_velocity += by_change
        by_velocity[:, :-1] -= by_change[:, 1:]
        return 2.0 * by_velocity

    def curvature(self, rows: FloatArray, weights: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Second derivatives of the rows' sum, plus weighted squares of first derivatives.

        Blocks (b, T, 2n, 2n) of every step: in the positions, and in the changes of velocity.
        """
        b, steps, n, _ = self.changes.shape
        (changes, points, pairs), squares = self._split(rows), self._split(weights)
        members = np.arange(n)
        in_changes = np.zeros((b, steps, n, 2, n, 2))
        in_changes[:, :, members, :, members] = _block(changes, squares[0], self.changes)
        in_positions = np.zeros_like(in_changes)
        in_positions[:, :, members, :, members] = _block(points, squares[1], self.to_center)
        if pairs.size:
            blocks = _block(pairs, squares[2], self._pairs(self.to_center))
            signs = self._incidence
            in_positions += np.einsum("pi,pj,pbtac->btiajc", signs, signs, blocks)
        shape = b, steps, 2 * n, 2 * n
        return in_positions.reshape(shape), in_changes.reshape(shape)

    @property
    def _incidence(self) -> FloatArray:
        """Matrix (pairs, n) that takes differences of members' points, if they are constrained."""
        n = self.changes.shape[2] if "separation" in self.names else 0
        first, second = np.triu_indices(n, 1)
        members = np.eye(self.changes.shape[2])
        return np.asarray(members[first] - members[second])

    def _pairs(self, points: FloatArray) -> FloatArray:
        """Differences (b, T, pairs, 2) of members' points."""
        return np.asarray(self._incidence @ points)

    def _joined(self, changes: FloatArray, points: FloatArray, pairs: FloatArray) -> FloatArray:
        blocks = {
            "acceleration": changes,
            "arrival": (self.arrivals * points).sum(axis=1),
            "outside": points,
            "separation": pairs,
        }
        return np.hstack([blocks[name].reshape(len(points), -1) for name in self.names])

    def _split(self, rows: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Weights of rows by what they multiply: changes, points (b, T, n), pairs (b, T, pairs)."""
        b, steps, n, _ = self.changes.shape
        size = steps * n
        points = self.arrivals * rows[:, None, size : size + n]
        rest = rows[:, size + n :]
        if "outside" in self.names:
            points, rest = points + rest[:, :size].reshape(points.shape), rest[:, size:]
        return rows[:, :size].reshape(points.shape), points, rest.reshape(b, steps, -1)


def _dot(a: FloatArray, b: FloatArray) -> FloatArray:
    return np.asarray(np.einsum("...a,...a->...", a, b))


def _block(rows: FloatArray, weights: FloatArray, vectors: FloatArray) -> FloatArray:
    """Blocks (k, b, T, 2, 2) of squared lengths of vectors (b, T, k, 2), as in `curvature`."""
    outer = 4.0 * weights[..., None, None] * vectors[..., :, None] * vectors[..., None, :]
    return np.asarray((2.0 * rows[..., None, None] * np.eye(2) + outer).transpose(2, 0, 1, 3, 4))
