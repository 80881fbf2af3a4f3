"""Rates by NumPy: in batches of states, and of a swarm's members in sets of the living.

For the latter, points (k, n, 2, l) are k blocks of l positions of the swarm, so that operations are
vectorised over the lanes l of a block.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from .._util.text import counted
from ..errors import HazardError
from ..typing import BoolArray, FloatArray
from .codegen import lowered_kernels
from .rate_kernels import LANES

if TYPE_CHECKING:
    from .kernel_hazard import KernelHazard

_CHUNK_PAIRS = 1 << 19  # pairs evaluated at once: a few arrays of 4 MiB


def state_rates(
    hazard: KernelHazard, positions: FloatArray, alive: BoolArray, members: int | None = None
) -> FloatArray:
    """Rates (B, m) of the first m members, by default all, of states (B, n, 2), (B, n).

    Also those of the destroyed.
    """
    source, density, collision, combine, zone = lowered_kernels(hazard)
    n = positions.shape[1]
    m = n if members is None else members
    exposures, shares = _factors(hazard, n)
    size = max(1, _CHUNK_PAIRS // (m * max(n, len(hazard.radars))))
    rates = np.empty((len(alive), m))
    for part in (slice(first, first + size) for first in range(0, len(alive), size)):
        x, living = positions[part], alive[part, None, :]
        others = living & ~np.eye(m, n, dtype=bool)
        with np.errstate(all="ignore"):  # `Hazard.rates` refuses values that are not finite
            pairs = _squared_distances(x[:, :m], x)
            to_radars = _squared_distances(x[:, :m], hazard.radar_positions[None])
            sources = np.sum(source(to_radars) * hazard.radar_strengths, axis=-1)
            sources = sources + zone(x[:, :m, 0], x[:, :m, 1])
            rates[part] = combine(
                sources if exposures is None else sources * exposures[:m],
                np.sum(density(pairs) * (living if shares is None else living * shares), axis=-1),
                np.sum(collision(pairs) * others, axis=-1),
            )
    return rates


def single_rates(hazards: Sequence[KernelHazard], points: FloatArray) -> FloatArray:
    """Rates (T, m) of single agents at points (T, m, 2), by hazards (T,) with the same kernels."""
    source, density, _, combine, zone = lowered_kernels(hazards[0])
    radars = radar_table(*hazards)[..., 0]
    with np.errstate(all="ignore"):  # as in `state_rates`
        sources = source(_squared_distances(points, radars[..., :2])) * radars[:, None, :, 2]
        sources = np.sum(sources, axis=-1) + zone(points[..., 0], points[..., 1])
        return np.asarray(combine(sources, density(0.0), 0.0))


def _factors(hazard: KernelHazard, n: int) -> tuple[FloatArray | None, FloatArray | None]:
    """Exposures and densities (n,) of the members, None where they are all 1."""
    if hazard.members is None:
        return None, None
    exposures, densities = np.array(hazard.members)
    if len(exposures) != n:
        raise HazardError(
            f"positions have {counted(n, 'member')}, and the hazard has exposures of "
            f"{len(exposures)}; of_members(rows) is the hazard of some of them",
            key="positions",
            members=n,
            expected=len(exposures),
        )
    return exposures, densities


def _squared_distances(a: FloatArray, b: FloatArray) -> FloatArray:
    """Squared distances (B, n, m) between (B, n, 2) and (B or 1, m, 2)."""
    east = a[:, :, None, 0] - b[:, None, :, 0]
    north = a[:, :, None, 1] - b[:, None, :, 1]
    return np.asarray(east * east + north * north)


def blocked(steps: FloatArray, lanes: int = LANES) -> FloatArray:
    """Arrays (k, ...) in blocks (ceil(k / lanes), ..., lanes); the last one fills the rest."""
    filled = np.arange(-(-len(steps) // lanes) * lanes).clip(max=len(steps) - 1).reshape(-1, lanes)
    return np.ascontiguousarray(np.moveaxis(steps[filled], 1, -1))


def unblocked(blocks: FloatArray, size: int) -> FloatArray:
    """Arrays (k, ...) of such blocks."""
    steps = np.moveaxis(blocks, -1, 1)
    return np.ascontiguousarray(steps).reshape(-1, *steps.shape[2:])[:size]


def radar_table(*hazards: KernelHazard) -> FloatArray:
    """Radars (k, r, 3, 1) of hazards with the same kernels: positions and strengths."""
    rows = [np.column_stack([each.radar_positions, each.radar_strengths]) for each in hazards]
    return np.array(rows)[..., None]


def set_rates(
    hazard: KernelHazard,
    points: FloatArray,
    sets: BoolArray | None = None,
    radars: FloatArray | None = None,
) -> FloatArray:
    """Rates (k, m, n, l) of all members in sets (m, n), of swarms at points (k, n, 2, l).

    By default in all 2^n sets, in the order of their bit masks, and with the hazard's own radars;
    else with radars (k, r, 3, l), positions and strengths, or (1, r, 3, 1).
    """
    radars = radar_table(hazard) if radars is None else radars
    source, density, collision, combine, zone = lowered_kernels(hazard)
    pairs, (exposures, shares) = _squares(_differences(points)), _factors(hazard, points.shape[1])
    with np.errstate(all="ignore"):  # values that are not finite are found where they are used
        sources = _by_radar(radars, source(_squares(_to_radars(radars, points))))
        sources += zone(points[:, :, 0], points[:, :, 1])
        densities = density(pairs)
        if exposures is not None and shares is not None:
            sources *= exposures[:, None]
            densities = densities * shares[:, None, None]
        sums = _sums(sources, sets, densities, collision(pairs), pairs)
        return np.asarray(combine(*sums))


@dataclass(frozen=True, eq=False)
class LocalRates:
    """Rates of n members in all m sets, in blocks of positions of the swarm, with derivatives.

    Parameters
    ----------
    radars : (k, n, 5, l)
        Gradient and Hessian (xx, xy, yy) of the sum over radars and zones in a member's position.
    pairs : (k, 4, n, n, l)
        First and second derivatives of density and collision in the squared distance.
    rates : (k, m, 10, n, l)
        Rate, and its gradient and the upper triangle of its Hessian in the three sums.
    """

    radars: FloatArray
    pairs: FloatArray
    rates: FloatArray

    @classmethod
    def of(
        cls, hazard: KernelHazard, points: FloatArray, radars: FloatArray | None = None
    ) -> LocalRates:
        """Rates in all sets of swarms at points (k, n, 2, l), with radars as in `set_rates`."""
        radars = radar_table(hazard) if radars is None else radars
        source, density, collision, combine, zone = lowered_kernels(hazard, 2)
        to_radars, squares = _to_radars(radars, points), _squares(_differences(points))
        exposures, shares = _factors(hazard, points.shape[1])
        with np.errstate(all="ignore"):  # values that are not finite end the solve
            strengths = _filled(source, 3, 1, _squares(to_radars))
            of_pairs = np.concatenate(
                [_filled(density, 3, 1, squares), _filled(collision, 3, 1, squares)], axis=1
            )
            of_zones = _filled(zone, 6, 1, points[:, :, 0], points[:, :, 1])
            densities = of_pairs[:, 0]
            if exposures is not None and shares is not None:
                strengths *= exposures[:, None, None]
                of_zones *= exposures[:, None]
                densities = densities * shares[:, None, None]  # of the member that adds it
                of_pairs[:, :3] *= shares[:, None]  # of pairs (i, j), i being the one that sees j
            sources = _by_radar(radars, strengths[:, 0]) + of_zones[:, 0]
            sums = _sums(sources, None, densities, of_pairs[:, 3], squares)
            rates = _filled(combine, 10, 2, *sums)
        own = np.arange(points.shape[1])
        of_pairs[:, :, own, own] = 0.0
        pairs = np.ascontiguousarray(of_pairs[:, [1, 2, 4, 5]])
        by_position = _by_position(radars, strengths, to_radars)
        by_position += of_zones[:, 1:].swapaxes(1, 2)
        return cls(by_position, pairs, rates)


def _by_position(radars: FloatArray, strengths: FloatArray, to_radars: FloatArray) -> FloatArray:
    """Derivatives of the sum over radars, from strengths (k, 3, n, r, l) of each."""
    weights = radars[:, None, :, 2]
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


def _by_radar(radars: FloatArray, strengths: FloatArray) -> FloatArray:
    """Sums (k, n, l) over radars, from strengths (k, n, r, l) of each."""
    return np.asarray((strengths * radars[:, None, :, 2]).sum(axis=2))


def _sums(
    sources: FloatArray,
    sets: BoolArray | None,
    density: FloatArray,
    collision: FloatArray,
    pairs: FloatArray,
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Sums (k, m, n, l): `sources` (k, n, l), over living members, and over other living ones."""
    blocks, n, _, lanes = pairs.shape
    others = np.where(np.eye(n, dtype=bool)[..., None], 0.0, collision)
    members = (np.arange(2**n)[:, None] >> np.arange(n)) & 1 if sets is None else sets
    shape, members = (blocks, len(members), n, lanes), members.astype(float)
    densities, collisions = (
        (members @ np.broadcast_to(values, pairs.shape).reshape(blocks, n, -1)).reshape(shape)
        for values in (density, others)
    )
    return np.broadcast_to(sources[:, None], shape), densities, collisions


def _filled(
    function: Callable[..., tuple[Any, ...]], count: int, axis: int, *arguments: FloatArray
) -> FloatArray:
    """Values of a function of arrays, along an axis; constants are repeated."""
    shape = arguments[0].shape
    values = np.empty((*shape[:axis], count, *shape[axis:]))
    for k, value in enumerate(function(*arguments)):
        values[(slice(None),) * axis + (k,)] = value
    return values


def _to_radars(radars: FloatArray, points: FloatArray) -> FloatArray:
    """Differences (k, n, r, 2, l)."""
    return np.asarray(points[:, :, None] - radars[:, None, :, :2])


def _differences(points: FloatArray) -> FloatArray:
    """Differences (k, n, n, 2, l)."""
    return np.asarray(points[:, :, None] - points[:, None])


def _squares(vectors: FloatArray) -> FloatArray:
    """Squared lengths, without the axis before the last."""
    return np.asarray(vectors[..., 0, :] ** 2 + vectors[..., 1, :] ** 2)
