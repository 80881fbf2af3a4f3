"""The guide trajectory that planning returns, with the outcome of every start."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from .._util.display import Displayed
from .._util.numbers import rounded_up
from ..hazard import Hazard, mean_rates_along
from ..motion.kinematics import integrate
from ..nlp.solution import Solution, Status
from ..problems.guide import GuideTask
from ..typing import FloatArray, Search

if TYPE_CHECKING:
    from ..bounds.risk_bound import Certificate


@dataclass(frozen=True, eq=False)
class Candidate:
    """The outcome of one start of the guide problem.

    Parameters
    ----------
    start : str
        Name of the initial path.
    arrival : int
        The prescribed arrival step.
    homotopy : str
        Homotopy signature of the path: for every radar, in the scenario's order, L if the path has
        it on its left and R if on its right.
    velocities : (T, 2)
        Up to the first arrival, at or before the prescribed step; all of them without arrival.
    risk : float
        Sum of dt times the rates up to the first arrival; infinite for a path that does not
        arrive, or only by violating its limits.
    solution : Solution
    """

    start: str
    arrival: int
    homotopy: str
    velocities: FloatArray
    risk: float
    solution: Solution

    def as_row(self) -> dict[str, object]:
        """Scalar values, as a table row."""
        return {
            "start": self.start,
            "arrival": self.arrival,
            "steps": len(self.velocities),
            "homotopy": self.homotopy,
            "risk": self.risk,
            "survival": float(np.exp(-self.risk)),
        } | self.solution.as_row()


@dataclass(frozen=True, eq=False, repr=False)
class Guide(Displayed):
    """A single agent's trajectory to the target, and its risk.

    Parameters
    ----------
    positions : (T+1, 2)
        X(0..T); T is the first step in the target.
    velocities : (T, 2)
        V(0..T-1).
    rates : (T,)
        lambda-bar(X(1..T)) per unit time; means over the parts of every step, if it has several.
    dt : float
    center : (2,)
        The target's centre, which the swarm aims at after step T.
    arrives : bool
        Whether X(T) is in the target. False only for a failed plan returned with ``check=False``.
    solution : Solution
        The solve that this guide results from.
    candidates : tuple of Candidate
        The outcome of every start, failures included, in the order of the search.
    risk_bound : float or None
        Proven lower bound on the risk of any guide of the scenario; None if not certified. If the
        limits of acceleration matter, a guide is a path that obeys them and ends as deep in the
        target as planned; otherwise, any path that obeys the speed limit and arrives.
    certificate : Certificate or None
        Details of the proof.
    search : {"local", "global"}
        Search that produced the guide; the naive policy plans its members' guides with the same.
    note : str
        Why the search ended early, or why no solve succeeded; empty otherwise.
    """

    positions: FloatArray
    velocities: FloatArray
    rates: FloatArray
    dt: float
    center: FloatArray
    arrives: bool
    solution: Solution
    candidates: tuple[Candidate, ...] = ()
    risk_bound: float | None = None
    certificate: Certificate | None = None
    search: Search = "local"
    note: str = ""

    @classmethod
    def from_candidate(
        cls,
        hazard: Hazard,
        task: GuideTask,
        best: Candidate,
        candidates: tuple[Candidate, ...] = (),
        search: Search = "local",
        substeps: int = 1,
    ) -> Guide:
        """The guide along the path of the candidate `best`; ``hazard.after`` counts substeps."""
        positions = integrate(task.start, best.velocities, task.dt)
        return cls(
            positions=positions,
            velocities=best.velocities,
            rates=mean_rates_along(hazard, positions, substeps),
            dt=task.dt,
            center=task.center,
            arrives=bool(np.isfinite(best.risk)),
            solution=best.solution,
            candidates=candidates,
            search=search,
        )

    @property
    def arrival(self) -> int:
        """T, the arrival step."""
        return len(self.velocities)

    @property
    def risk(self) -> float:
        """Sum over t = 1..T of dt lambda-bar(X(t))."""
        return float(self.dt * self.rates.sum())

    @property
    def failed(self) -> bool:
        """True if no solve succeeded or ended at a limit: the path is no minimum of the risk."""
        return self.solution.status in (Status.FAILED, Status.INFEASIBLE, Status.DIVERGED)

    @property
    def survival(self) -> float:
        """exp(-risk): the probability that a single agent along the guide arrives."""
        return float(np.exp(-self.risk))

    @property
    def gap(self) -> float | None:
        """Relative optimality gap (risk - bound) / risk; None if not certified."""
        if self.risk_bound is None:
            return None
        return (self.risk - self.risk_bound) / self.risk if self.risk > 0 else 0.0

    @property
    def survival_bound(self) -> float | None:
        """exp(-bound), which no guide's survival exceeds; None if not certified."""
        return None if self.risk_bound is None else float(np.exp(-self.risk_bound))

    def reference(self, step: int) -> FloatArray:
        """Reference point (2,) at `step`: X(step), or the target's centre after arrival.

        Planned positions beyond the first arrival are not used: they may leave the target again.
        """
        return np.asarray(self.positions[step] if step <= self.arrival else self.center)

    def best_per_homotopy_class(self) -> list[Candidate]:
        """The arriving candidate of least risk in every homotopy class, in order of risk."""
        best: dict[str, Candidate] = {}
        for candidate in sorted(self.candidates, key=lambda c: c.risk):
            if np.isfinite(candidate.risk):
                best.setdefault(candidate.homotopy, candidate)
        return list(best.values())

    def best_paths(self) -> dict[str, FloatArray]:
        """Positions X(0..T), (T+1, 2), of the best path of every homotopy class, in order of risk.

        Their names are homotopy signatures with the rank, such as ``"LR 0"``, or ``"path 0"`` in a
        scenario without radars.
        """
        return {
            f"{best.homotopy or 'path'} {rank}": integrate(
                self.positions[0], best.velocities, self.dt
            )
            for rank, best in enumerate(self.best_per_homotopy_class())
        }

    @property
    def outcomes(self) -> dict[str, int]:
        """Number of starts by status of their solve, in the order of the search."""
        return dict(Counter(str(candidate.solution.status) for candidate in self.candidates))

    def as_dict(self) -> dict[str, Any]:
        """Values by name, with those of the certificate and of every start, for a JSON file."""
        return {
            "risk": self.risk,
            "survival": self.survival,
            "risk_bound": self.risk_bound,
            "gap": self.gap,
            "certificate": None if self.certificate is None else self.certificate.as_dict(),
            "arrival_step": self.arrival,
            "arrives": self.arrives,
            "note": self.note,
            "solution": self.solution.as_row(),
            "candidates": [candidate.as_row() for candidate in self.candidates],
            "positions": self.positions,
            "velocities": self.velocities,
        }

    def __repr__(self) -> str:
        bound = self.survival_bound
        certified = "" if bound is None else f", survival_bound={rounded_up(bound):.4f}"
        return (
            f"Guide(arrives={self.arrives}, arrival={self.arrival}, "
            f"survival={self.survival:.4f}{certified})"
        )

    def __str__(self) -> str:
        bound = self.survival_bound
        certified = (
            "not certified" if bound is None else f"no guide can exceed {rounded_up(bound):.4f}"
        )
        end = "arrives" if self.arrives else "DOES NOT ARRIVE"
        note = f"; {self.note}" if self.note else ""
        text = f"guide {end} at step {self.arrival}: survival {self.survival:.4f}"
        return f"{text} ({certified}{note})"
