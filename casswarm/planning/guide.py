"""The guide that planning returns, with every start that was tried."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from ..hazard import Hazard
from ..optimization.solution import Solution
from ..typing import FloatArray

if TYPE_CHECKING:
    from .bounds.risk_bound import Certificate


@dataclass(frozen=True, eq=False)
class Candidate:
    """The outcome of one start of the guide problem.

    Parameters
    ----------
    start : str
        Name of the initial path.
    arrival : int
        The arrival step that was asked for.
    sides : str
        On which side the path passes every radar, a letter each in the scenario's order: L for a
        radar on the left of the path, R for one on the right.
    velocities : (T, 2)
        Up to the first arrival, at or before the step asked for; all of them if it never arrives.
    risk : float
        Sum of dt times the rates up to the first arrival; infinite if it never arrives, or only by
        violating its limits.
    solution : Solution
    """

    start: str
    arrival: int
    sides: str
    velocities: FloatArray
    risk: float
    solution: Solution

    def as_row(self) -> dict[str, object]:
        """Plain values for a table."""
        solution = self.solution.as_row()
        return {
            "start": self.start,
            "arrival": self.arrival,
            "steps": len(self.velocities),
            "sides": self.sides,
            "risk": self.risk,
            "survival": float(np.exp(-self.risk)),
        } | solution


@dataclass(frozen=True, eq=False)
class Guide:
    """A path of a lone agent to the target, and what it costs.

    Parameters
    ----------
    positions : (T+1, 2)
        X(0..T); T is the first step in the target.
    velocities : (T, 2)
        V(0..T-1).
    rates : (T,)
        lambda-bar(X(1..T)) per unit time.
    dt : float
    center : (2,)
        The target's centre, at which the swarm aims after step T.
    arrives : bool
        Whether X(T) is in the target. Only a failed plan, kept with ``check=False``, does not.
    solution : Solution
        Of the start that this guide came from.
    candidates : tuple of Candidate
        Every start's outcome, failures included, in the order in which they were tried.
    risk_bound : float or None
        Proven lower bound on the risk of any guide of the scenario; None where not certified.
    certificate : Certificate or None
        The proof of the bound: how it was reached, and what is known beside it.
    search : {"local", "global"}
        How it was found; the members' own guides of the naive policy are found likewise.
    """

    positions: FloatArray
    velocities: FloatArray
    rates: FloatArray
    dt: float
    center: FloatArray
    arrives: bool
    solution: Solution
    candidates: tuple[Candidate, ...] = field(default=(), repr=False)
    risk_bound: float | None = None
    certificate: Certificate | None = field(default=None, repr=False)
    search: str = "local"

    @property
    def arrival(self) -> int:
        """T, the arrival step."""
        return len(self.velocities)

    @property
    def risk(self) -> float:
        """Sum over t = 1..T of dt lambda-bar(X(t))."""
        return float(self.dt * self.rates.sum())

    @property
    def survival(self) -> float:
        """exp(-risk): the probability that one member along the guide arrives."""
        return float(np.exp(-self.risk))

    @property
    def gap(self) -> float | None:
        """(risk - bound) / risk; None where not certified."""
        if self.risk_bound is None:
            return None
        return (self.risk - self.risk_bound) / self.risk if self.risk > 0 else 0.0

    @property
    def survival_bound(self) -> float | None:
        """exp(-bound): no guide of the scenario survives with more; None where not certified."""
        return None if self.risk_bound is None else float(np.exp(-self.risk_bound))

    def reference(self, step: int) -> FloatArray:
        """Where the guide is at `step`, (2,): X(step), and the target's centre after arrival.

        What was planned beyond the first arrival is left out: it may lead out of the target again.
        """
        return np.asarray(self.positions[step] if step <= self.arrival else self.center)

    def ways(self) -> list[Candidate]:
        """The best arriving candidate of every way around the radars, best first."""
        best: dict[str, Candidate] = {}
        for candidate in sorted(self.candidates, key=lambda c: c.risk):
            if np.isfinite(candidate.risk):
                best.setdefault(candidate.sides, candidate)
        return list(best.values())

    def __str__(self) -> str:
        certified = (
            "not certified"
            if self.survival_bound is None
            else f"no guide can exceed {rounded_up(self.survival_bound):.4f}"
        )
        end = "arrives" if self.arrives else "DOES NOT ARRIVE"
        return f"guide {end} at step {self.arrival}: survival {self.survival:.4f} ({certified})"


def rounded_up(value: float, digits: int = 4) -> float:
    """A bound as it is told: rounded, it must not be below itself."""
    scale: float = 10.0**digits
    return math.ceil(value * scale) / scale


def integrate(start: FloatArray, velocities: FloatArray, dt: float) -> FloatArray:
    """Positions X(0..T), (T+1, 2): the dynamics X(t+1) = X(t) + dt V(t) to the letter."""
    positions = np.empty((len(velocities) + 1, 2))
    positions[0] = start
    for step, velocity in enumerate(velocities):  # in the order, so with the rounding, of the chain
        positions[step + 1] = positions[step] + dt * velocity
    return positions


def guide_from(
    hazard: Hazard,
    start: FloatArray,
    best: Candidate,
    candidates: tuple[Candidate, ...],
    dt: float,
    center: FloatArray,
    search: str,
) -> Guide:
    """The guide of the best candidate, priced."""
    positions = integrate(start, best.velocities, dt)
    return Guide(
        positions=positions,
        velocities=best.velocities,
        rates=hazard.single_agent_rates(positions[1:]),
        dt=dt,
        center=center,
        arrives=bool(np.isfinite(best.risk)),
        solution=best.solution,
        candidates=candidates,
        search=search,
    )


def homotopy_signature(positions: FloatArray, radars: FloatArray) -> str:
    """On which side a path passes every radar: L if the radar is on its left, R on its right.

    The side is that of the winding angle: the sign of the angle that the path sweeps as seen from
    the radar, so that a path around a radar is told from one that passes before it.

    Parameters
    ----------
    positions : (T+1, 2)
    radars : (k, 2)
    """
    offset = positions[None] - radars[:, None]
    angle = np.unwrap(np.arctan2(offset[..., 1], offset[..., 0]), axis=1)
    swept = angle[:, -1] - angle[:, 0] if len(radars) else np.empty(0)
    return "".join("L" if turn > 0 else "R" for turn in swept)
