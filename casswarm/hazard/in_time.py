"""Hazards in time: at every time, a hazard whose radars have the positions and strengths of then.

Nothing is computed here but positions and strengths. `HazardInTime.at` gives the hazard of a time,
which is one of the other classes: its rates, derivatives, bounds and compiled code are theirs.
"""

from __future__ import annotations

from copy import copy
from dataclasses import dataclass, replace
from typing import Any, NoReturn, Self

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike
from typing_extensions import override

from .._util.threads import locked_cache
from ..errors import HazardError
from ..typing import BoolArray, Expr, FloatArray, IntArray
from .array_rates import single_rates
from .base import Hazard
from .custom import CustomHazard
from .kernel_hazard import KernelHazard
from .rate_bounds import LeastRate, PairBounds

_TOGETHER = 1 << 16  # coordinates of points whose rates are computed in one call
_ROUNDING = 1e-9  # relative: a step ends at the end of an interval despite rounding


@dataclass(frozen=True)
class RadarTrack:
    """A radar that moves, or that is active at times only.

    Parameters
    ----------
    position : (x, y)
        Where it is at time 0, and always without a velocity or path.
    strength : float
        Factor of its rate while it is active.
    velocity : (vx, vy)
        Constant velocity, in units of length per time.
    path : k waypoints (time, x, y)
        Straight between waypoints, at rest before the first and after the last; in place of
        `position` and `velocity` if there are any.
    active : intervals (begin, end), optional
        Active at times t with begin < t <= end, in the steps between them; by default always.
    """

    position: tuple[float, float]
    strength: float = 1.0
    velocity: tuple[float, float] = (0.0, 0.0)
    path: tuple[tuple[float, float, float], ...] = ()
    active: tuple[tuple[float, float], ...] | None = None

    def position_at(self, time: float) -> tuple[float, float]:
        """Position at a time."""
        if self.path:
            times, *axes = np.array(self.path).T
            x, y = (float(np.interp(time, times, axis)) for axis in axes)
            return x, y
        (x, y), (vx, vy) = self.position, self.velocity
        return x + vx * time, y + vy * time

    def strength_at(self, time: float) -> float:
        """Strength at a time, 0 while it is not active."""
        if self.active is None:
            return self.strength
        slack = _ROUNDING * abs(time)
        on = any(begin + slack < time <= end + slack for begin, end in self.active)
        return self.strength if on else 0.0


