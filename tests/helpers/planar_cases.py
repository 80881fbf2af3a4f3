"""Sets in the plane to be tested on: single ones, and random ones, degenerate ones among them."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from casswarm.motion import PlanarSets

Array = NDArray[np.float64]
INF = np.inf
PLANE = (np.full(2, -INF), np.full(2, INF))


def single(lower: ArrayLike, upper: ArrayLike, *discs: tuple[float, float, float]) -> PlanarSets:
    table = np.array(discs, dtype=float).reshape(-1, 3)
    return PlanarSets(np.array(lower), np.array(upper), table[:, :2], table[:, 2])


def scale(sets: PlanarSets, points: Array) -> Array:
    """The magnitude that the stated bound of the violation is relative to."""
    reach = np.abs(sets.centers).max(axis=-1) + sets.radii
    return np.abs(points).max(axis=-1) + reach.max(axis=-1, initial=0.0)


def random_cases(rng: np.random.Generator, count: int, discs: int = 2) -> tuple[PlanarSets, Array]:
    """Half in general position, half on a coarse grid: tangent, nested, zero-width, concentric."""
    general, grid = count // 2, count - count // 2

    def integers(*shape: int) -> Array:
        return rng.integers(-4, 5, size=(grid, *shape)) / 2

    corner = np.concatenate([rng.normal(size=(general, 2)) - 1, integers(2)])
    width = np.concatenate([2 * rng.exponential(size=(general, 2)), np.abs(integers(2))])
    centers = np.concatenate([rng.normal(size=(general, discs, 2)), integers(discs, 2)])
    radii = np.concatenate([1.5 * rng.exponential(size=(general, discs)), np.abs(integers(discs))])
    points = np.concatenate([2 * rng.normal(size=(general, 2)), 2 * integers(2)])
    return PlanarSets(corner, corner + width, centers, radii), points
