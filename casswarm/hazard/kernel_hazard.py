"""Rates composed of scalar kernels of squared distance.

A member's rate is combine(S, D, C) of three sums of scalar kernels::

    S = sum over radars l      strength_l source(||x_i - x_l||^2)
    D = sum over living j      density(||x_i - x_j||^2)        (j = i counts)
    C = sum over living j != i collision(||x_i - x_j||^2)

Each kernel is written once, as a CasADi expression. `KernelHazard` assembles it in matrix form for
the optimisation problems (n^2 pairs as one matrix, never an unrolled loop) and, translated to
NumPy, for batches of states.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable
from copy import copy
from dataclasses import dataclass, field, fields
from numbers import Real

import casadi as ca
import numpy as np

from .._util.numbers import CORE_RADIUS
from .._util.text import counted
from .._util.threads import locked_cache
from ..errors import HazardError
from ..typing import BoolArray, Expr, FloatArray
from .base import Hazard, checked_radars
from .codegen import differentiated_source, lower, lower_derivatives

_CHUNK_PAIRS = 1 << 19  # pairs evaluated at once: a few arrays of 4 MiB
_KERNELS = {"source": 1, "density": 1, "collision": 1, "combine": 3}
"""The kernels of a hazard, and their numbers of arguments."""


def regular(squared_distance: Expr, core_radius: Expr = CORE_RADIUS) -> Expr:
    """Squared distance, kept above zero so that its inverse is finite.

    With e = `core_radius` it is exactly the argument s from e^2 on; below, it is
    (e^2 + s^2 / e^2) / 2, which has the same value and slope at e^2 and is at least e^2 / 2.
    """
    core = core_radius**2
    missing = core - ca.fmin(squared_distance, core)
    return squared_distance + missing**2 / (2 * core)


@dataclass(frozen=True)
class KernelHazard(Hazard):
    """Base of the hazards that are composed of kernels.

    Kernels must be finite at zero distance, where `regular(squared_distance, self.core_radius)`
    helps: every member is paired with itself, and the pair is masked where it does not count.

    Parameters
    ----------
    radars : k pairs (x, y)
        Positions of the sources of the hazard; at least one.
    strengths : k positive floats, optional
        Factor of every radar; 1 by default.
    core_radius : float, keyword only
        Distance below which kernels are regularised, in units of length; 0.01 by default. That of
        a scenario is ``hazard.core_radius``.
    """

    radars: tuple[tuple[float, float], ...]
    strengths: tuple[float, ...] | None = None
    core_radius: float = field(default=CORE_RADIUS, kw_only=True)

    def __post_init__(self) -> None:
        object.__setattr__(self, "radars", checked_radars(self.radars))
        if not self.radars:
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

    @property
    def radar_positions(self) -> FloatArray:
        """Positions of the radars, shape (k, 2)."""
        return np.array(self.radars, dtype=float)

    @property
    def collides(self) -> bool:
        """Whether members endanger each other, which makes formation problems multimodal."""
        return _collides(self)

    @property
    def gathers(self) -> bool:
        """Whether a member's rate increases with every distance to another."""
        return False

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
        density = ca.mtimes(sets, _everywhere(self.density(pairs), pairs))
        collision = ca.mtimes(sets, self.collision(pairs) * others)
        sources = self._sources(positions)
        return self.combine(
            sources if count == 1 else ca.repmat(sources, count, 1), density, collision
        )

    def single_agent_expression(self, points: Expr) -> Expr:
        """Rate of a single member at each of m points: (2, m) to (1, m)."""
        return self.combine(self._sources(points), self.density(0.0), 0.0)

    def _sources(self, points: Expr) -> Expr:
        radars = self.radar_positions
        column = ca.DM.ones(len(radars), 1)
        pairs = sum(
            (ca.mtimes(column, points[axis, :]) - ca.repmat(radars[:, axis], 1, points.shape[1]))
            ** 2
            for axis in (0, 1)
        )
        return ca.mtimes(ca.DM(self.radar_strengths).T, _everywhere(self.source(pairs), pairs))

    def _evaluate(self, positions: FloatArray, alive: BoolArray) -> FloatArray:
        n = positions.shape[1]
        size = max(1, _CHUNK_PAIRS // (n * max(n, len(self.radars))))
        starts = range(size, len(positions), size)
        chunks = zip(np.split(positions, starts), np.split(alive, starts), strict=True)
        rates = [np.broadcast_to(self._evaluate_chunk(x, a), a.shape) for x, a in chunks]
        return np.concatenate(rates)

    def _evaluate_chunk(self, positions: FloatArray, alive: BoolArray) -> FloatArray:
        source, density, collision, combine = lowered_kernels(self)
        living = alive[:, None, :]
        others = living & ~np.eye(positions.shape[1], dtype=bool)
        with np.errstate(all="ignore"):  # `rates` refuses values that are not finite
            to_radars = _squared_distances(positions, self.radar_positions[None])
            pairs = _squared_distances(positions, positions)
            return combine(
                np.sum(source(to_radars) * self.radar_strengths, axis=-1),
                np.sum(density(pairs) * living, axis=-1),
                np.sum(collision(pairs) * others, axis=-1),
            )


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
                f"{name} = {value!r}; allowed: {allowed}", key=name, value=value, allowed=allowed
            )


