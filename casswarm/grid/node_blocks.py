"""Rectangular blocks of grid nodes, and the least or largest value within reach of their nodes."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ..typing import FloatArray
from .extremum_kernels import LANES, running_extremum


class NodeBlock(NamedTuple):
    """A rectangular block of nodes, along any number of axes.

    Parameters
    ----------
    first : tuple of int
        Indices of the first node.
    shape : tuple of int
        Number of nodes along each axis.
    """

    first: tuple[int, ...]
    shape: tuple[int, ...]

    @classmethod
    def between(cls, first: ArrayLike, last: ArrayLike) -> NodeBlock:
        """Nodes between two of them, both included; none if one index of the last is less."""
        low, high = (np.asarray(node).astype(int) for node in (first, last))
        return cls(tuple(low.tolist()), tuple(np.maximum(high - low + 1, 0).tolist()))

    @classmethod
    def hull(cls, blocks: Iterable[NodeBlock]) -> NodeBlock:
        """The smallest block that holds all of some."""
        first, last = zip(*((block.first, block.last) for block in blocks), strict=True)
        return cls.between(np.min(first, axis=0), np.max(last, axis=0))

    @property
    def last(self) -> tuple[int, ...]:
        """Indices of the last node."""
        return tuple(i + n - 1 for i, n in zip(self.first, self.shape, strict=True))

    @property
    def size(self) -> int:
        """Number of nodes."""
        return math.prod(self.shape)

    def along(self, axes: slice) -> NodeBlock:
        """The block along some of the axes."""
        return NodeBlock(self.first[axes], self.shape[axes])

    def common(self, other: NodeBlock) -> NodeBlock:
        """Nodes that both blocks hold."""
        return NodeBlock.between(
            np.maximum(self.first, other.first), np.minimum(self.last, other.last)
        )

    def grown(self, reach: int) -> NodeBlock:
        """All nodes within reach, along every axis."""
        return NodeBlock(
            tuple(i - reach for i in self.first), tuple(n + 2 * reach for n in self.shape)
        )

    def within(self, outer: NodeBlock) -> tuple[slice, ...]:
        """Slices of these nodes in the arrays of a block that holds them."""
        starts = (i - j for i, j in zip(self.first, outer.first, strict=True))
        return tuple(slice(i, i + n) for i, n in zip(starts, self.shape, strict=True))


def box_extremum(
    values: FloatArray, at: NodeBlock, to: NodeBlock, reach: int, *, largest: bool = False
) -> FloatArray:
    """Least value within reach along every axis, or the largest one.

    `scipy.ndimage.minimum_filter` gives the same numbers but takes several times as long.

    Parameters
    ----------
    values : ndarray
        At the nodes `at`.
    at, to : NodeBlock
    reach : int
    largest : bool

    Returns
    -------
    ndarray
        At the nodes `to`. Where no node is within reach, infinity, or -infinity for the largest
        value; so with a reach of 0 it is the values, embedded.
    """
    near = to.grown(reach).common(at)
    if 0 in near.shape:
        return np.full(to.shape, -np.inf if largest else np.inf)
    values = np.ascontiguousarray(values[near.within(at)])
    for axis in reversed(range(values.ndim)):
        shape = values.shape
        split = math.prod(shape[:axis]), shape[axis], math.prod(shape[axis + 1 :])
        out = np.empty((*shape[:axis], to.shape[axis], *shape[axis + 1 :]))
        scratch = np.empty((2, shape[axis], LANES))
        first = to.first[axis] - near.first[axis]
        running_extremum(values.ravel(), split, first, reach, largest, out.ravel(), scratch)
        values = out
    return values


def extremum_within_reach(
    sources: Sequence[FloatArray],
    blocks: Sequence[NodeBlock],
    to: NodeBlock,
    reach: int,
    *,
    largest: bool = False,
) -> FloatArray:
    """At the nodes `to`, the least (or largest) value within reach at the nodes of any block."""
    best: FloatArray | None = None
    for values, block in zip(sources, blocks, strict=True):
        found = box_extremum(values, block, to, reach, largest=largest)
        combine = np.maximum if largest else np.minimum
        best = found if best is None else combine(best, found, out=best)
    return np.full(to.shape, -np.inf if largest else np.inf) if best is None else best