@dataclass(frozen=True)
class HazardInTime(Hazard):
    """Rates that depend on time: radars that move or switch, or a function of the user of time.

    Methods that take no time refuse with an error, so that no part of the package can treat the
    rates as constant.

    Parameters
    ----------
    hazard : KernelHazard or CustomHazard
        The hazard of time 0. A function of the user is called with the time as ``time=``.
    tracks : tuple of RadarTrack
        The last radars of the hazard, those that move or switch; only for rates made of kernels.
    dt : float
        Length of a step.
    """

    hazard: KernelHazard | CustomHazard
    tracks: tuple[RadarTrack, ...]
    dt: float

    @property
    @override
    def changes(self) -> bool:
        return True

    @override
    def at(self, time: float) -> Hazard:
        return _snapshot(self, float(time))

    @override
    def after(self, step: int) -> Hazard:
        return self.at(step * self.dt)

    @property
    def radar_positions(self) -> FloatArray:
        """Positions of the radars at time 0, shape (k, 2)."""
        return self.at(0.0).radar_positions

    @override
    def with_members(self, exposures: tuple[float, ...], densities: tuple[float, ...]) -> Self:
        return replace(self, hazard=self.hazard.with_members(exposures, densities))

    @override
    def sharing(self, other: Hazard) -> Self:
        base = other.hazard if isinstance(other, HazardInTime) else other
        return replace(self, hazard=self.hazard.sharing(base))

    @override
    def of_members(self, rows: IntArray) -> Self:
        return replace(self, hazard=self.hazard.of_members(rows))

    @override
    def rates(
        self,
        positions: ArrayLike,
        alive: ArrayLike | None = None,
        *,
        time: float | ArrayLike | None = None,
    ) -> FloatArray:
        if time is None:
            self._refuse("a rate without a time")
        if np.ndim(time) == 0:
            return self.at(float(np.asarray(time))).rates(positions, alive)
        x, times = np.asarray(positions, float), np.asarray(time, float)
        living = np.ones(x.shape[:-1], bool) if alive is None else np.asarray(alive, bool)
        if x.ndim != 3 or times.shape != x.shape[:1]:
            raise HazardError(
                f"time has shape {times.shape}; expected a number, or one for each state of "
                f"positions of shape {x.shape}",
                key="time",
                shape=times.shape,
            )
        living, rates = np.broadcast_to(living, x.shape[:-1]), np.empty(x.shape[:-1])
        for each in np.unique(times):
            rows = times == each
            rates[rows] = self.at(each).rates(x[rows], living[rows])
        return rates

    @override
    def single_agent_rates(self, points: ArrayLike, *, time: float | None = None) -> FloatArray:
        if time is None:
            self._refuse("a rate without a time")
        return self.at(time).single_agent_rates(points)

    @override
    def set_rates_along(self, positions: FloatArray, sets: BoolArray, step: int = 0) -> FloatArray:
        by_step = enumerate(np.moveaxis(positions, -3, 0), step + 1)
        return np.stack([self.after(t).set_rates_along(x, sets) for t, x in by_step], axis=-3)

    @override
    def rates_along(self, points: FloatArray, step: int = 0) -> FloatArray:
        hazards = [self.after(t) for t in range(step + 1, step + 1 + len(points))]
        if self.tracks and 0 < points.size <= _TOGETHER:
            flat = single_rates(hazards, points.reshape(len(points), -1, 2))  # type: ignore[arg-type]
            if (np.isfinite(flat) & (flat >= 0)).all():
                return flat.reshape(points.shape[:-1])
        rates = [each.single_agent_rates(x) for each, x in zip(hazards, points, strict=True)]
        return np.stack(rates) if rates else np.empty(points.shape[:-1])

    @override
    def expression_along(self, points: Expr) -> Expr:
        steps = range(points.shape[1])
        return ca.horzcat(*(self.after(t + 1).single_agent_expression(points[:, t]) for t in steps))

    def expression(self, positions: Expr, alive: Expr) -> Expr:  # noqa: ARG002
        """Refuse: see `at`."""
        self._refuse("an expression without a time")

    def single_agent_expression(self, points: Expr) -> Expr:  # noqa: ARG002
        """Refuse: see `expression_along`."""
        self._refuse("an expression without a time")

    @override
    def single_agent_lower_bound(self, lower: FloatArray, upper: FloatArray) -> FloatArray | None:
        self._refuse("a bound of rates without a time")

    @override
    def single_agent_rates_below(
        self, east: FloatArray, north: FloatArray, spacing: float
    ) -> FloatArray | None:
        self._refuse("a bound of rates without a time")

    @override
    def set_rates(self, positions: FloatArray, sets: BoolArray) -> FloatArray:
        self._refuse("a rate without a time")

    # bounds that hold for radars of any positions and strengths

    @override
    def least_rate(self, n: int) -> LeastRate | None:
        return self.hazard.least_rate(n)

    @override
    def least_rates(self, n: int, densities: FloatArray, rates: FloatArray) -> FloatArray | None:
        return self.hazard.least_rates(n, densities, rates)

    @override
    def density_bound(self, squared_distances: FloatArray) -> FloatArray:
        return self.hazard.density_bound(squared_distances)

    @override
    def pair_bounds(
        self, shape: tuple[int, int], spacing: float, certified: bool = True
    ) -> PairBounds | None:
        return self.hazard.pair_bounds(shape, spacing, certified)

    def _evaluate(self, positions: FloatArray, alive: BoolArray) -> FloatArray:  # noqa: ARG002
        self._refuse("a rate without a time")

    def _refuse(self, what: str) -> NoReturn:
        key, subject = _reason(self)
        raise HazardError(
            f"{key}: {subject}, so {what} is not defined: give rates a time, or use at(time) or "
            "after(step)",
            key=key,
            part=what,
        )


def _reason(hazard: Hazard) -> tuple[str, str]:
    """Key that makes rates depend on time, and how."""
    if isinstance(hazard, HazardInTime) and hazard.tracks:
        return "hazard.radar", "its radars move or switch"
    return "hazard.kind", "its function takes time"


@locked_cache(maxsize=4096)
def _snapshot(hazard: HazardInTime, time: float) -> Hazard:
    base = hazard.hazard
    if isinstance(base, CustomHazard):
        parameters: dict[str, Any] = dict(base.parameters) | {"time": time}
        return replace(base, parameters=parameters)
    rest = len(base.radars) - len(hazard.tracks)
    radars = *base.radars[:rest], *(track.position_at(time) for track in hazard.tracks)
    strengths = *base.radar_strengths[:rest], *(each.strength_at(time) for each in hazard.tracks)
    snapshot = copy(base)  # not `replace`, which refuses the strength 0 of a radar that is off
    object.__setattr__(snapshot, "_template", base)
    object.__setattr__(snapshot, "radars", radars)
    object.__setattr__(snapshot, "strengths", tuple(float(s) for s in strengths))
    return snapshot
