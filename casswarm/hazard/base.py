"""Base class of hazards: rates as numbers for batches of states, and as CasADi expressions."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import Self

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike

from .._util.text import shown
from ..errors import HazardError
from ..typing import BoolArray, Expr, FloatArray, IntArray
from .rate_bounds import LeastRate, PairBounds, nodes_below


class Hazard(ABC):
    """A field of destruction rates lambda_i(x, alive), per unit time.

    A hazard depends on positions and on the living members only. Subclasses are immutable and
    hashable: problems are cached by their hazard.
    """

    @property
    @abstractmethod
    def radar_positions(self) -> FloatArray:
        """Positions of the radars, shape (k, 2); k = 0 if there are none."""

    @property
    def landmarks(self) -> FloatArray:
        """Points (m, 2) that a path has on its left or right: radars, and centres of zones."""
        return self.radar_positions

    @property
    def changes(self) -> bool:
        """True if rates depend on time: see `casswarm.hazard.HazardInTime`."""
        return False

    def at(self, time: float) -> Hazard:  # noqa: ARG002
        """The hazard at a time, in units of time: rates that do not depend on it."""
        return self

    def after(self, step: int) -> Hazard:  # noqa: ARG002
        """The hazard at time ``step * dt``: after step t, members have the rates of t + 1."""
        return self

    @abstractmethod
    def expression(self, positions: Expr, alive: Expr) -> Expr:
        """Rates of all members as one expression.

        Parameters
        ----------
        positions : MX of shape (2, n)
            One column per member.
        alive : MX or DM of shape (1, n)
            1 for the living, 0 for the destroyed.

        Returns
        -------
        MX of shape (1, n)
            lambda_i; entries of the destroyed are masked by `rates`.
        """

    def expressions(self, positions: Expr, sets: Expr) -> Expr:
        """Rates of all members for each of m sets of living members.

        Parameters
        ----------
        positions : MX of shape (2, n)
        sets : MX or DM of shape (m, n)
            One row per set, 1 for the living; probabilities of being alive in a mean field.

        Returns
        -------
        MX of shape (m, n)
        """
        sets = ca.MX(sets)
        count, n = sets.shape
        x, living = ca.MX.sym("positions", 2, n), ca.MX.sym("alive", 1, n)
        rates = ca.Function("rates", [x, living], [self.expression(x, living)])
        values = rates.map(count)(ca.repmat(positions, 1, count), ca.reshape(sets.T, 1, count * n))
        return ca.reshape(values, n, count).T

    @abstractmethod
    def single_agent_expression(self, points: Expr) -> Expr:
        """Rate lambda-bar of a single member at each of m points: (2, m) to (1, m)."""

    @abstractmethod
    def _evaluate(self, positions: FloatArray, alive: BoolArray) -> FloatArray:
        """Rates (B, n) of a batch of states (B, n, 2), (B, n); unchecked, unmasked."""

    def rates(
        self,
        positions: ArrayLike,
        alive: ArrayLike | None = None,
        *,
        time: float | ArrayLike | None = None,  # noqa: ARG002
    ) -> FloatArray:
        """Rates per unit time of every member, 0 for the destroyed.

        Parameters
        ----------
        positions : array_like, shape (n, 2) or (B, n, 2)
            One state, or a batch of states.
        alive : array_like of bool, shape (n,) or (B, n), optional
            Living members, all by default. A single row applies to the whole batch.
        time : float or array_like of shape (B,), optional
            Time of the states, in units of time; hazards that do not depend on it need none.

        Returns
        -------
        ndarray, shape (n,) or (B, n)

        Raises
        ------
        HazardError
            Wrong shapes, positions that are not finite, or (for custom rates) a rate that is
            negative or not finite.

        Examples
        --------
        The rate of a member at distance 1 from a radar, alone and with another at the same point:

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
                f"positions have shape {x.shape}; expected (n, 2) or (B, n, 2), n >= 1",
                key="positions",
                shape=x.shape,
            )
        living = np.ones(x.shape[:-1], bool) if alive is None else np.asarray(alive, dtype=bool)
        if living.shape not in (x.shape[:-1], x.shape[-2:-1]):
            raise HazardError(
                f"alive has shape {living.shape}; expected {x.shape[:-1]}, as for positions",
                key="alive",
                shape=living.shape,
                expected=x.shape[:-1],
            )
        living = np.broadcast_to(living, x.shape[:-1])
        if not np.isfinite(x).all():
            raise HazardError("positions hold NaN or infinity", key="positions")
        batch = np.ascontiguousarray(x.reshape(-1, *x.shape[-2:]))
        mask = np.ascontiguousarray(living.reshape(-1, x.shape[-2]))
        rates = np.where(mask, self._evaluate(batch, mask), 0.0)
        bad = ~(np.isfinite(rates) & (rates >= 0))
        if bad.any():
            state, member = np.argwhere(bad)[0]
            east, north = batch[state, member]
            raise HazardError(
                f"{self!r} gives the rate {rates[state, member]} for member {member} at "
                f"({east:g}, {north:g}); rates must be finite and not negative",
                hazard=repr(self),
                state=int(state),
                member=int(member),
                position=(float(east), float(north)),
                rate=float(rates[state, member]),
            )
        return rates.reshape(x.shape[:-1])

    def with_members(self, exposures: tuple[float, ...], densities: tuple[float, ...]) -> Self:
        """The hazard of members with such factors (n,) of rates, and terms (n,) of densities.

        Raises
        ------
        HazardError
            The rates are not made of kernels.
        """
        raise HazardError(
            f"{type(self).__name__} has no exposures and densities of members: its rates are not "
            "made of kernels",
            key="exposures",
            value=(exposures, densities),
        )

    def sharing(self, other: Hazard) -> Self:  # noqa: ARG002
        """The hazard with the compiled code of another, where their rates allow that."""
        return self

    def of_members(self, rows: IntArray) -> Self:  # noqa: ARG002
        """The hazard of some of the members: itself, unless they differ."""
        return self

    def additional_rates(self, points: FloatArray, positions: FloatArray) -> FloatArray:
        """Rates (B,) of a member added at points (B, 2) to living members at positions (n, 2)."""
        return self.rates(with_others(points, positions))[:, 0]

    def set_rates(self, positions: FloatArray, sets: BoolArray) -> FloatArray:
        """Rates (B, m, n) of members at positions (B, n, 2) in each of m sets (m, n) of the living.

        They are 0 for members that are not in a set.
        """
        states = np.repeat(positions, len(sets), axis=0)
        rates = self.rates(states, np.tile(sets, (len(positions), 1)))
        return rates.reshape(len(positions), *sets.shape)

    def set_rates_along(self, positions: FloatArray, sets: BoolArray, step: int = 0) -> FloatArray:  # noqa: ARG002
        """Rates (..., T, m, n) as `set_rates`, at positions (..., T, n, 2) from `step` + 1 on."""
        states = positions.reshape(-1, *positions.shape[-2:])
        return self.set_rates(states, sets).reshape(*positions.shape[:-2], *sets.shape)

    def rates_along(self, points: FloatArray, step: int = 0) -> FloatArray:  # noqa: ARG002
        """Rates (T, ...) of single members on paths, at points (T, ..., 2) from `step` + 1 on."""
        return self.single_agent_rates(points)

    def expression_along(self, points: Expr) -> Expr:
        """Rates of a single member on a path, at points after 1..T steps: (2, T) to (1, T)."""
        return self.single_agent_expression(points)

    def single_agent_rates(
        self,
        points: ArrayLike,
        *,
        time: float | None = None,  # noqa: ARG002
    ) -> FloatArray:
        """Rate lambda-bar of a single member at each point: (..., 2) to (...)."""
        x = np.asarray(points, dtype=float)
        if x.shape[-1:] != (2,):
            raise HazardError(
                f"points have shape {x.shape}; expected (..., 2)", key="points", shape=x.shape
            )
        return self.rates(x.reshape(-1, 1, 2)).reshape(x.shape[:-1])

    def single_agent_lower_bound(self, lower: FloatArray, upper: FloatArray) -> FloatArray | None:  # noqa: ARG002
        """Lower bounds of `single_agent_rates` over boxes, None if none are known.

        Guides are certified for hazards that provide them: see `casswarm.bounds`.

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
        """Lower bound of a member's rate in a swarm of n, given its single-agent rate; or None.

        Success is certified for hazards that provide it and `single_agent_rates_below`: see
        `casswarm.bounds.success_bound`.
        """
        return None

    def least_rates(self, n: int, densities: FloatArray, rates: FloatArray) -> FloatArray | None:
        """`least_rate` where the densities of the neighbours add up to at most a number.

        By default the same at all densities.

        Parameters
        ----------
        n : int
            Number of members.
        densities : (q,)
            Bounds on the sum of `density_bound` over the other members.
        rates : (d,)
            Single-agent rates.

        Returns
        -------
        ndarray of shape (q, d), or None
        """
        least = self.least_rate(n)
        return None if least is None else np.tile(least(rates), (len(densities), 1))

    def density_bound(self, squared_distances: FloatArray) -> FloatArray:
        """Upper bounds (...), at most 1, of the density that a neighbour this far away adds."""
        return np.ones_like(squared_distances)

    def pair_bounds(
        self,
        shape: tuple[int, int],  # noqa: ARG002
        spacing: float,  # noqa: ARG002
        certified: bool = True,  # noqa: ARG002
    ) -> PairBounds | None:
        """Lower bounds of the rates of two members, as values at nodes; None if none are known.

        The optimal value of two members is certified for hazards that provide them: see
        `casswarm.bounds.pair_bound`.

        Parameters
        ----------
        shape : pair of int
            n and m: the nodes are the differences h (i, j) of positions, from (1 - n, 1 - m) on.
        spacing : float
            h.
        certified : bool
            Whether values are bounds when they are interpolated, or the rates at the nodes.
        """
        return None

    def single_agent_rates_below(
        self, east: FloatArray, north: FloatArray, spacing: float
    ) -> FloatArray | None:
        """Values at grid nodes whose bilinear interpolation is nowhere above `single_agent_rates`.

        By default by lower bounds over parts of cells, whose error is of the order of their size;
        with known second derivatives it is of the order of the square of the spacing.

        Parameters
        ----------
        east, north : (n,), (m,)
            Coordinates of the nodes of a grid of square cells.
        spacing : float
            Side of a cell.

        Returns
        -------
        ndarray of shape (n, m), or None if `single_agent_lower_bound` is None
        """
        nodes = np.stack(np.meshgrid(east, north, indexing="ij"), axis=-1)
        around = self.single_agent_lower_bound(nodes - spacing, nodes + spacing)
        if around is None or min(around.shape) < 2:
            return around
        rates = self.single_agent_rates(nodes)
        if not np.isfinite(rates).all():
            return around

        def bound(lower: FloatArray, upper: FloatArray) -> FloatArray:
            least = self.single_agent_lower_bound(lower, upper)
            assert least is not None
            return least

        return nodes_below(rates, nodes, bound)


def checked_radars(radars: ArrayLike) -> tuple[tuple[float, float], ...]:
    """Radars as a hashable tuple of pairs of floats; HazardError unless (k, 2) finite numbers."""
    try:
        array = np.array(radars, dtype=float)
    except (TypeError, ValueError):
        raise HazardError(
            f"radars are {shown(radars)}; expected k pairs (x, y) of numbers",
            key="radars",
            value=repr(radars),
        ) from None
    if array.size and (array.ndim != 2 or array.shape[1] != 2):
        raise HazardError(
            f"radars have shape {array.shape}; expected (k, 2)", key="radars", shape=array.shape
        )
    if not np.isfinite(array).all():
        raise HazardError(f"radars must be finite; got {radars!r}", key="radars", value=radars)
    return tuple((float(x), float(y)) for x, y in array)


def with_others(points: FloatArray, positions: FloatArray) -> FloatArray:
    """States (B, 1 + n, 2) of a member at each of the points (B, 2) and others at (n, 2)."""
    others = np.broadcast_to(positions, (len(points), *positions.shape))
    return np.concatenate([points[:, None], others], axis=1)


def subdivided(path: FloatArray, parts: int) -> FloatArray:
    """Points (parts T + 1, ...) of a path (T+1, ...), straight between its own."""
    if parts == 1 or len(path) < 2:
        return path
    shares = np.arange(1, parts + 1).reshape(-1, *[1] * (path.ndim - 1)) / parts
    points = path[:-1, None] + shares * np.diff(path, axis=0)[:, None]
    points[:, -1] = path[1:]
    return np.concatenate([path[:1], points.reshape(-1, *path.shape[1:])])


def mean_rates_along(
    hazard: Hazard, positions: FloatArray, substeps: int = 1, step: int = 0
) -> FloatArray:
    """Single-agent rates (T, ...) of the steps of paths (T+1, ..., 2) that begin at a step.

    Those at the end of every step; where it has several parts, which ``hazard.after`` counts, the
    means over them.
    """
    rates = hazard.rates_along(subdivided(positions, substeps)[1:], substeps * step)
    if substeps == 1:
        return rates
    return np.asarray(rates.reshape(-1, substeps, *rates.shape[1:]).mean(axis=1))
