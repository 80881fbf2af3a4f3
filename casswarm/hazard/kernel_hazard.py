"""Rates composed of scalar kernels of squared distance.

A member's rate is combine(S, D, C) of three sums of scalar kernels::

    S = sum over radars l      strength_l source(||x_i - x_l||^2)  + zone(x_i)
    D = sum over living j      density(||x_i - x_j||^2)        (j = i counts)
    C = sum over living j != i collision(||x_i - x_j||^2)

Where members differ, S has the factor e_i, the exposure of the member, and the term of j in D has
the factor c_j, its density.

Each kernel is written once, as a CasADi expression. `KernelHazard` assembles it in matrix form for
the optimisation problems (n^2 pairs as one matrix, never an unrolled loop) and, translated to
NumPy, for batches of states.
"""

from __future__ import annotations

from abc import abstractmethod
from copy import copy
from dataclasses import dataclass, field
from numbers import Real
from typing import NamedTuple, Self

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike
from typing_extensions import override

from .._util.numbers import CORE_RADIUS
from .._util.text import counted, shown
from .._util.threads import locked_cache
from ..errors import HazardError
from ..typing import BoolArray, Expr, FloatArray, IntArray
from .array_rates import blocked, set_rates, state_rates, unblocked
from .base import Hazard, checked_radars, with_others
from .rate_kernels import LANES
from .zones import Zone, zone_rates


def regular(squared_distance: Expr, core_radius: Expr = CORE_RADIUS) -> Expr:
    """Squared distance, kept above zero so that its inverse is finite.

    With e = `core_radius` it is exactly the argument s from e^2 on; below, it is
    (e^2 + s^2 / e^2) / 2, which has the same value and slope at e^2 and is at least e^2 / 2.
    """
    core = core_radius**2
    missing = core - ca.fmin(squared_distance, core)
    return squared_distance + missing**2 / (2 * core)


class Members(NamedTuple):
    """Factors of the members of a swarm, where they differ, (n,) each."""

    exposures: tuple[float, ...]
    densities: tuple[float, ...]

    def of(self, rows: IntArray) -> Members:
        """Those of some of the members."""
        return Members(*(tuple(float(each[row]) for row in rows) for each in self))


