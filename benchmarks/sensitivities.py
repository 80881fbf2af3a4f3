"""Sensitivities of batches: against central differences, and the time of a solve.

Run in a checkout, with the installed package::

    OMP_NUM_THREADS=1 python benchmarks/sensitivities.py             # two minutes
    OMP_NUM_THREADS=1 python benchmarks/sensitivities.py --quick     # fewer instances
    OMP_NUM_THREADS=1 python benchmarks/sensitivities.py others      # the last table only

Prints a Markdown table. *Error* is the largest difference of dx/dp from extrapolated central
differences, relative to the larger of 1 and of the largest entry, among instances where differences
of two steps agree to 1e-5 (*comparable*; elsewhere the active set changes, or the solution is not
unique, within a step). Parameters are the linear term of the objective and the shifts of the rows.
Times are of a processor, relative to `solve_batch` without sensitivities: of the adjoint, all of
which is the system and one solve, and of dx/dp.

A second table has CPU milliseconds an instance of a solve, of dx/dp beside it, and of both together
by other packages, on windows of 102 variables with 7 parameters, and how far their dx/dp differs.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Iterator
from dataclasses import replace
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np
from _timing import print_table

sys.path.insert(0, str(Path(__file__).parents[1] / "tests" / "helpers"))

from hock_schittkowski import NUMBERS, published

from casswarm.nlp import Instances, Nlp
from casswarm.solvers import FilterInteriorPoint
from casswarm.solvers.external import InstanceFunctions

SOLVER = FilterInteriorPoint()
TIGHT = FilterInteriorPoint(tolerance=1e-12, constraint_tolerance=1e-12)
STEP, AGREE = 1e-4, 1e-5


def shifted(number: int, batch: int) -> tuple[Nlp, Instances]:
    """A published problem with shifts of its data as parameters, and random instances."""
    nlp, instance = published(number).nlp, published(number).instance
    n, _, m = nlp.sizes
    x, p = ca.SX.sym("x", n), ca.SX.sym("p", n + m)
    f, g = nlp.evaluate.expand()(x, ca.SX(0, 1))
    rows = g + p[n:] if m else ca.SX(0, 1)
    program = Nlp.from_expressions(nlp.name, x, p, f + ca.dot(p[:n], x), rows)
    values = 1e-2 * np.random.default_rng(number).normal(size=(batch, n + m))
    return program, replace(instance[np.zeros(batch, int)], p=values)


def window(steps: int, batch: int) -> tuple[Nlp, Instances]:
    """A window of a point mass past an obstacle: state and three weights are parameters."""
    x, p = ca.SX.sym("x", 6 * steps), ca.SX.sym("p", 7)
    states, inputs = ca.reshape(x[: 4 * steps], 4, steps), ca.reshape(x[4 * steps :], 2, steps)
    cost, rows, last = ca.SX(0), [], p[:4]
    for k in range(steps):
        u, at = inputs[:, k], states[:, k]
        moved = last[:2] + 0.2 * last[2:] + 0.02 * u
        rows.append(at - ca.vertcat(moved, last[2:] + 0.2 * u))
        cost += p[4] * ca.sumsqr(at[:2]) + p[5] * ca.sumsqr(at[2:]) + p[6] * ca.sumsqr(u)
        cost += 0.1 * ca.exp(-ca.sumsqr(at[:2] - 0.5))
        last = at
    program = Nlp.from_expressions(f"window of {steps}", x, p, cost, ca.vertcat(*rows))
    generator = np.random.default_rng(0)
    low, high = [-1.5] * 2 + [-1.0] * 2 + [0.5] * 3, [1.5] * 2 + [1.0] * 2 + [2.0] * 3
    values = generator.uniform(low, high, (batch, 7))
    limit, zero = np.repeat([2.0, 1.0], [4 * steps, 2 * steps]), np.zeros(4 * steps)
    return program, Instances(np.zeros((batch, 6 * steps)), values, -limit, limit, zero, zero)


def differences(nlp: Nlp, instances: Instances, x: Any, step: float) -> tuple[Any, Any]:
    """Central differences (B, nx, np), and which instances were solved at all points."""
    solved, slopes = np.ones(len(instances), bool), []
    for change in step * np.eye(nlp.sizes[1]):
        after, before = (
            TIGHT.solve_batch(nlp, replace(instances, x0=x, p=instances.p + sign * change))
            for sign in (1, -1)
        )
        solved &= after.success & before.success
        slopes.append((after.x - before.x) / (2 * step))
    return np.stack(slopes, axis=2), solved


def row(nlp: Nlp, instances: Instances) -> list[Any]:
    """A row of the table."""
    SOLVER.solve_batch(nlp, instances[:2], sensitivities=True).sensitivities.forward()  # compile
    times = [time.process_time()]
    SOLVER.solve_batch(nlp, instances)
    times.append(time.process_time())
    solution = SOLVER.solve_batch(nlp, instances, sensitivities=True)
    times.append(time.process_time())
    found = solution.sensitivities
    found.adjoint(np.ones_like(solution.x))
    times.append(time.process_time())
    exact = found.dx_dp
    times.append(time.process_time())
    solve, both, adjoint, forward = np.diff(times)
    coarse, solved = differences(nlp, instances, solution.x, 2 * STEP)
    fine, again = differences(nlp, instances, solution.x, STEP)
    scale = np.maximum(1.0, abs(exact).max(axis=(1, 2)))
    comparable = found.regular & solved & again
    comparable &= abs(coarse - fine).max(axis=(1, 2)) < AGREE * scale
    error = (abs((4 * fine - coarse) / 3 - exact).max(axis=(1, 2)) / scale)[comparable]
    weak = found.weakly_active.any(axis=1).sum()
    counts = [int(solution.success.sum()), int(found.regular.sum()), int(weak), len(error)]
    shares = [f"{(both - solve + part) / solve:.0%}" for part in (adjoint, forward)]
    return [nlp.name, *counts, f"{error.max(initial=0.0):.1e}", nlp.sizes[1], *shares]


def casadi_derivatives(nlp: Nlp, instances: Instances) -> tuple[list[float], Any]:
    """Seconds of a solve and of one with dx/dp, by `nlpsol`, and dx/dp (B, nx, np).

    By its plugin sqpmethod: with Ipopt's multipliers, the systems of nlpsol's derivatives are
    singular on these windows, whichever of its linear solvers is chosen.
    """
    x, p, one = ca.MX.sym("x", nlp.sizes[0]), ca.MX.sym("p", nlp.sizes[1]), instances[:1]
    f, g = nlp.evaluate(x, p)
    quiet: dict[str, Any] = {f"print_{part}": False for part in ("time", "header", "iteration")}
    quiet |= {"print_status": False, "qpsol": "qrqp"}
    quiet["qpsol_options"] = {"print_iter": False, "print_header": False}
    solver = ca.nlpsol("solver", "sqpmethod", {"x": x, "p": p, "f": f, "g": g}, quiet)
    bounds = {key: getattr(one, key)[0] for key in ("x0", "lbx", "ubx", "lbg", "ubg")}
    solve = ca.Function("solve", [p], [solver(p=p, **bounds)["x"]])
    jacobian = solve.jacobian()
    times = [time.process_time()]
    for values in instances.p:
        solve(values)
    times.append(time.process_time())
    derivatives = [np.asarray(jacobian(values, solve(values))) for values in instances.p]
    times.append(time.process_time())
    return [float(each) / len(instances) for each in np.diff(times)], np.stack(derivatives)


def pounce_derivatives(nlp: Nlp, instances: Instances) -> tuple[list[float], Any]:
    """Likewise by POUNCE: parameters are variables, and rows that pin them are moved."""
    import pounce

    n, k, m = nlp.sizes
    x = ca.SX.sym("x", n + k)
    f, g = nlp.evaluate(x[:n], x[n:])
    pinned = Nlp.from_expressions("pinned", x, ca.SX(0, 1), f, ca.vertcat(g, x[n:]))
    rows, derivatives, times = np.arange(m, m + k), [], np.zeros(2)
    for i in range(len(instances)):
        one, p = instances[i : i + 1], instances.p[i : i + 1]
        free = np.full((1, k), np.inf)
        posed = Instances(
            np.hstack([one.x0, p]), np.empty((1, 0)), np.hstack([one.lbx, -free]),
            np.hstack([one.ubx, free]), np.hstack([one.lbg, p]), np.hstack([one.ubg, p]),
        )  # fmt: skip
        functions = InstanceFunctions(pinned, posed)
        problem = pounce.Problem(
            n=n + k, m=m + k, problem_obj=functions, lb=functions.lower, ub=functions.upper,
            cl=posed.lbg[0], cu=posed.ubg[0],
        )  # fmt: skip
        problem.add_option("print_level", 0)
        solver, started = pounce.Solver(problem), time.process_time()
        solver.solve(functions.x0)
        solved = time.process_time()
        columns = [solver.parametric_step(rows, unit)[:n] for unit in np.eye(k)]
        times += solved - started, time.process_time() - solved
        derivatives.append(np.stack(columns, axis=1))
    solve, derive = times / len(instances)
    return [float(solve), float(solve + derive)], np.stack(derivatives)


def own_derivatives(nlp: Nlp, instances: Instances) -> tuple[list[float], Any]:
    """Likewise by casswarm, in a batch."""
    times = [time.process_time()]
    SOLVER.solve_batch(nlp, instances)
    times.append(time.process_time())
    found = SOLVER.solve_batch(nlp, instances, sensitivities=True).sensitivities.dx_dp
    times.append(time.process_time())
    return [float(each) / len(instances) for each in np.diff(times)], found


def others(batch: int) -> Iterator[list[Any]]:
    """Rows of the table of other packages, on windows of about 100 variables."""
    nlp, instances = window(17, batch)
    own_derivatives(nlp, instances[:2])
    ways = {"casswarm": own_derivatives, "nlpsol (sqpmethod)": casadi_derivatives}
    ways |= {"POUNCE": pounce_derivatives} if find_spec("pounce") else {}
    exact: Any = None
    for name, way in ways.items():
        runs = [way(nlp, instances) for _ in range(3)]
        solve, both = np.median([times for times, _ in runs], axis=0) * 1e3
        exact = runs[0][1] if exact is None else exact
        different = abs(runs[0][1] - exact).max(axis=(1, 2)) / abs(exact).max(axis=(1, 2))
        numbers = [f"{each:.3g}" for each in (solve, both - solve, both)]
        yield [name, *numbers, f"{np.median(different):.1e}", f"{different.max():.1e}"]


def main() -> None:
    """Print the tables."""
    quick = "--quick" in sys.argv[1:]
    batch = 50 if quick else 1000
    posed = [shifted(number, batch) for number in NUMBERS]
    posed += [window(steps, batch // 2) for steps in (10, 17)]
    head = ["program", "solved", "regular", "weak", "comparable", "error", "parameters"]
    if "others" not in sys.argv[1:]:
        print_table([*head, "adjoint", "dx/dp"], [row(*each) for each in posed])
    head = ["package", "solve, ms", "dx/dp, ms", "both, ms", "median difference", "largest"]
    print_table(head, others(20 if quick else 100))


if __name__ == "__main__":
    main()