def _everywhere(kernel: Expr, pairs: Expr) -> Expr:
    """Kernel values as a matrix like `pairs`, for a kernel that is a constant too."""
    constant = getattr(kernel, "shape", ()) in ((), (1, 1))
    return ca.DM.ones(*pairs.shape) * kernel if constant else kernel


def _squared_distances(a: FloatArray, b: FloatArray) -> FloatArray:
    """Squared distances (B, n, m) between (B, n, 2) and (B or 1, m, 2)."""
    east = a[:, :, None, 0] - b[:, None, :, 0]
    north = a[:, :, None, 1] - b[:, None, :, 1]
    return east * east + north * north


@locked_cache(maxsize=64)
def _collides(hazard: KernelHazard) -> bool:
    kernel = ca.SX(hazard.collision(ca.SX.sym("squared_distance")))
    return not kernel.is_zero()


@locked_cache(maxsize=64)
def lowered_kernels(hazard: KernelHazard) -> tuple[Callable[..., FloatArray], ...]:
    """NumPy functions of the four expressions: source, density, collision, combine."""
    return tuple(lower(getattr(hazard, name), inputs, name) for name, inputs in _KERNELS.items())


@locked_cache(maxsize=64)
def lowered_derivatives(hazard: KernelHazard) -> tuple[Callable[..., tuple[FloatArray, ...]], ...]:
    """NumPy functions of the four expressions with their first and second derivatives."""
    return tuple(
        lower_derivatives(getattr(hazard, name), inputs, name) for name, inputs in _KERNELS.items()
    )


@locked_cache(maxsize=64)
def differentiated_kernels(hazard: KernelHazard) -> tuple[str, tuple[float, ...]]:
    """Python source of the kernels with their derivatives, and the parameters that it reads.

    ``density(x0, parameters)`` returns value and derivative, ``second_density`` the second
    derivative too, and so on; where there are several arguments, the upper triangle by rows.

    The numerical fields of the hazard are parameters of the source, so that all hazards of a class
    share compiled code.
    """
    names = [f.name for f in fields(hazard) if isinstance(getattr(hazard, f.name), (int, float))]
    parameters = ca.SX.sym("parameters", max(2, len(names)))  # never a scalar: it is indexed
    symbolic = copy(hazard)
    for index, name in enumerate(names):
        object.__setattr__(symbolic, name, parameters[index])
    try:
        source = _kernel_sources(symbolic, parameters)
    except HazardError:
        raise
    except Exception:  # a kernel that branches on its numbers
        return _kernel_sources(hazard, parameters), ()
    return source, tuple(float(getattr(hazard, name)) for name in names)


def _kernel_sources(hazard: KernelHazard, parameters: Expr) -> str:
    sources = (
        differentiated_source(getattr(hazard, name), inputs, f"{prefix}{name}", parameters, order)
        for name, inputs in _KERNELS.items()
        for prefix, order in (("", 1), ("second_", 2))
    )
    return "\n\n".join(sources)
