"""The paper's two destruction rates."""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca
import numpy as np

from .._util.threads import locked_cache
from ..typing import Expr, FloatArray
from .codegen import lowered_kernels
from .kernel_hazard import KernelHazard, regular, require_finite
from .rate_bounds import (
    LeastRate,
    LeastRateLines,
    PairBounds,
    inverse_squares_below,
    least_inverse_squares,
    pair_bounds,
    saturation_least_rates,
)
from .zones import zone_rates_below

_MOST_FACTORS = 8  # of collision rates that are products


@dataclass(frozen=True)
class Saturation(KernelHazard):
    """Scenario I of the paper: radars that a dense swarm saturates (equations 8 and 9).

    lambda_i = sum_l strength_l alpha_1 / ||x_i - x_l||^2 / (1 + alpha_2 D_i), where
    D_i = sum over living j of 1 / (1 + alpha_3 ||x_i - x_j||^2), j = i included.

    Distances below `core_radius` are regularised (see `regular`): at a radar the rate is large and
    finite. A single member has lambda-bar(x) = sum_l alpha_1 / (1 + alpha_2) / ||x - x_l||^2, and
    in addition the rates of the `zones`.
    """

    alpha_1: float = 4.0
    alpha_2: float = 3.0
    alpha_3: float = 4.0

    def __post_init__(self) -> None:
        super().__post_init__()
        require_finite(self, positive=("alpha_1", "alpha_3"), not_negative=("alpha_2",))

    def source(self, squared_distance: Expr) -> Expr:
        """alpha_1 / r^2."""
        return self.alpha_1 / regular(squared_distance, self.core_radius)

    def density(self, squared_distance: Expr) -> Expr:
        """h = 1 / (1 + alpha_3 r^2), equation (9)."""
        return 1.0 / (1.0 + self.alpha_3 * squared_distance)

    def collision(self, squared_distance: Expr) -> Expr:
        """Zero: members do not collide."""
        return 0.0 * squared_distance

    @property
    def gathers(self) -> bool:
        """The density h, and with it the protection, decreases with distance."""
        return True

    def zone(self, east: Expr, north: Expr) -> Expr:
        """Zones have the rate that they state for a single agent, and are saturated as radars."""
        return (1.0 + self.alpha_2) * super().zone(east, north)

    def combine(self, source: Expr, density: Expr, collision: Expr) -> Expr:
        """S / (1 + alpha_2 D) + C, equation (8)."""
        return source / (1.0 + self.alpha_2 * density) + collision

    def single_agent_lower_bound(self, lower: FloatArray, upper: FloatArray) -> FloatArray | None:
        """Sum over radars of the least rate in the box."""
        if not self._is_papers:
            return None
        least = least_inverse_squares(
            lower, upper, self.radar_positions, self.radar_strengths, self.core_radius
        )
        of_zones = sum((zone.least_rates(lower, upper) for zone in self.zones), np.zeros(()))
        return np.asarray(self._unit_rate * least + of_zones)

    def single_agent_rates_below(
        self, east: FloatArray, north: FloatArray, spacing: float
    ) -> FloatArray | None:
        """Rates minus the error of interpolation, see `casswarm.hazard.rate_bounds`."""
        if not self._is_papers:
            return super().single_agent_rates_below(east, north, spacing)
        below = inverse_squares_below(
            *(east, north, spacing), self.radar_positions, self.radar_strengths, self.core_radius
        )
        return zone_rates_below(self.zones, (east, north, spacing), self._unit_rate * below)

    def least_rate(self, n: int) -> LeastRate | None:
        """Lower bound of a member's rate, at the best compromise of saturation and collisions."""
        return _least_rates(self.template, n).least_rate() if self._is_papers else None

    def least_rates(self, n: int, densities: FloatArray, rates: FloatArray) -> FloatArray | None:
        """Lower bounds of a member's rate, by the largest density of its neighbours."""
        if not self._is_papers:
            return super().least_rates(n, densities, rates)
        return _least_rates(self.template, n).at_most(densities, rates)

    def density_bound(self, squared_distances: FloatArray) -> FloatArray:
        """h, which decreases with distance."""
        if not self._is_papers:
            return super().density_bound(squared_distances)
        return (1 + 1e-14) / (1.0 + self.alpha_3 * squared_distances)

    def pair_bounds(
        self, shape: tuple[int, int], spacing: float, certified: bool = True
    ) -> PairBounds | None:
        """Share and collision rate minus the error of interpolation."""
        if not self._is_papers:
            return None
        alpha = self.alpha_2, self.alpha_3
        return pair_bounds(
            shape, spacing, alpha, self._collision_scales, self.core_radius, certified
        )

    @property
    def _collision_scales(self) -> tuple[float, float] | None:
        """beta_1 and beta_2, where members collide."""
        return None

    @property
    def _is_papers(self) -> bool:
        """True if the rates are the paper's, for which bounds are proven.

        Those of a subclass may differ, and members.
        """
        return type(self) in (Saturation, SaturationCollision) and self.members is None

    @property
    def _unit_rate(self) -> float:
        """Single-agent rate at distance 1 from a radar of strength 1."""
        return self.alpha_1 / (1.0 + self.alpha_2)


@dataclass(frozen=True)
class SaturationCollision(Saturation):
    """Scenario II of the paper: saturation, and destruction by collision.

    Adds sum over living j != i of (beta_1 / ||x_i - x_j||)^beta_2 to the rate of `Saturation`.
    """

    beta_1: float = 0.2
    beta_2: float = 6.0

    def __post_init__(self) -> None:
        super().__post_init__()
        require_finite(self, positive=("beta_1", "beta_2"))

    @property
    def _collision_scales(self) -> tuple[float, float]:
        return self.beta_1, self.beta_2

    @property
    def gathers(self) -> bool:
        """False: members collide, so that a rate falls with distance where they are close."""
        return False

    @property
    def structural(self) -> tuple[str, ...]:
        """beta_2, where the collision rate is a product."""
        return ("beta_2",) if 0.5 * self.beta_2 in range(1, _MOST_FACTORS + 1) else ()

    def collision(self, squared_distance: Expr) -> Expr:
        """(beta_1 / r)^beta_2 of squared distances: a product for even beta_2, or an exponential.

        Both have slopes that are cheap.
        """
        ratio, exponent = self.beta_1**2 / regular(squared_distance, self.core_radius), self.beta_2
        if not isinstance(exponent, ca.SX) and self.structural:
            return ratio ** int(0.5 * exponent)
        return ca.exp(0.5 * exponent * ca.log(ratio))


@locked_cache(maxsize=64)
def _least_rates(hazard: Saturation, n: int) -> LeastRateLines:
    """Lower bounds of a member's rate among n."""
    collision = lowered_kernels(hazard)[2]
    return saturation_least_rates(
        n, hazard.alpha_2, lambda h: collision((1.0 / h - 1.0) / hazard.alpha_3)
    )
