"""Rates of a swarm's members in all sets of the living, with first and second derivatives."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..hazard import KernelHazard
from ..hazard.kernel_hazard import lowered_derivatives, lowered_kernels
from ..problems.subsets import subsets
from ..typing import FloatArray
from .curvature_kernels import LANES


def blocked(steps: FloatArray) -> FloatArray:
    """Arrays (k, ...) in blocks (ceil(k / LANES), ..., LANES); the last one fills the rest."""
    size = len(steps)
    filled = np.arange(-(-size // LANES) * LANES).clip(max=size - 1).reshape(-1, LANES)
    return np.ascontiguousarray(np.moveaxis(steps[filled], 1, -1))


def unblocked(blocks: FloatArray, size: int) -> FloatArray:
    """Arrays (k, ...) of such blocks."""
    steps = np.moveaxis(blocks, -1, 1)
    return np.ascontiguousarray(steps).reshape(-1, *steps.shape[2:])[:size]


def set_rates(hazard: KernelHazard, points: FloatArray) -> FloatArray:
    """Rates (k, 2^n, n, LANES) of all members in all sets, of swarms at points (k, n, 2, LANES)."""
    source, density, collision, combine = lowered_kernels(hazard)
    pairs = _squares(_differences(points))
    with np.errstate(all="ignore"):  # values that are not finite end the solve
        strengths = source(_squares(_to_radars(hazard, points)))
        sums = _sums(hazard, strengths, density(pairs), collision(pairs), pairs)
        return combine(*sums)


@dataclass(frozen=True, eq=False)
class LocalRates:
    """Rates of n members in all sets, in blocks of positions of the swarm, with derivatives.

    Parameters
    ----------
    radars : (k, n, 5, LANES)
        Gradient and Hessian (xx, xy, yy) of the sum over radars in a member's position.
    pairs : (k, 4, n, n, LANES)
        First and second derivatives of density and collision in the squared distance.
    rates : (k, 2^n, 10, n, LANES)
        Rate, and its gradient and the upper triangle of its Hessian in the three sums.
    """

    radars: FloatArray
    pairs: FloatArray
    rates: FloatArray

    @classmethod
    def of(cls, hazard: KernelHazard, points: FloatArray) -> LocalRates:
        """Rates of swarms at points (k, n, 2, LANES)."""
        source, density, collision, combine = lowered_derivatives(hazard)
        to_radars, squares = _to_radars(hazard, points), _squares(_differences(points))
        with np.errstate(all="ignore"):  # values that are not finite end the solve
            strengths = _filled(source, 3, 1, _squares(to_radars))
            of_pairs = np.concatenate(
                [_filled(density, 3, 1, squares), _filled(collision, 3, 1, squares)], axis=1
            )
            values = strengths[:, 0], of_pairs[:, 0], of_pairs[:, 3]
            rates = _filled(combine, 10, 2, *_sums(hazard, *values, squares))
        own = np.arange(points.shape[1])
        of_pairs[:, :, own, own] = 0.0
        pairs = np.ascontiguousarray(of_pairs[:, [1, 2, 4, 5]])
        return cls(_by_position(hazard, strengths, to_radars), pairs, rates)


def _by_position(hazard: KernelHazard, strengths: FloatArray, to_radars: FloatArray) -> FloatArray:
    """Derivatives of the sum over radars, from strengths (k, 3, n, r, LANES) of each."""
    weights = hazard.radar_strengths[:, None]
    slope, bend = strengths[:, 1] * weights, strengths[:, 2] * weights
    x, y = to_radars[:, :, :, 0], to_radars[:, :, :, 1]
    laplacian = 2.0 * slope
    parts = (
        laplacian * x,
        laplacian * y,
        4.0 * bend * x * x + laplacian,
        4.0 * bend * x * y,
        4.0 * bend * y * y + laplacian,
    )
    return np.stack([part.sum(axis=2) for part in parts], axis=2)


def _sums(
    hazard: KernelHazard,
    strengths: FloatArray,
    density: FloatArray,
    collision: FloatArray,
    pairs: FloatArray,
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Sums (k, 2^n, n, LANES) over radars, over living members, and over other living members."""
    blocks, n, _, lanes = pairs.shape
    members = subsets(n).members.astype(float)
    others = np.where(np.eye(n, dtype=bool)[..., None], 0.0, collision)
    densities, collisions = (
        (members @ np.broadcast_to(values, pairs.shape).reshape(blocks, n, -1))
        for values in (density, others)
    )
    shape = blocks, len(members), n, lanes
    by_radars = (strengths * hazard.radar_strengths[:, None]).sum(axis=2)[:, None]
    return np.broadcast_to(by_radars, shape), densities.reshape(shape), collisions.reshape(shape)


def _filled(
    function: Callable[..., tuple[Any, ...]], count: int, axis: int, *arguments: FloatArray
) -> FloatArray:
    """Values of a function of arrays, along an axis; constants are repeated."""
    shape = arguments[0].shape
    values = np.empty((*shape[:axis], count, *shape[axis:]))
    for k, value in enumerate(function(*arguments)):
        values[(slice(None),) * axis + (k,)] = value
    return values


def _to_radars(hazard: KernelHazard, points: FloatArray) -> FloatArray:
    """Differences (k, n, r, 2, LANES)."""
    return np.asarray(points[:, :, None] - hazard.radar_positions[:, :, None])


def _differences(points: FloatArray) -> FloatArray:
    """Differences (k, n, n, 2, LANES)."""
    return np.asarray(points[:, :, None] - points[:, None])


def _squares(vectors: FloatArray) -> FloatArray:
    """Squared lengths, without the axis before the last."""
    return np.asarray(vectors[..., 0, :] ** 2 + vectors[..., 1, :] ** 2)
