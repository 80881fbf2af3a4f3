"""What every hazard offers: rates as numbers for batches of states, and as CasADi expressions."""

from __future__ import annotations

from abc import ABC, abstractmethod

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from ..errors import HazardError
from ..typing import BoolArray, Expr, FloatArray
from .protection import LeastRate


class Hazard(ABC):
    """A field of destruction rates lambda_i(x, alive), per unit time.

    A hazard knows positions and who is alive, nothing of time, policies or solvers. Subclasses are
    immutable and hashable: the problems built from a hazard are cached by it.
    """

    @property
    @abstractmethod
    def radar_positions(self) -> FloatArray:
        """Positions of the radars, shape (k, 2); k = 0 where the hazard has none."""

    @abstractmethod
    def expression(self, positions: Expr, alive: Expr) -> Expr:
        """Rates of all members as one expression.

        Parameters
        ----------
        positions : MX of shape (2, n)
            A column a member.
        alive : MX or DM of shape (1, n)
            1 for the living, 0 for the destroyed.

        Returns
        -------
        MX of shape (1, n)
            lambda_i; for the destroyed, whom `rates` masks, whatever the formula gives.
        """

    def expressions(self, positions: Expr, sets: Expr) -> Expr:
        """Rates of all members as `expression` gives them, in each of m sets of the living.

        Parameters
        ----------
        positions : MX of shape (2, n)
        sets : MX or DM of shape (m, n)
            A row a set, 1 for the living. A mean field gives probabilities of being alive instead.

        Returns
        -------
        MX of shape (m, n)
        """
        sets = ca.MX(sets)
        count, n = sets.shape
        x, living = ca.MX.sym("positions", 2, n), ca.MX.sym("alive", 1, n)
        rates = ca.Function("rates", [x, living], [self.expression(x, living)])
        found = rates.map(count)(ca.repmat(positions, 1, count), ca.reshape(sets.T, 1, count * n))
        return ca.reshape(found, n, count).T

    @abstractmethod
    def lone_expression(self, points: Expr) -> Expr:
        """Rate lambda-bar of a lone member at each of m points: (2, m) to (1, m)."""

    @abstractmethod
    def _evaluate(self, positions: FloatArray, alive: BoolArray) -> FloatArray:
        """Rates (B, n) of a batch of states (B, n, 2), (B, n); unchecked, unmasked."""

    def rates(self, positions: ArrayLike, alive: ArrayLike | None = None) -> FloatArray:
        """Rates per unit time of every member, 0 for the destroyed.

        Parameters
        ----------
        positions : array_like, shape (n, 2) or (B, n, 2)
            One state, or a batch of states.
        alive : array_like of bool, shape (n,) or (B, n), optional
            Who is alive; everybody by default. One row serves a whole batch.

        Returns
        -------
        ndarray, shape (n,) or (B, n)

        Raises
        ------
        HazardError
            Wrong shapes, positions that are not finite, or (for rates written by users) a rate
            that is negative or not finite.

        Examples
        --------
        The rate of a member at distance 1 from a radar, alone and with another in its place:

        >>> import casswarm as csw
        >>> hazard = csw.Saturation(radars=[(0, 0)], alpha_1=4.0, alpha_2=3.0, alpha_3=4.0)
        >>> hazard.rates([[1, 0]])
        array([1.])
        >>> hazard.rates([[1, 0], [1, 0]]).round(4)
        array([0.5714, 0.5714])
        """
        x = np.asarray(positions, dtype=float)
        if x.ndim not in (2, 3) or x.shape[-1] != 2 or x.shape[-2] == 0:
            raise HazardError(
                f"positions have shape {x.shape}; expected (n, 2) or (B, n, 2), n >= 1"
            )
        living = np.ones(x.shape[:-1], bool) if alive is None else np.asarray(alive, dtype=bool)
        if living.shape not in (x.shape[:-1], x.shape[-2:-1]):
            raise HazardError(
                f"alive has shape {living.shape}; expected {x.shape[:-1]}, as positions have"
            )
        living = np.broadcast_to(living, x.shape[:-1])
        if not np.isfinite(x).all():
            raise HazardError("positions hold NaN or infinity")
        batch = np.ascontiguousarray(x.reshape(-1, *x.shape[-2:]))
        mask = np.ascontiguousarray(living.reshape(-1, x.shape[-2]))
        rates = np.where(mask, self._evaluate(batch, mask), 0.0)
        self._check(rates, batch)
        return rates.reshape(x.shape[:-1])

    def single_agent_rates(self, points: ArrayLike) -> FloatArray:
        """Rate lambda-bar of a lone member at each point: (..., 2) to (...)."""
        x = np.asarray(points, dtype=float)
        if x.shape[-1:] != (2,):
            raise HazardError(f"points have shape {x.shape}; expected (..., 2)")
        return self.rates(x.reshape(-1, 1, 2)).reshape(x.shape[:-1])

    def single_agent_lower_bound(self, lower: FloatArray, upper: FloatArray) -> FloatArray | None:  # noqa: ARG002
        """Lower bounds of `single_agent_rates` over boxes, None where nobody knows any.

        Hazards that offer them can have guides certified: see `casswarm.planning.bounds`.

        Parameters
        ----------
        lower, upper : (..., 2)
            Corners of the boxes.

        Returns
        -------
        ndarray of shape (...), or None
        """
        return None

    def least_rate(self, n: int) -> LeastRate | None:  # noqa: ARG002
        """Least rate of a member of a swarm of n by its lone rate, None where nobody knows it.

        Hazards that offer it and `lone_rates_below` have success certified: see
        `casswarm.planning.bounds.success_bound`.
        """
        return None

    def lone_rates_below(
        self, east: FloatArray, north: FloatArray, spacing: float
    ) -> FloatArray | None:
        """Values at grid nodes whose bilinear interpolation is nowhere above `single_agent_rates`.

        Here the least rate of the four cells around each node, which comes up to the rate as the
        spacing; hazards that know their second derivatives come up as its square.

        Parameters
        ----------
        east, north : (n,), (m,)
            Coordinates of the nodes of a grid of square cells.
        spacing : float
            Side of a cell.

        Returns
        -------
        ndarray of shape (n, m), or None where `single_agent_lower_bound` knows none
        """
        nodes = np.stack(np.meshgrid(east, north, indexing="ij"), axis=-1)
        return self.single_agent_lower_bound(nodes - spacing, nodes + spacing)

    def _check(self, rates: FloatArray, positions: FloatArray) -> None:
        bad = ~(np.isfinite(rates) & (rates >= 0))
        if bad.any():
            state, member = np.argwhere(bad)[0]
            x, y = positions[state, member]
            raise HazardError(
                f"{self!r} gives the rate {rates[state, member]} for member {member} at "
                f"({x:g}, {y:g}); rates must be finite and not negative"
            )


def checked_radars(radars: ArrayLike) -> tuple[tuple[float, float], ...]:
    """Radars as pairs of floats, hashable whatever sequence was given.

    Raises
    ------
    HazardError
        They are no (k, 2) finite numbers.
    """
    try:
        array = np.array(radars, dtype=float)
    except (TypeError, ValueError):
        raise HazardError(f"radars are {radars!r}; expected k pairs (x, y) of numbers") from None
    if array.size and (array.ndim != 2 or array.shape[1] != 2):
        raise HazardError(f"radars have shape {array.shape}; expected (k, 2)")
    if not np.isfinite(array).all():
        raise HazardError(f"radars must be finite; got {radars!r}")
    return tuple((float(x), float(y)) for x, y in array)
