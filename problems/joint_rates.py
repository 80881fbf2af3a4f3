"""Rates of a swarm's members in all sets of the living, with first and second derivatives."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..hazard import KernelHazard
from ..hazard.kernels import lowered_derivatives, lowered_kernels
from ..typing import FloatArray
from .subsets import subsets


def set_rates(hazard: KernelHazard, points: FloatArray) -> FloatArray:
    """Rates (k, 2^n, n) of all members in all sets, of swarms at points (k, n, 2)."""
    source, density, collision, combine = lowered_kernels(hazard)
    pairs = _squares(_differences(points))
    with np.errstate(all="ignore"):  # values that are not finite end the solve
        strengths = source(_squares(_to_radars(hazard, points))) * hazard.radar_strengths
        return combine(*_sums(strengths, density(pairs), collision(pairs), pairs))


@dataclass(frozen=True, eq=False)
class LocalRates:
    """Rates of n members in all sets at k points of the swarm, with their derivatives.

    Parameters
    ----------
    radars : (k, n, 5)
        Gradient and Hessian (xx, xy, yy) of the sum over radars in a member's position.
    pairs : (k, 4, n, n)
        First and second derivatives of density and collision in the squared distance.
    rates : (k, 2^n, n, 10)
        Rate, and its gradient and the upper triangle of its Hessian in the three sums.
    """

    radars: FloatArray
    pairs: FloatArray
    rates: FloatArray

    @classmethod
    def of(cls, hazard: KernelHazard, points: FloatArray) -> LocalRates:
        """Rates of swarms at points (k, n, 2)."""
        source, density, collision, combine = lowered_derivatives(hazard)
        to_radars, squares = _to_radars(hazard, points), _squares(_differences(points))
        with np.errstate(all="ignore"):  # values that are not finite end the solve
            strengths = _filled(source, 3, _squares(to_radars)) * hazard.radar_strengths[:, None]
            of_pairs = np.concatenate(
                [_filled(density, 3, squares), _filled(collision, 3, squares)], axis=-1
            )
            sums = _sums(strengths[..., 0], of_pairs[..., 0], of_pairs[..., 3], squares)
            rates = _filled(combine, 10, *sums)
        own = np.arange(points.shape[1])
        of_pairs[:, own, own] = 0.0
        pairs = np.moveaxis(of_pairs[..., [1, 2, 4, 5]], -1, 1)
        return cls(_by_position(strengths, to_radars), np.ascontiguousarray(pairs), rates)


def _by_position(strengths: FloatArray, to_radars: FloatArray) -> FloatArray:
    """Derivatives of the sum over radars, from those in the squared distance, (k, n, l, 3)."""
    slope, bend = strengths[..., 1], strengths[..., 2]
    bent = 4.0 * np.einsum("knl,knla,knlb->knab", bend, to_radars, to_radars)
    derivatives = np.empty((*slope.shape[:2], 5))
    derivatives[..., :2] = 2.0 * np.einsum("knl,knla->kna", slope, to_radars)
    derivatives[..., 2] = bent[..., 0, 0] + 2.0 * slope.sum(axis=-1)
    derivatives[..., 3] = bent[..., 0, 1]
    derivatives[..., 4] = bent[..., 1, 1] + 2.0 * slope.sum(axis=-1)
    return derivatives


def _sums(
    strengths: FloatArray, density: FloatArray, collision: FloatArray, pairs: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Sums (k, 2^n, n) over radars, over living members, and over other living members."""
    n = pairs.shape[1]
    members = subsets(n).members.astype(float)
    others = np.where(np.eye(n, dtype=bool), 0.0, collision)
    densities = members @ np.broadcast_to(density, pairs.shape)
    collisions = members @ np.broadcast_to(others, pairs.shape)
    by_radars = np.broadcast_to(strengths.sum(axis=-1)[:, None], densities.shape)
    return by_radars, densities, collisions


def _filled(
    function: Callable[..., tuple[Any, ...]], count: int, *arguments: FloatArray
) -> FloatArray:
    """Values of a function of arrays, along a last axis; constants are repeated."""
    values = np.empty((*arguments[0].shape, count))
    for k, value in enumerate(function(*arguments)):
        values[..., k] = value
    return values


def _to_radars(hazard: KernelHazard, points: FloatArray) -> FloatArray:
    return np.asarray(points[:, :, None] - hazard.radar_positions)


def _differences(points: FloatArray) -> FloatArray:
    return np.asarray(points[:, :, None] - points[:, None])


def _squares(vectors: FloatArray) -> FloatArray:
    return np.asarray(np.einsum("...a,...a->...", vectors, vectors))
