"""Solvers: one algorithm a file, all behind one verb."""

from __future__ import annotations

from dataclasses import fields
from typing import Any

from ..._util.text import did_you_mean
from ...errors import SolverError
from .alpaqa import Alpaqa
from .auto import Auto
from .base import Answer, Capabilities, Solver
from .batch.interior_point import InteriorPoint
from .batch.spg import SpectralProjectedGradient
from .ipopt import Ipopt
from .isolated import Isolated
from .projected_gradient import ProjectedGradient
from .scipy import Slsqp
from .sleqp import Sleqp
from .sqp import Sqp
from .uno import Uno
from .unsupported import UNSUPPORTED

SOLVERS: dict[str, type[Solver]] = {
    solver.name: solver
    for solver in (
        Auto,
        SpectralProjectedGradient,
        Ipopt,
        Sqp,
        Uno,
        Sleqp,
        Alpaqa,
        Slsqp,
        ProjectedGradient,
    )
}
"""Every solver by the name that `make_solver` and the command line take."""


def make_solver(solver: str | Solver, **options: Any) -> Solver:
    """Solver of a name, with options; a solver is returned as it is.

    Parameters
    ----------
    solver : str or Solver
        A name of `casswarm.optimization.solvers.SOLVERS`, which ``casswarm solvers`` lists.
    **options
        Fields of the solver's class.

    Raises
    ------
    SolverError
        An unknown name or option; the message names the nearest known one. A solver that is left
        out, or cannot run in this installation; the message says why.

    Examples
    --------
    >>> import casswarm as csw
    >>> csw.make_solver("sqp", tolerance=1e-9).tolerance
    1e-09
    """
    if isinstance(solver, Solver):
        return solver
    if solver in UNSUPPORTED:
        raise SolverError(f"solver {solver!r} is left out: {UNSUPPORTED[solver]}")
    if solver not in SOLVERS:
        raise SolverError(f"solver {solver!r} is unknown{did_you_mean(solver, SOLVERS)}")
    known = [field.name for field in fields(SOLVERS[solver])]  # type: ignore[arg-type]
    for option in options:
        if option not in known:
            raise SolverError(
                f"solver {solver!r} has no option {option!r}{did_you_mean(option, known)}"
            )
    reason = SOLVERS[solver].unavailable()
    if reason:
        raise SolverError(f"solver {solver!r} cannot run here: {reason}")
    return SOLVERS[solver](**options)


__all__ = [
    "SOLVERS",
    "UNSUPPORTED",
    "Alpaqa",
    "Answer",
    "Auto",
    "Capabilities",
    "InteriorPoint",
    "Ipopt",
    "Isolated",
    "ProjectedGradient",
    "Sleqp",
    "Slsqp",
    "Solver",
    "SpectralProjectedGradient",
    "Sqp",
    "Uno",
    "make_solver",
]
