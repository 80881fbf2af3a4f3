"""Sensitivities of batches: against central differences, and the time of a solve.

Run in a checkout, with the installed package::

    OMP_NUM_THREADS=1 python benchmarks/sensitivities.py             # two minutes
    OMP_NUM_THREADS=1 python benchmarks/sensitivities.py --quick     # fewer instances

Prints a Markdown table. *Error* is the largest difference of dx/dp from extrapolated central
differences, relative to the larger of 1 and of the largest entry, among instances where differences
of two steps agree to 1e-5 (*comparable*; elsewhere the active set changes, or the solution is not
unique, within a step). Parameters are the linear term of the objective and the shifts of the rows.
Times are of a processor, relative to `solve_batch` without sensitivities: of the adjoint, all of
which is the system and one solve, and of dx/dp.
"""

from __future__ import annotations

import sys
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np
from _timing import print_table

sys.path.insert(0, str(Path(__file__).parents[1] / "tests" / "helpers"))

from hock_schittkowski import NUMBERS, published

from casswarm.nlp import Instances, Nlp
from casswarm.solvers import FilterInteriorPoint

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


def main() -> None:
    """Print the tables."""
    quick = "--quick" in sys.argv[1:]
    batch = 50 if quick else 1000
    posed = [shifted(number, batch) for number in NUMBERS]
    posed += [window(steps, batch // 2) for steps in (10, 17)]
    head = ["program", "solved", "regular", "weak", "comparable", "error", "parameters"]
    print_table([*head, "adjoint", "dx/dp"], [row(*each) for each in posed])


if __name__ == "__main__":
    main()
