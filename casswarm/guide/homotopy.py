"""Homotopy classes of paths to the target: signatures, and good grid paths of several classes."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from ..grid.dynamic_programming import (
    Node,
    StageCosts,
    costs_to_come,
    costs_to_go,
    trace,
    trace_back,
)
from ..grid.nodes import Grid, NodeBlock, Relaxation, box_extremum
from ..motion.kinematics import resample
from ..typing import FloatArray

_MAX_NODES = 150_000
_TILES = 16  # along the map's longer side
_MAX_TRACED = 24  # paths through the best nodes of tiles


def homotopy_signature(positions: FloatArray, radars: FloatArray) -> str:
    """Side on which a path passes every radar: L if it has the radar on its left, R on its right.

    The side is the sign of the angle that the path sweeps as seen from the radar, which
    distinguishes a path that goes around a radar from one that turns before it.

    Parameters
    ----------
    positions : (T+1, 2)
    radars : (k, 2)
    """
    offset = positions[None] - radars[:, None]
    angle = np.unwrap(np.arctan2(offset[..., 1], offset[..., 0]), axis=1)
    swept = angle[:, -1] - angle[:, 0] if len(radars) else np.empty(0)
    return "".join("L" if turn > 0 else "R" for turn in swept)


@dataclass(frozen=True, eq=False)
class GridPath:
    """A path on the grid, without acceleration limits.

    Parameters
    ----------
    positions : (j+1, 2)
        From the start, every `stride` time steps, to the target's rim or next to it.
    stride : int
    homotopy : str
        See `homotopy_signature`.
    """

    positions: FloatArray
    stride: int
    homotopy: str

    @property
    def arrival(self) -> int:
        """The arrival step."""
        return self.stride * (len(self.positions) - 1)

    def velocities(self, steps: int, dt: float) -> FloatArray:
        """Velocities (steps, 2) along the path, its timing stretched to `steps`."""
        return resample(self.positions, steps, dt, np.arange(float(len(self.positions))))


def best_homotopy_classes(task: Relaxation, max_classes: int) -> list[GridPath]:
    """The best grid path, and the best ones in other homotopy classes, in order of risk.

    Dynamic programming gives the least risk of the paths through every node at every sample, as
    the sum of cost to come and cost to go. Paths are traced through the best nodes of map tiles.
    """
    stage_costs = StageCosts(Grid.finest(task, _MAX_NODES), certified=False)
    grid, radars = stage_costs.grid, task.hazard.radar_positions
    classes: dict[str, GridPath] = {}
    for nodes in _paths(stage_costs):
        if len(nodes) < 2:
            continue
        positions = task.start + grid.spacing * np.array(nodes, float)
        homotopy = homotopy_signature(positions, radars)
        classes.setdefault(homotopy, GridPath(positions, grid.stride, homotopy))
        if len(classes) == max_classes:
            break
    return list(classes.values())


def _paths(stage_costs: StageCosts) -> Iterator[list[Node]]:
    """The best path, then the best ones through local minima a quarter, half and 3/4 along."""
    to_go, to_come = costs_to_go(stage_costs), list(costs_to_come(stage_costs))
    best = trace(stage_costs, to_go)
    yield best
    waypoints = []
    quarters = (0.25, 0.5, 0.75)
    for sample in sorted({max(1, round(part * (len(best) - 1))) for part in quarters}):
        blocks = stage_costs.grid.nodes[sample - 1]
        for nodes, come, go in zip(blocks, to_come[sample - 1], to_go[sample - 1], strict=True):
            for risk, node in _local_minima(come + go):
                index = (nodes.first[0] + node[0], nodes.first[1] + node[1])
                waypoints.append((risk, sample, index))
    for _, sample, node in sorted(waypoints)[:_MAX_TRACED]:
        first_part = trace_back(stage_costs, to_come, node, sample)
        yield first_part + trace(stage_costs, to_go, node, sample)


def _local_minima(totals: FloatArray) -> Iterator[tuple[float, Node]]:
    """Least value and its node in every tile that is no worse than its neighbouring tiles."""
    size = max(1, -(-max(totals.shape) // _TILES))
    rows, columns = (-(-n // size) for n in totals.shape)
    tiles = np.full((rows * size, columns * size), np.inf)
    tiles[: totals.shape[0], : totals.shape[1]] = totals
    tiles = tiles.reshape(rows, size, columns, size).transpose(0, 2, 1, 3)
    tiles = tiles.reshape(rows, columns, -1)
    best, at = tiles.min(axis=-1), tiles.argmin(axis=-1)
    all_tiles = NodeBlock((0, 0), best.shape)
    local = np.isfinite(best) & (best <= box_extremum(best, all_tiles, all_tiles, 1))
    for row, column in zip(*np.nonzero(local), strict=True):
        inner = divmod(int(at[row, column]), size)
        node = (int(row) * size + inner[0], int(column) * size + inner[1])
        yield float(best[row, column]), node
