"""Solutions: the answers of solvers, with verified status and residuals."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields
from enum import StrEnum
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .._util.text import counted
from ..errors import SolverError
from ..typing import BoolArray, FloatArray, IntArray


class Status(StrEnum):
    """Outcome of a solve. Reaching a limit is never a success."""

    SOLVED = "solved"
    ACCEPTABLE = "acceptable"
    INFEASIBLE = "infeasible"
    ITERATION_LIMIT = "iteration limit"
    TIME_LIMIT = "time limit"
    DIVERGED = "diverged"
    FAILED = "failed"

    @property
    def success(self) -> bool:
        """True if the answer is a solution to the solver's tolerance."""
        return self in (Status.SOLVED, Status.ACCEPTABLE)


@dataclass(frozen=True)
class Residuals:
    """Residuals of the optimality conditions, recomputed from the problem.

    Parameters
    ----------
    violation : float
        Largest violation of a bound or constraint.
    stationarity : float
        Largest component of the Lagrangian's gradient.
    complementarity : float
        Largest product of a multiplier and the slack of its bound.
    violated_row : str
        Name of the row that is violated most; empty if none is.
    """

    violation: float
    stationarity: float
    complementarity: float
    violated_row: str = ""


@dataclass(frozen=True, eq=False)
class Solution:
    """Result of one solve.

    Parameters
    ----------
    x : (nx,)
    objective : float
    status : Status
    message : str
        The backend's own message.
    solver : str
    residuals : Residuals
    iterations, evaluations : int
        As the backend counts them; evaluations are those of the objective.
    build_seconds, solve_seconds : float
        Time to compile the problem for this backend (zero if it was compiled before), and to solve
        it.
    """

    x: FloatArray
    objective: float
    status: Status
    message: str
    solver: str
    residuals: Residuals
    iterations: int
    evaluations: int
    build_seconds: float
    solve_seconds: float

    def __repr__(self) -> str:
        r = self.residuals
        return (
            f"Solution({str(self.status)!r}, solver={self.solver!r}, objective="
            f"{self.objective:.6g}, violation={r.violation:.1e}, stationarity="
            f"{r.stationarity:.1e}, x of shape {self.x.shape})"
        )

    def __str__(self) -> str:
        r = self.residuals
        return (
            f"{self.status} by {self.solver} ({self.message}): objective {self.objective:.6g}, "
            f"violation {r.violation:.1e}, stationarity {r.stationarity:.1e}, "
            f"complementarity {r.complementarity:.1e}, {counted(self.iterations, 'iteration')}, "
            f"{1e3 * self.solve_seconds:.1f} ms"
        )

    def as_row(self) -> dict[str, object]:
        """All fields but x, as plain values for a table or a JSON file."""
        row: dict[str, object] = {}
        for field in fields(self):
            value = getattr(self, field.name)
            if isinstance(value, Residuals):
                row |= {part.name: getattr(value, part.name) for part in fields(value)}
            elif field.name != "x":
                row[field.name] = str(value) if isinstance(value, Status) else value
        return row


@dataclass(frozen=True, eq=False)
class Sensitivities:
    """Derivatives of B solutions by the parameters p of their program.

    Parameters
    ----------
    value_gradient : (B, np)
        Of the optimal values; NaN without a solution.
    weakly_active : (B, nx + ng) bool
        Rows whose multiplier and slack are both near zero: the solution may have derivatives by
        directions only, and `dx_dp` is that of one of the possible sets of active rows.
    regular : (B,) bool
        Whether there is a solution at which the gradients of active rows are linearly independent,
        and the second-order sufficient condition holds. Above 1500 variables and active
        rows together, the factor of the condensed matrix alone decides.
    forward : callable
        Computes `dx_dp` and `dlam_dp`, when one of them is first read.
    adjoint : callable
        bar_x (B, nx), and optionally bar_lam (B, nx + ng), to their products (B, np) with
        dx_dp and dlam_dp, by a single solve for each instance.
    """

    value_gradient: FloatArray
    weakly_active: BoolArray
    regular: BoolArray
    forward: Callable[[], tuple[FloatArray, FloatArray]]
    adjoint: Callable[..., FloatArray]

    @property
    def dx_dp(self) -> FloatArray:
        """Derivatives of the solutions (B, nx, np); NaN where `regular` is False."""
        return self._both[0]

    @property
    def dlam_dp(self) -> FloatArray:
        """Derivatives of the multipliers (B, nx + ng, np) of the bounds on x, then of g.

        Zero where these are not active, and NaN where `regular` is False.
        """
        return self._both[1]

    @cached_property
    def _both(self) -> tuple[FloatArray, FloatArray]:
        return self.forward()

    def __repr__(self) -> str:
        weak = int(self.weakly_active.any(axis=1).sum())
        return (
            f"Sensitivities({int(self.regular.sum())} of {len(self.regular)} regular, "
            f"{weak} with weakly active rows, {self.value_gradient.shape[1]} parameters)"
        )