@dataclass(frozen=True)
class KernelHazard(Hazard):
    """Base of the hazards that are composed of kernels.

    Kernels must be finite at zero distance, where `regular(squared_distance, self.core_radius)`
    helps: every member is paired with itself, and the pair is masked where it does not count.

    Parameters
    ----------
    radars : k pairs (x, y)
        Positions of the sources of the hazard; at least one, unless there are zones.
    strengths : k positive floats, optional
        Factor of every radar; 1 by default.
    core_radius : float, keyword only
        Distance below which kernels are regularised, in units of length; 0.01 by default. That of
        a scenario is ``hazard.core_radius``.
    zones : tuple of Zone, keyword only
        Regions that endanger those who enter them.
    members : Members, keyword only
        Exposures and densities of the n members, where they differ. Single agents have the factors
        1, and no bounds of rates are known: those of equal members hold for a scenario that is more
        favourable, see `casswarm.scenario.Scenario.most_favourable`.
    """

    radars: tuple[tuple[float, float], ...]
    strengths: tuple[float, ...] | None = None
    core_radius: float = field(default=CORE_RADIUS, kw_only=True)
    zones: tuple[Zone, ...] = field(default=(), kw_only=True, repr=False)
    members: Members | None = field(default=None, kw_only=True, repr=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "radars", checked_radars(self.radars))
        if not self.radars and not self.zones:
            raise HazardError(
                "radars are empty; expected (k, 2), k >= 1", key="radars", value=self.radars
            )
        if self.strengths is not None:
            if len(self.strengths) != len(self.radars):
                raise HazardError(
                    f"{counted(len(self.strengths), 'strength')} for "
                    f"{counted(len(self.radars), 'radar')}; expected one each",
                    key="strengths",
                    value=self.strengths,
                    expected=len(self.radars),
                )
            object.__setattr__(self, "strengths", tuple(float(s) for s in self.strengths))
            if not all(0 < strength < np.inf for strength in self.strengths):
                raise HazardError(
                    f"strengths must be finite and above zero; got {self.strengths}",
                    key="strengths",
                    value=self.strengths,
                )
        require_finite(self, positive=("core_radius",))

    @abstractmethod
    def source(self, squared_distance: Expr) -> Expr:
        """Kernel of a member and a radar of strength 1."""

    @abstractmethod
    def density(self, squared_distance: Expr) -> Expr:
        """Kernel of a member and a living member, itself included."""

    @abstractmethod
    def collision(self, squared_distance: Expr) -> Expr:
        """Kernel of a member and another living member."""

    @abstractmethod
    def combine(self, source: Expr, density: Expr, collision: Expr) -> Expr:
        """Rate of a member from its three sums."""

    def zone(self, east: Expr, north: Expr) -> Expr:
        """Sum over the zones at a point, which adds to that over the radars."""
        return zone_rates(self.zones, east, north)

    @property
    def radar_positions(self) -> FloatArray:
        """Positions of the radars, shape (k, 2)."""
        return np.array(self.radars, dtype=float).reshape(-1, 2)

    @property
    def landmarks(self) -> FloatArray:
        """Positions (k + z, 2) of the radars, and the centres of the zones."""
        return np.array([*self.radars, *(zone.center for zone in self.zones)]).reshape(-1, 2)

    @property
    def template(self) -> KernelHazard:
        """A hazard with the same kernels: itself or, of a time, the hazard of time 0.

        What is derived from kernels alone is derived once for all times.
        """
        template: KernelHazard = vars(self).get("_template", self)
        return template

    @property
    def collides(self) -> bool:
        """True if members endanger each other, which makes formation problems multimodal."""
        return _collides(self.template)

    @override
    def sharing(self, other: Hazard) -> Self:
        """The hazard with the compiled code of another, if they differ in radars only."""
        if not isinstance(other, KernelHazard):
            return self
        same = copy(self)
        for name in ("radars", "strengths"):
            object.__setattr__(same, name, getattr(other.template, name))
        if same != other.template:
            return self
        shared = copy(self)
        object.__setattr__(shared, "_template", other.template)
        return shared

    @property
    def gathers(self) -> bool:
        """True if a member's rate increases with every distance to another."""
        return False

    @property
    def structural(self) -> tuple[str, ...]:
        """Names of numbers that decide how kernels are written: no parameters of compiled code."""
        return ()

    @property
    def radar_strengths(self) -> FloatArray:
        """Strengths of the radars, shape (k,)."""
        return np.ones(len(self.radars)) if self.strengths is None else np.array(self.strengths)

    def expression(self, positions: Expr, alive: Expr) -> Expr:
        """Rates of all members, matrix form: (2, n), (1, n) to (1, n)."""
        return self.expressions(positions, alive)

    def expressions(self, positions: Expr, sets: Expr) -> Expr:
        """Rates of all members in m sets of the living: (2, n), (m, n) to (m, n)."""
        n, count = positions.shape[1], sets.shape[0]
        east, north = (ca.repmat(positions[axis, :].T, 1, n) for axis in (0, 1))
        pairs = (east - east.T) ** 2 + (north - north.T) ** 2
        others = 1 - ca.DM.eye(n)
        density = _everywhere(self.density(pairs), pairs)
        if self.members is not None:
            density *= ca.repmat(ca.DM(self.members.densities), 1, n)
        density = ca.mtimes(sets, density)
        collision = ca.mtimes(sets, self.collision(pairs) * others)
        sources = self._sources(positions)
        if self.members is not None:
            sources *= ca.DM(self.members.exposures).T
        return self.combine(
            sources if count == 1 else ca.repmat(sources, count, 1), density, collision
        )

    def single_agent_expression(self, points: Expr) -> Expr:
        """Rate of a single member at each of m points: (2, m) to (1, m)."""
        return self.combine(self._sources(points), self.density(0.0), 0.0)

    def _sources(self, points: Expr) -> Expr:
        zones = self.zone(points[0, :], points[1, :])
        if not self.radars:
            return zones
        radars = self.radar_positions
        column = ca.DM.ones(len(radars), 1)
        pairs = sum(
            (ca.mtimes(column, points[axis, :]) - ca.repmat(radars[:, axis], 1, points.shape[1]))
            ** 2
            for axis in (0, 1)
        )
        weights = ca.DM(self.radar_strengths).T
        sources = ca.mtimes(weights, _everywhere(self.source(pairs), pairs))
        return sources + zones if self.zones else sources

    def set_rates(self, positions: FloatArray, sets: BoolArray) -> FloatArray:
        """Rates (B, m, n) at positions (B, n, 2) in all sets (m, n)."""
        blocks = blocked(positions, max(1, min(len(positions), LANES)))
        return unblocked(set_rates(self, blocks, sets), len(positions)) * sets

    @override
    def with_members(self, exposures: tuple[float, ...], densities: tuple[float, ...]) -> Self:
        return self._with(Members(exposures, densities))

    @override
    def of_members(self, rows: IntArray) -> Self:
        return self if self.members is None else self._with(self.members.of(rows))

    def _with(self, members: Members | None) -> Self:
        """Copy with other members, also of a snapshot, whose radars may be off."""
        changed = copy(self)
        object.__setattr__(changed, "members", members)
        if self.template is not self:
            object.__setattr__(changed, "_template", self.template._with(members))
        return changed

    def _evaluate(self, positions: FloatArray, alive: BoolArray) -> FloatArray:
        return state_rates(self, positions, alive)

    @override
    def additional_rates(self, points: FloatArray, positions: FloatArray) -> FloatArray:
        states, hazard = with_others(points, positions), self
        if self.members is not None:
            hazard = self._with(Members(*((1.0, *each) for each in self.members)))
        return state_rates(hazard, states, np.ones(states.shape[:2], bool), 1)[:, 0]

    @override
    def single_agent_rates(self, points: ArrayLike, *, time: float | None = None) -> FloatArray:
        if self.members is None:
            return super().single_agent_rates(points, time=time)
        return self._with(None).single_agent_rates(points, time=time)


def require_finite(
    hazard: KernelHazard, positive: tuple[str, ...], not_negative: tuple[str, ...] = ()
) -> None:
    """Raise HazardError if a field is not a finite number, or not of these signs."""
    for name in positive + not_negative:
        value = getattr(hazard, name)
        finite = isinstance(value, Real) and np.isfinite(float(value))
        if not finite or value < 0 or (value == 0 and name in positive):
            allowed = "a finite number above zero" if name in positive else "zero or above, finite"
            raise HazardError(
                f"{name} = {shown(value)}; allowed: {allowed}",
                key=name,
                value=value,
                allowed=allowed,
            )


def _everywhere(kernel: Expr, pairs: Expr) -> Expr:
    """Kernel values as a matrix like `pairs`, for a kernel that is a constant too."""
    constant = getattr(kernel, "shape", ()) in ((), (1, 1))
    return ca.DM.ones(*pairs.shape) * kernel if constant else kernel


@locked_cache(maxsize=64)
def _collides(hazard: KernelHazard) -> bool:
    kernel = ca.SX(hazard.collision(ca.SX.sym("squared_distance")))
    return not kernel.is_zero()
