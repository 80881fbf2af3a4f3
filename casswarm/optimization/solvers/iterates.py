"""Points that a solver visits on its way, as it reports them."""

from __future__ import annotations

import time
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from ...typing import FloatArray, IntArray

_ALL = 50
"""Number of the first iterates that are all kept."""

_RATIO = 1.05
"""Ratio of the numbers of later iterates that are kept."""


@dataclass(frozen=True, eq=False)
class Iterates:
    """Points that a solver visits in one solve: the first ones, some of the later ones, the last.

    Parameters
    ----------
    numbers : (K,)
        Of the iterations, increasing; 0 is the initial guess, as the solver starts from it.
    seconds : (K,)
        When each was reported, since the beginning of the solve. Recording takes some of it.
    x : (K, nx)
    """

    numbers: IntArray
    seconds: FloatArray
    x: FloatArray


class IterateLog:
    """Records the points with which it is called, as a callback of a solver.

    Where there are many, later ones are recorded more and more seldom, so that the memory grows
    with the logarithm of their number.
    """

    def __init__(self) -> None:
        self.count = 0
        self._kept: list[tuple[int, float, FloatArray]] = []
        self._last: tuple[int, float, FloatArray] | None = None  # if it is not kept
        self._started = time.perf_counter()

    def __call__(self, x: ArrayLike, *_: object) -> None:
        """Record x; what else a solver passes to its callback is not used."""
        number, self.count = self.count, self.count + 1
        seconds = time.perf_counter() - self._started
        point = number, seconds, np.array(x, dtype=float).ravel()
        if number < _ALL or number >= _RATIO * self._kept[-1][0]:
            self._kept.append(point)
            self._last = None
        else:
            self._last = point

    def iterates(self, x0: FloatArray, scale: float = 1.0) -> Iterates | None:
        """What was recorded, in units of `scale`, after x0 if the solver did not report a start.

        Parameters
        ----------
        x0 : (nx,)
            The initial guess; empty if the first point that was reported is the start.
        scale : float

        Returns
        -------
        Iterates or None
            None if no point was reported.
        """
        if not self.count:
            return None
        kept = self._kept if self._last is None else [*self._kept, self._last]
        numbers, seconds, points = zip(*kept, strict=True)
        at, when, x = np.array(numbers), np.array(seconds), scale * np.array(points)
        if x0.size:
            at, when, x = np.r_[0, at + 1], np.r_[0.0, when], np.vstack([x0, x])
        return Iterates(at, when, x)
