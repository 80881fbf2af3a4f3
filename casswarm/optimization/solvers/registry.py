"""Solvers by name."""

from __future__ import annotations

from dataclasses import fields
from typing import Any

from ..._util.text import did_you_mean
from ...errors import SolverError
from .alpaqa import Alpaqa
from .auto import Auto
from .base import Solver
from .batch.spg import SpectralProjectedGradient
from .interior_point.solver import FilterInteriorPoint
from .ipopt import Ipopt
from .pounce import Pounce
from .projected_gradient import ProjectedGradient
from .scipy import Slsqp
from .sleqp import Sleqp
from .sqp import Sqp
from .uno import Uno
from .unopy import Unopy
from .unsupported import UNSUPPORTED

SOLVERS: dict[str, type[Solver]] = {
    solver.name: solver
    for solver in (
        Auto,
        SpectralProjectedGradient,
        FilterInteriorPoint,
        Ipopt,
        Pounce,
        Sqp,
        Uno,
        Unopy,
        Sleqp,
        Alpaqa,
        Slsqp,
        ProjectedGradient,
    )
}
"""Every solver by the name that `make_solver` and the command line take."""


def make_solver(solver: str | Solver, **options: Any) -> Solver:
    """Make the solver of a name, with options; a solver is returned unchanged.

    Parameters
    ----------
    solver : str or Solver
        A solver, or a name in `casswarm.optimization.solvers.SOLVERS`, which ``casswarm solvers``
        lists.
    **options
        Fields of the solver's class.

    Raises
    ------
    SolverError
        The name or an option is unknown (the message names the closest known one), the solver is
        not supported or cannot run in this installation (the message says why), or there are
        options for a solver that is not a name.

    Examples
    --------
    >>> import casswarm as csw
    >>> csw.make_solver("sqp", tolerance=1e-9).tolerance
    1e-09
    """
    if isinstance(solver, Solver):
        if options:
            raise SolverError(f"solver options apply to names of solvers; got {solver!r}")
        return solver
    if solver in UNSUPPORTED:
        raise SolverError(
            f"solver {solver!r} is not supported: {UNSUPPORTED[solver]}", solver=solver
        )
    if solver not in SOLVERS:
        raise SolverError(
            f"solver {solver!r} is unknown{did_you_mean(solver, SOLVERS)}", solver=solver
        )
    known = [field.name for field in fields(SOLVERS[solver])]  # type: ignore[arg-type]
    for option in options:
        if option not in known:
            raise SolverError(
                f"solver {solver!r} has no option {option!r}{did_you_mean(option, known)}",
                solver=solver,
                option=option,
            )
    reason = SOLVERS[solver].unavailable()
    if reason:
        raise SolverError(f"solver {solver!r} cannot run here: {reason}", solver=solver)
    return SOLVERS[solver](**options)
