"""The answer: what a backend returned, in casswarm's words and in its own."""

from __future__ import annotations

from dataclasses import dataclass, fields
from enum import StrEnum

from .arrays import Floats


class Status(StrEnum):
    """How a solve ended. A limit is never a success."""

    SOLVED = "solved"
    ACCEPTABLE = "acceptable"
    INFEASIBLE = "infeasible"
    ITERATION_LIMIT = "iteration limit"
    TIME_LIMIT = "time limit"
    DIVERGED = "diverged"
    FAILED = "failed"

    @property
    def success(self) -> bool:
        """Whether the answer is a solution to the stated tolerance."""
        return self in (Status.SOLVED, Status.ACCEPTABLE)


@dataclass(frozen=True)
class Residuals:
    """How well an answer fulfils the optimality conditions, recomputed from the problem.

    Parameters
    ----------
    violation : float
        Largest violation of a bound or constraint.
    stationarity : float
        Largest component of the Lagrangian's gradient.
    complementarity : float
        Largest product of a multiplier and the slack of its bound.
    worst : str
        Name of the row that is violated most, empty where none is.
    """

    violation: float
    stationarity: float
    complementarity: float
    worst: str = ""


@dataclass(frozen=True)
class Solution:
    """One solve: the answer, how it ended, and how good it is.

    Parameters
    ----------
    x : (nx,)
    objective : float
    status : Status
    message : str
        The backend's own words.
    solver : str
    residuals : Residuals
    iterations, evaluations : int
        Of the backend; evaluations counts those of the objective.
    build_seconds, solve_seconds : float
        Time to compile the problem for this backend (zero when it was compiled before), and to
        solve it.
    """

    x: Floats
    objective: float
    status: Status
    message: str
    solver: str
    residuals: Residuals
    iterations: int
    evaluations: int
    build_seconds: float
    solve_seconds: float

    def __str__(self) -> str:
        r = self.residuals
        return (
            f"{self.status} by {self.solver} ({self.message}): objective {self.objective:.6g}, "
            f"violation {r.violation:.1e}, stationarity {r.stationarity:.1e}, "
            f"complementarity {r.complementarity:.1e}, {self.iterations} iterations, "
            f"{1e3 * self.solve_seconds:.1f} ms"
        )

    def as_row(self) -> dict[str, object]:
        """All but x, as plain values for a table or a JSON file."""
        row: dict[str, object] = {}
        for field in fields(self):
            value = getattr(self, field.name)
            if isinstance(value, Residuals):
                row |= {part.name: getattr(value, part.name) for part in fields(value)}
            elif field.name != "x":
                row[field.name] = str(value) if isinstance(value, Status) else value
        return row
