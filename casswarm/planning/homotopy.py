"""Ways to the target: the best path on a grid, and the best ones on other sides of the radars."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from ..typing import FloatArray
from .bounds.dynamic_programming import (
    Node,
    StageCosts,
    Values,
    backward,
    forward,
    trace,
    trace_back,
)
from .bounds.grid import Relaxation
from .bounds.risk_bound import first_grid
from .bounds.windows import box_minimum
from .guide import homotopy_signature

_NODES = 150_000  # of the grid
_TILES = 16  # along the map's longer side: places that ways are sought through
_TRACED = 24


@dataclass(frozen=True, eq=False)
class GridPath:
    """A path on the grid, without limits of acceleration.

    Parameters
    ----------
    positions : (j+1, 2)
        From the start, every `merged` time steps, to the target's rim or beside it.
    merged : int
    sides : str
        Of the radars, as in `casswarm.planning.guide.homotopy_signature`.
    """

    positions: FloatArray
    merged: int
    sides: str

    @property
    def arrival(self) -> int:
        """Its arrival step."""
        return self.merged * (len(self.positions) - 1)

    def velocities(self, steps: int, dt: float) -> FloatArray:
        """Velocities (steps, 2) along the path, its timing stretched to `steps`."""
        times = np.linspace(0.0, len(self.positions) - 1, steps + 1)
        known = np.arange(len(self.positions))
        path = [np.interp(times, known, self.positions[:, axis]) for axis in (0, 1)]
        return np.diff(np.stack(path, axis=1), axis=0) / dt


def best_homotopy_classes(task: Relaxation, most: int) -> list[GridPath]:
    """The best way of all and the best found on other sides of the radars, best first.

    Dynamic programming on the first grid, forwards and backwards, gives the least risk of the paths
    through every node at every sample. Ways are traced through the best nodes of tiles of the map.
    """
    prices = StageCosts(first_grid(task, _NODES), certified=False)
    values, arriving = backward(prices), list(forward(prices))
    grid, radars = prices.grid, task.hazard.radar_positions
    found: dict[str, GridPath] = {}
    for nodes in _paths(prices, values, arriving):
        positions = task.start + grid.spacing * np.array(nodes, float)
        if len(nodes) < 2:
            continue
        sides = homotopy_signature(positions, radars)
        found.setdefault(sides, GridPath(positions, grid.merged, sides))
        if len(found) == most:
            break
    return list(found.values())


def _paths(prices: StageCosts, values: Values, arriving: Values) -> Iterator[list[Node]]:
    best = trace(prices, values)
    yield best
    through = []
    for sample in sorted({max(1, round(part * (len(best) - 1))) for part in (0.25, 0.5, 0.75)}):
        blocks = prices.grid.blocks[sample - 1]
        for block, before, after in zip(
            blocks, arriving[sample - 1], values[sample - 1], strict=True
        ):
            for risk, node in _least_of_tiles(before + after):
                place = (block.low[0] + node[0], block.low[1] + node[1])
                through.append((risk, sample, place))
    for _, sample, node in sorted(through)[:_TRACED]:
        yield trace_back(prices, arriving, node, sample) + trace(prices, values, node, sample)


def _least_of_tiles(totals: FloatArray) -> Iterator[tuple[float, Node]]:
    """Least value and its node in every tile that is no worse than the tiles around it."""
    size = max(1, -(-max(totals.shape) // _TILES))
    rows, columns = (-(-n // size) for n in totals.shape)
    tiles = np.full((rows * size, columns * size), np.inf)
    tiles[: totals.shape[0], : totals.shape[1]] = totals
    tiles = tiles.reshape(rows, size, columns, size).transpose(0, 2, 1, 3)
    tiles = tiles.reshape(rows, columns, -1)
    best, at = tiles.min(axis=-1), tiles.argmin(axis=-1)
    local = np.isfinite(best) & (best <= box_minimum(best, (0, 0), best.shape, 1))
    for row, column in zip(*np.nonzero(local), strict=True):
        inner = divmod(int(at[row, column]), size)
        node = (int(row) * size + inner[0], int(column) * size + inner[1])
        yield float(best[row, column]), node
