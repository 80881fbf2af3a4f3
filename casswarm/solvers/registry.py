"""Solvers by name: those of this room, and those that others register.

A solver is registered by the name of its class and imported when it is first used, so that a room
above this one, or a package outside casswarm, can add solvers that this room does not know.
"""

from __future__ import annotations

from dataclasses import fields
from typing import TYPE_CHECKING, Any

from .._util.registry import Registry
from .._util.text import did_you_mean
from ..errors import SolverError

if TYPE_CHECKING:
    from .base import Solver

NOT_SHIPPED = "CasADi's wheel contains only the interface, not the library"

UNSUPPORTED: dict[str, str] = {
    "fatrop": (
        "converges on 38 of 43 trial problems, but never returns if the objective becomes NaN "
        "at an iterate, and neither a time limit nor Ctrl-C stops it (casadi 3.8.2)"
    ),
    "trust-constr": (
        "reports success while its barrier parameter is still large: the objective is off by 1e-6 "
        "to 1e-3 on 20 of 43 trial problems (scipy 1.17.1)"
    ),
    "blocksqp": (
        "correct on 34 of 43 trial problems, but not on the guide; its restoration phase needs "
        "HSL's MA27, and it reports no status (casadi 3.8.2)"
    ),
    "feasiblesqpmethod": (
        "correct on 14 of 43 trial problems: it raises on formations and refuses infeasible starts "
        "(casadi 3.8.2)"
    ),
    "qrsqp": "correct on 22 of 43 trial problems, raises on 15 (casadi 3.8.2)",
    "scpgen": "correct on 17 of 43 trial problems, raises on 21 (casadi 3.8.2)",
    "bonmin": "for integer variables; without any it calls Ipopt, and reports no multipliers",
    "jaxipm": "needs Python 3.12 and jax for CUDA 13, hence a graphics processor (jaxipm 0.0.1)",
    "cyipopt": (
        "the same solver as ipopt, with MUMPS, called from Python: correct on the same 42 of 43 "
        "trial problems, in four times the time (cyipopt-wheels 1.7.0.dev0)"
    ),
    "ampl": "writes a file for an executable that is not shipped",
    **dict.fromkeys(("worhp", "snopt", "knitro", "conopt", "madnlp", "ccopt"), NOT_SHIPPED),
}
"""Reason by name. The trial problems are 38 of Hock and Schittkowski, four formations of five
members and the guide of paper-1; correct is the published (or Ipopt's) objective to 1e-6."""


_OWN = {
    "interior-point": "interior_point.solver:FilterInteriorPoint",
    "ipopt": "casadi_plugins:Ipopt",
    "pounce": "external:Pounce",
    "sqp": "casadi_plugins:Sqp",
    "uno": "casadi_plugins:Uno",
    "unopy": "external:Unopy",
    "sleqp": "casadi_plugins:Sleqp",
    "alpaqa": "casadi_plugins:Alpaqa",
    "slsqp": "scipy:Slsqp",
}
SOLVERS: Registry[type[Solver]] = Registry(
    "solver",
    lambda message, name: SolverError(message, solver=name),
    **{name: f"{__package__}.{target}" for name, target in _OWN.items()},
)
"""Every solver by the name that `make_solver` and the command line take."""


def register_solver(name: str, target: str, *, before: str | None = None) -> None:
    """Add a solver to `SOLVERS`.

    Parameters
    ----------
    name : str
        The class's `Solver.name`.
    target : str
        ``"module:Class"``, which is imported when the solver is first used.
    before : str, optional
        The solver that it is listed before; by default it is the last.

    Raises
    ------
    SolverError
        Another class has this name.

    Examples
    --------
    >>> import casswarm as csw
    >>> csw.solvers.register_solver("ipopt", "casswarm.solvers.casadi_plugins:Ipopt")
    """
    SOLVERS.add(name, target, before)


def registered_class(kind: str) -> type[Solver]:
    """The registered solver whose class has this name.

    Raises
    ------
    AttributeError
        There is none.
    """
    for name, target in SOLVERS.targets.items():
        if target.endswith(f":{kind}"):
            return SOLVERS[name]
    raise AttributeError(f"no solver of the class {kind!r} is registered")


def make_solver(solver: str | Solver, **options: Any) -> Solver:
    """Make the solver of a name, with options; a solver is returned unchanged.

    Parameters
    ----------
    solver : str or Solver
        A solver, or a name in `casswarm.solvers.SOLVERS`, which ``casswarm solvers``
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
    from .base import Solver  # with NumPy and CasADi

    if isinstance(solver, Solver):
        if options:
            message = f"solver options apply to names of solvers; got {solver!r}"
            raise SolverError(message, solver=solver.name, option=next(iter(options)))
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
