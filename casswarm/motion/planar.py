r"""Exact projection onto the intersection of a box and up to three discs in the plane, in batches.

A set is S = B ∩ D_1 ∩ ... ∩ D_K: a box B = [lower, upper] and discs D_k = {x : |x - c_k| <= r_k},
as they constrain a member for a step: component limits, the disc of a_max, the corridor, and where
speed is limited in every direction, its disc.

**Why finitely many candidates suffice.** Let S be non-empty and q = P_S(p) ≠ p its point nearest to
p. The open disc U of radius |p - q| about p does not meet S. So U, the four half-planes of B and
the discs are convex sets in the plane without a common point, and by Helly's theorem at most three
of them already have none. U is among these (the others share q): U ∩ C_i ∩ C_j = ∅ for at most two
constraints, which says that q = P_{C_i ∩ C_j}(p). Hence q is

1. the projection on one or two half-planes, and so on B, which is smaller and contains q: a clip;
2. or the projection on one disc, c + r (p - c) / |p - c|;
3. or, neither constraint alone sufficing, a point of both boundaries: where a line of the box
   crosses a circle, or two circles cross.

No constraint qualification is used, so tangency, zero radii and zero widths are covered; where
boundaries coincide, one constraint suffices. So **S is empty if and only if no candidate lies in
it**. A candidate of case 1 or 2 that lies in S *is* the projection, being nearest in a superset;
only the points left need case 3, the nearest of the crossings that lie in S.

**Rounding.** The box holds exactly: candidates are clipped to it. A point x counts as inside disc k
if it violates it by at most ``ROUNDING * (max|x| + max|c_k| + r_k)``, some units in the last place
of the numbers involved. The *violation* of a crossing is of that order even where its *position* is
ill-conditioned: at (nearly) tangent boundaries a change e of the data moves the projection by order
sqrt(e). Magnitudes should lie between 1e-140 and 1e140 (or be zero).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..compiled.kernels import contiguous
from ..typing import BoolArray, FloatArray
from .planar_kernels import (
    DISCS,
    WIDTH,
    approach_batch,
    empty_batch,
    nearest_batch,
    violation_batch,
)

Index: TypeAlias = int | np.integer[Any] | slice | NDArray[np.bool_] | NDArray[np.integer[Any]]


@dataclass(frozen=True, eq=False)
class PlanarSets:
    """Sets in the plane, each the intersection of a box and up to three discs.

    The arrays broadcast to a common leading shape, `shape`; the fields are read-only views of it.
    Shapes or values other than the following raise ValueError.

    Parameters
    ----------
    lower, upper : array_like of float, (..., 2)
        Corners of the boxes, ``lower <= upper``; -inf in `lower`, +inf in `upper` mean no bound.
    centers : array_like of float, (..., K, 2)
        Centres of the discs, finite, K <= 3.
    radii : array_like of float, (..., K)
        Radii of the discs, >= 0; +inf means that the disc is absent.
    """

    lower: FloatArray
    upper: FloatArray
    centers: FloatArray
    radii: FloatArray

    def __post_init__(self) -> None:
        discs = np.shape(self.radii)[-1:]
        ends = {"lower": (2,), "upper": (2,), "centers": (*discs, 2), "radii": discs}
        arrays = {name: np.asarray(getattr(self, name), dtype=np.float64) for name in ends}
        if discs not in ((0,), (1,), (2,), (3,)) or any(
            arrays[name].shape[-len(end) :] != end for name, end in ends.items()
        ):
            raise ValueError(
                "lower, upper, centers, radii must have shapes (..., 2), (..., 2), (..., K, 2), "
                f"(..., K) with K from 0 to 3; got {[array.shape for array in arrays.values()]}"
            )
        lower, upper, centers, radii = arrays.values()
        if not np.all((lower <= upper) & (lower < np.inf) & (upper > -np.inf)):
            raise ValueError("lower must be <= upper; only lower may be -inf, only upper +inf")
        if not (np.isfinite(centers).all() and np.all(radii >= 0)):
            raise ValueError("centers must be finite, and radii >= 0 (+inf: the disc is absent)")
        shape = np.broadcast_shapes(*(arrays[name].shape[: -len(ends[name])] for name in ends))
        for name, array in arrays.items():
            object.__setattr__(self, name, np.broadcast_to(array, shape + ends[name]))

    @classmethod
    def from_packed(cls, rows: FloatArray, discs: int = len(DISCS)) -> PlanarSets:
        """Sets with the first `discs` discs of rows (..., 13), as `packed` returns them."""
        centers = rows[..., 4:].reshape(*rows.shape[:-1], len(DISCS), 3)[..., :discs, :]
        return cls(rows[..., 0:2], rows[..., 2:4], centers[..., :2], centers[..., 2])

    @cached_property
    def packed(self) -> FloatArray:
        """The sets as rows of thirteen numbers, (..., 13), for `planar_kernels`."""
        rows = np.zeros((*self.shape, WIDTH))
        rows[..., 0:2], rows[..., 2:4], rows[..., (6, 9, 12)] = self.lower, self.upper, np.inf
        for k in range(self.radii.shape[-1]):
            rows[..., 4 + 3 * k : 6 + 3 * k] = self.centers[..., k, :]
            rows[..., 6 + 3 * k] = self.radii[..., k]
        return rows

    @property
    def shape(self) -> tuple[int, ...]:
        """The common leading shape: one set for each of its entries."""
        return self.radii.shape[:-1]

    def __getitem__(self, index: Index | tuple[Index, ...]) -> PlanarSets:
        """Take the sets at an index, slice or mask of the leading axes."""
        key = index if isinstance(index, tuple) else (index,)
        _ = np.broadcast_to(False, self.shape)[key]  # IndexError if deeper than the leading axes
        arrays = (self.lower, self.upper, self.centers, self.radii)
        return PlanarSets(*(array[*key, ...] for array in arrays))

    def project(self, points: ArrayLike) -> FloatArray:
        """Nearest points (..., 2) of the sets, whose `shape` broadcasts with that of the points.

        They are in the box exactly, in disc k up to ``ROUNDING * (max|x| + max|c_k| + r_k)``. A
        point that is not finite gives NaN: one diverged entry does not stop a batch. ValueError is
        raised if a set is empty (see `is_empty`, `relax_infeasible`), or if shapes do not fit.
        """
        flat, sets, shape = self._paired(points)
        nearest, exists = np.empty(flat.shape), np.empty(len(flat), dtype=bool)
        nearest_batch(flat, sets, nearest, exists)
        if not exists.all():
            raise ValueError(
                f"{np.count_nonzero(~exists)} of {exists.size} points have no projection: their "
                "sets are empty; drop these, or call relax_infeasible() first"
            )
        return nearest.reshape(*shape, 2)

    def violation(self, points: ArrayLike) -> FloatArray:
        """Largest distance (...) to the box or a disc; 0 inside, NaN for a point not finite."""
        flat, sets, shape = self._paired(points)
        largest = np.empty(len(flat))
        violation_batch(flat, sets, largest)
        return largest.reshape(shape)

    def contains(self, points: ArrayLike, tolerance: float = 0.0) -> BoolArray:
        """Test if points (..., 2) are in the sets, up to a distance; False where not finite."""
        return np.asarray(self.violation(points) <= tolerance)

    @cached_property
    def is_empty(self) -> BoolArray:
        """True for empty sets, shape `shape`; gaps of the order of rounding do not count."""
        sets = self.packed.reshape(-1, WIDTH)
        empty = np.empty(len(sets), dtype=bool)
        empty_batch(sets, empty)
        return empty.reshape(self.shape)

    def relax_infeasible(self) -> tuple[PlanarSets, BoolArray]:
        """Make every set non-empty by relaxing soft constraints that cannot be met.

        Disc 1 is a soft constraint, the box and the other discs are hard constraints. Where they do
        not meet, the set becomes the point within the hard ones nearest to the centre of disc 1,
        and so to disc 1: a box of zero width, the discs absent. Returned are the sets, and which of
        them (...) were replaced. ValueError is raised if the hard ones do not meet somewhere.
        """
        infeasible = self.is_empty
        if not infeasible.any():
            return self, infeasible
        packed = self.packed.copy()
        relaxed, exists = packed[infeasible], np.empty(np.count_nonzero(infeasible), dtype=bool)
        approach_batch(relaxed, exists)
        if not exists.all():
            raise ValueError(
                f"{np.count_nonzero(~exists)} of {infeasible.size} sets are empty even "
                "without disc 1: widen the box, or move or enlarge disc 0"
            )
        packed[infeasible] = relaxed
        return PlanarSets.from_packed(packed, self.radii.shape[-1]), infeasible

    def _paired(self, points: ArrayLike) -> tuple[FloatArray, FloatArray, tuple[int, ...]]:
        """Points (M, 2), their sets' rows (M, 13), and the shape to return to."""
        x = np.asarray(points, dtype=np.float64)
        if x.shape[-1:] != (2,):
            raise ValueError(f"points must have shape (..., 2); got {x.shape}")
        shape = np.broadcast_shapes(x.shape[:-1], self.shape)
        flat = np.broadcast_to(x, (*shape, 2)).reshape(-1, 2)
        sets = self.packed if shape == self.shape else np.broadcast_to(self.packed, (*shape, WIDTH))
        return contiguous(flat), contiguous(sets.reshape(-1, WIDTH)), shape