@dataclass(frozen=True, eq=False)
class BatchSolution:
    """Results of B instances, as arrays.

    Parameters
    ----------
    x : (B, nx)
    objective : (B,)
    success : (B,) bool
        Whether an answer is a solution to the solver's tolerance.
    violation, stationarity : (B,)
        Residuals, recomputed from the problem; stationarity in `Instances.scale`.
    used_fallback : (B,) bool
        Whether the batch solver's answer was rejected and another solver was called.
    seconds : float
        Time for the whole batch.
    messages : (B,) str
        Status and message of every solve; empty for those of compiled batch solvers.
    lam_x : (B, nx)
        Multipliers of the bounds on x, positive at an upper bound, as CasADi's. NaN where the
        solver has none, as those of compiled batch solvers.
    lam_g : (B, ng)
        Likewise of g.
    iterations : (B,) int
        As the solver counts them.
    sensitivities : Sensitivities, optional
        Derivatives by the parameters, where they are asked for.
    """

    x: FloatArray
    objective: FloatArray
    success: BoolArray
    violation: FloatArray
    stationarity: FloatArray
    used_fallback: BoolArray
    seconds: float
    messages: NDArray[np.object_]
    lam_x: FloatArray
    lam_g: FloatArray
    iterations: IntArray
    sensitivities: Sensitivities | None = None

    @property
    def dx_dp(self) -> FloatArray:
        """`Sensitivities.dx_dp`, (B, nx, np); SolverError if they were not asked for."""
        return self._derivatives.dx_dp

    @property
    def dlam_dp(self) -> FloatArray:
        """`Sensitivities.dlam_dp`, (B, nx + ng, np); SolverError if they were not asked for."""
        return self._derivatives.dlam_dp

    @property
    def value_gradient(self) -> FloatArray:
        """`Sensitivities.value_gradient`, (B, np); SolverError if they were not asked for."""
        return self._derivatives.value_gradient

    @property
    def weakly_active(self) -> BoolArray:
        """`Sensitivities.weakly_active`, (B, nx + ng); SolverError if they were not asked for."""
        return self._derivatives.weakly_active

    @property
    def _derivatives(self) -> Sensitivities:
        if self.sensitivities is None:
            raise SolverError(
                "this batch has no derivatives by its parameters: solve it with "
                "solve_batch(..., sensitivities=True)"
            )
        return self.sensitivities

    def __repr__(self) -> str:
        largest = self.violation.max(initial=0.0), self.stationarity[self.success].max(initial=0.0)
        return (
            f"BatchSolution({int(self.success.sum())} of {len(self.x)} solved, "
            f"{int(self.used_fallback.sum())} by the fallback, violation<={largest[0]:.1e}, "
            f"stationarity of the solved<={largest[1]:.1e}, "
            f"iterations<={self.iterations.max(initial=0)}, x of shape {self.x.shape}, "
            f"seconds={self.seconds:.3g})"
        )

    @classmethod
    def from_solutions(
        cls,
        solutions: Sequence[Solution],
        scale: FloatArray,
        multipliers: tuple[FloatArray, FloatArray] | None = None,
    ) -> BatchSolution:
        """Batch of single solutions; `scale` (B, 2) is that of x and f.

        Without `multipliers`, (B, nx) and (B, ng), those of the bounds are NaN, and g has none.
        """
        factor = scale[:, 0] / scale[:, 1]
        x = np.array([s.x for s in solutions])
        if multipliers is None:
            multipliers = np.full_like(x, np.nan), np.empty((len(x), 0))
        lam_x, lam_g = multipliers
        return cls(
            x=x.reshape(lam_x.shape),
            objective=np.array([s.objective for s in solutions]),
            success=np.array([s.status.success for s in solutions], dtype=bool),
            violation=np.array([s.residuals.violation for s in solutions]),
            stationarity=factor * np.array([s.residuals.stationarity for s in solutions]),
            used_fallback=np.zeros(len(solutions), bool),
            seconds=sum(s.solve_seconds for s in solutions),
            messages=np.array([f"{s.status}: {s.message}" for s in solutions], dtype=object),
            lam_x=lam_x,
            lam_g=lam_g,
            iterations=np.array([s.iterations for s in solutions], dtype=np.int64),
        )

    def with_rows(self, rows: IntArray, other: BatchSolution) -> BatchSolution:
        """These results, with those of `other` in the given rows, without sensitivities."""
        merged: dict[str, Any] = {"seconds": self.seconds + other.seconds}
        for part in fields(self):
            if part.name not in ("seconds", "sensitivities"):
                merged[part.name] = getattr(self, part.name).copy()
                merged[part.name][rows] = getattr(other, part.name)
        return BatchSolution(**merged)
