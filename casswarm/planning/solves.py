"""Solves of a guide problem: by a deadline, and again where the feasible set is thin."""

from __future__ import annotations

import math
import time
from dataclasses import replace

from ..optimization.kkt import kkt_residuals
from ..optimization.problem import Instances, Nlp
from ..optimization.solution import Solution, Status
from ..optimization.solvers import Solver
from ..optimization.solvers.base import VIOLATION


def solve_by(deadline: float, solver: Solver, nlp: Nlp, instance: Instances) -> Solution:
    """Solution of a single instance, by a deadline if the solver can limit its time.

    A target that can only just be reached leaves a thin feasible set. Ipopt moves its guess away
    from bounds, and may then find the problem infeasible although the guess is feasible. It is
    solved again there from the guess itself, with several settings.

    Parameters
    ----------
    deadline : float
        A time of `time.monotonic`.
    solver, nlp, instance
    """
    solution = _limited(solver, deadline).solve(nlp, instance)[0]
    careful_solvers = solver.from_feasible_guess()
    if solution.status is not Status.INFEASIBLE or not careful_solvers:
        return solution
    if kkt_residuals(nlp, instance, instance.x0[0]).violation > VIOLATION:
        return solution
    for careful in careful_solvers:
        if time.monotonic() >= deadline:
            break
        again = _limited(careful, deadline).solve(nlp, instance)[0]
        if again.status.success:
            return again
    return solution


def _limited(solver: Solver, deadline: float) -> Solver:
    """A solver that ends by the deadline, if it can limit its time.

    Its limit is a power of two, so that few of them are compiled.
    """
    left = deadline - time.monotonic()
    limit: float = getattr(solver, "time_limit", 0.0)
    if not solver.capabilities.time_limit or limit <= left:
        return solver
    power = math.floor(math.log2(max(left, 1e-2)))
    return replace(solver, time_limit=2.0**power)  # type: ignore[type-var]
