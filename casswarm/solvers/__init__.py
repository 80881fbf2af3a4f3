"""Solvers: one algorithm a file, all behind one verb."""

from __future__ import annotations

from dataclasses import fields
from typing import Any

from ..errors import SolverError, among
from .auto import Auto
from .base import Answer, Solver
from .ipopt import Ipopt
from .isolated import Isolated
from .projected_gradient import ProjectedGradient
from .spectral import SpectralProjectedGradient

SOLVERS: dict[str, type[Solver]] = {
    solver.name: solver for solver in (Auto, SpectralProjectedGradient, Ipopt, ProjectedGradient)
}
"""Every solver by the name that `make_solver` and the command line take."""


def make_solver(solver: str | Solver, **options: Any) -> Solver:
    """Solver of a name, with options; a solver is returned as it is.

    Raises
    ------
    SolverError
        An unknown name or option; the message names the nearest known one.
    """
    if isinstance(solver, Solver):
        return solver
    if solver not in SOLVERS:
        raise SolverError(f"solver {solver!r} is unknown{among(solver, SOLVERS)}")
    known = [field.name for field in fields(SOLVERS[solver])]  # type: ignore[arg-type]
    for option in options:
        if option not in known:
            raise SolverError(f"solver {solver!r} has no option {option!r}{among(option, known)}")
    return SOLVERS[solver](**options)


__all__ = [
    "SOLVERS",
    "Answer",
    "Auto",
    "Ipopt",
    "Isolated",
    "ProjectedGradient",
    "Solver",
    "SpectralProjectedGradient",
    "make_solver",
]
