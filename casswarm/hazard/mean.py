"""The mean of several hazards, where it is not a hazard of a kind: those of users, other constants.

Where cases differ in radars and strengths only, the mean of their rates is one ordinary field
(`casswarm.scenario.Scenario.of_mean_rates`), which is faster.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any, Self

import numpy as np
from numpy.typing import ArrayLike
from typing_extensions import override

from ..typing import BoolArray, Expr, FloatArray
from .base import Hazard


@dataclass(frozen=True)
class MeanHazard(Hazard):
    """Weighted mean of the rates of hazards.

    Parameters
    ----------
    hazards : tuple of K Hazard
    weights : (K,)
    radars : tuple
        Not used: hazards have their own.
    """

    hazards: tuple[Hazard, ...]
    weights: tuple[float, ...]
    radars: tuple[tuple[float, float], ...] = ()

    def _mean(self, of: Callable[[Hazard], Any]) -> Any:
        """Mean of what hazards give."""
        values = [
            weight * of(each) for each, weight in zip(self.hazards, self.weights, strict=True)
        ]
        return sum(values[1:], values[0])

    def _with(self, hazards: Iterable[Hazard]) -> Self:
        return type(self)(tuple(hazards), self.weights)

    @property
    def radar_positions(self) -> FloatArray:
        """Positions of the radars of all hazards, shape (k, 2)."""
        return np.concatenate([each.radar_positions.reshape(-1, 2) for each in self.hazards])

    @property
    @override
    def landmarks(self) -> FloatArray:
        return np.concatenate([each.landmarks.reshape(-1, 2) for each in self.hazards])

    @property
    @override
    def changes(self) -> bool:
        return any(each.changes for each in self.hazards)

    @override
    def at(self, time: float) -> Hazard:
        return self._with(each.at(time) for each in self.hazards) if self.changes else self

    @override
    def after(self, step: int) -> Hazard:
        return self._with(each.after(step) for each in self.hazards) if self.changes else self

    @override
    def with_members(self, exposures: tuple[float, ...], densities: tuple[float, ...]) -> Self:
        return self._with(each.with_members(exposures, densities) for each in self.hazards)

    def expression(self, positions: Expr, alive: Expr) -> Expr:
        """Rates of all members: (2, n), (1, n) to (1, n)."""
        return self._mean(lambda each: each.expression(positions, alive))

    def single_agent_expression(self, points: Expr) -> Expr:
        """Rate of a single member at each of m points: (2, m) to (1, m)."""
        return self._mean(lambda each: each.single_agent_expression(points))

    @override
    def expression_along(self, points: Expr) -> Expr:
        return self._mean(lambda each: each.expression_along(points))

    def _evaluate(self, positions: FloatArray, alive: BoolArray) -> FloatArray:
        return np.asarray(self._mean(lambda each: each._evaluate(positions, alive)))

    @override
    def rates_along(self, points: FloatArray, step: int = 0) -> FloatArray:
        return np.asarray(self._mean(lambda each: each.rates_along(points, step)))

    @override
    def set_rates_along(self, positions: FloatArray, sets: BoolArray, step: int = 0) -> FloatArray:
        return np.asarray(self._mean(lambda each: each.set_rates_along(positions, sets, step)))

    @override
    def single_agent_rates(self, points: ArrayLike, *, time: float | None = None) -> FloatArray:
        return np.asarray(self._mean(lambda each: each.single_agent_rates(points, time=time)))

    @override
    def single_agent_lower_bound(self, lower: FloatArray, upper: FloatArray) -> FloatArray | None:
        if any(each.single_agent_lower_bound(lower, upper) is None for each in self.hazards):
            return None
        return np.asarray(self._mean(lambda each: each.single_agent_lower_bound(lower, upper)))

    @override
    def single_agent_rates_below(
        self, east: FloatArray, north: FloatArray, spacing: float
    ) -> FloatArray | None:
        below = {each: each.single_agent_rates_below(east, north, spacing) for each in self.hazards}
        if any(values is None for values in below.values()):
            return None
        return np.asarray(self._mean(below.__getitem__))
