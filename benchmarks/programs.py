"""Any program in batches: casswarm's interior point against a loop of Ipopt, on one core.

Run in a checkout, with the installed package::

    OPENBLAS_NUM_THREADS=1 python benchmarks/programs.py            # three minutes
    OPENBLAS_NUM_THREADS=1 python benchmarks/programs.py --quick    # fewer instances
    python benchmarks/programs.py published                         # one table

Prints Markdown tables: CPU microseconds per instance of `FilterInteriorPoint` with Ipopt as its
fallback, with verification, and of `Ipopt` on the first twentieth of them, without; the ratio; the
same of fatrop, which casadi brings, where the program has stages of states and controls; the shares
that are solved, with a verified violation of at most 1e-6; and how many instances went to the
fallback. Parameters and initial guesses are random. `large` has a tenth of the instances. `warm`
prints iterations and times of windows whose states have moved by 0.01: from the cold start, from
the previous x, and from the multipliers too.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np
from _timing import arguments, print_table, timed

sys.path.insert(0, str(Path(__file__).parents[1] / "tests" / "helpers"))

from backend_cases import guide
from cart_pole import cart_poles
from hock_schittkowski import NUMBERS, published
from large_programs import elliptic_control, masses
from window_cases import both, window

from casswarm.nlp.program import Instances, Nlp
from casswarm.solvers import FilterInteriorPoint, Ipopt, NlpSol, Solver

COLUMNS = (
    "program",
    "nx, ng",
    "interior point",
    "Ipopt",
    "ratio",
    "fatrop",
    "ratio",
    "solved",
    "by Ipopt",
    "by fatrop",
    "fallback",
)
WARM_COLUMNS = "program", "start", "iterations", "most", "time", "solved"
Row = tuple[object, ...]


def compared(
    name: str,
    nlp: Nlp,
    instances: Instances,
    few: int,
    fatrop: Solver | None = None,
    **options: Any,
) -> Row:
    """A row: the solvers on the same instances, the others on the first few of them."""
    ipopt = Ipopt(**options)
    ours = FilterInteriorPoint(fallback=ipopt, **options)
    others = [solver for solver in (ipopt, fatrop) if solver is not None]
    for solver in (ours, *others):
        solver.solve_batch(nlp, instances[:2])  # compiles
    batch, _, own = timed(partial(ours.solve_batch, nlp, instances))
    own *= 1e6 / len(instances)
    times, shares = zip(*(alone(each, nlp, instances[:few]) for each in others), strict=True)
    none = [""] * (2 - len(others))
    return (
        name,
        f"{nlp.sizes[0]}, {nlp.sizes[2]}",
        f"{own:.0f} us",
        *(part for time in times for part in (f"{time:.0f} us", f"{time / own:.1f}")),
        *(2 * none),
        f"{batch.success.mean():.3f}",
        *(f"{share:.3f}" for share in shares),
        *none,
        int(batch.used_fallback.sum()),
    )


def alone(solver: Solver, nlp: Nlp, instances: Instances) -> tuple[float, float]:
    """Microseconds of an instance in a loop, and the share that is solved."""
    seconds, solved = 0.0, 0
    for i in range(len(instances)):
        one = instances[i : i + 1]
        (answer,), _, cpu = timed(partial(solver.run, nlp, one))
        solved += solver.verified(nlp, one, answer).status.success
        seconds += cpu
    return 1e6 * seconds / len(instances), solved / len(instances)


def warm(count: int) -> Iterator[Row]:
    """Windows of states that have moved, from three initial guesses."""
    data = window(count, 5, 3, 0)
    noise = 0.01 * np.random.default_rng(1).normal(size=data.positions.shape)
    moved = replace(data, positions=data.positions + noise * data.alive[..., None])
    solver = FilterInteriorPoint()
    names = "leader-mpc-3", "constrained-mpc-3"
    for name, before, after in zip(names, both(data), both(moved), strict=True):
        found = solver.solve_batch(before.nlp, before.instances)
        posed = after.instances
        starts = {
            "cold": posed,
            "x": posed.with_x0(found.x),
            "x and multipliers": posed.with_x0(found.x, found.lam_x, found.lam_g),
        }
        for start, instances in starts.items():
            batch, _, cpu = timed(partial(solver.solve_batch, after.nlp, instances))
            iterations = f"{batch.iterations.mean():.1f}", int(batch.iterations.max())
            time = f"{1e6 * cpu / count:.0f} us"
            yield name, start, *iterations, time, f"{batch.success.mean():.3f}"


def own(count: int) -> Iterator[Row]:
    """Windows of the look-ahead, and guides; also with a smaller barrier for both solvers."""
    leader, constrained = both(window(count, 5, 3, 0))
    nlp, one = guide(10.0)
    programs = {
        "leader-mpc-3": (leader.nlp, leader.instances),
        "constrained-mpc-3": (constrained.nlp, constrained.instances),
        "guide, 30 steps": (nlp, around(one, count, 0.02)),
    }
    for name, program in programs.items():
        yield compared(name, *program, max(5, count // 20))
        yield compared(f"{name}, mu_init = 0.02", *program, max(5, count // 20), mu_init=0.02)


STEPS, DT = 20, 0.1


def stages(count: int) -> Iterator[Row]:
    """Windows of a unicycle that passes a disc, with states and controls in stages."""
    nlp, instances, equality = unicycle(count)
    plugin = {"print_level": 0, "tol": 1e-8, "max_iter": 500}
    options = {"structure_detection": "auto", "equality": equality, "fatrop": plugin}
    few = max(5, count // 20)
    yield compared("unicycle, 20 steps", nlp, instances, few, NlpSol("fatrop", options))


def unicycle(count: int) -> tuple[Nlp, Instances, list[bool]]:
    """Windows from random states, in the order of stages; and which rows are equations."""
    initial = ca.SX.sym("initial", 3)
    states = [ca.SX.sym(f"state {k}", 3) for k in range(STEPS + 1)]
    controls = [ca.SX.sym(f"control {k}", 2) for k in range(STEPS)]
    variables, limits, rows, equality = [], [], [], []
    objective = ca.SX(0)
    for k, state in enumerate(states):
        variables.append(state)
        limits += [10.0, 10.0, 10.0]
        objective += ca.sumsqr(state[:2] - ca.DM([2.0, 0.0]))
        if k < STEPS:
            speed, turn = ca.vertsplit(controls[k])
            variables.append(controls[k])
            limits += [1.0, 2.0]
            rate = ca.vertcat(speed * ca.cos(state[2]), speed * ca.sin(state[2]), turn)
            rows.append(states[k + 1] - (state + DT * rate))  # this sign is fatrop's
            objective += 0.01 * ca.sumsqr(controls[k])
            equality += [True] * 3
        rows.append(state - initial if k == 0 else ca.sumsqr(state[:2] - ca.DM([1.0, 0.1])))
        equality += [True] * 3 if k == 0 else [False]
    x, g = ca.vertcat(*variables), ca.vertcat(*rows)
    nlp = Nlp.from_expressions("unicycle", x, initial, objective, g)
    p = np.random.default_rng(0).uniform([-0.3, -0.5, -0.5], [0.3, 0.5, 0.5], (count, 3))
    x0 = np.zeros((count, nlp.sizes[0]))
    for k in range(STEPS + 1):
        x0[:, 5 * k : 5 * k + 3] = p
    lbg = np.where(equality, 0.0, 0.16)
    ubg, ubx = np.where(equality, 0.0, np.inf), np.array(limits)
    return nlp, Instances(x0, p, -ubx, ubx, lbg, ubg), equality


def of_hock_and_schittkowski(count: int) -> Iterator[Row]:
    """Published problems around their initial guesses, and the median ratio."""
    ratios = []
    for number in NUMBERS:
        known = published(number)
        row = compared(
            f"HS{number}", known.nlp, around(known.instance, count, 0.1), max(5, count // 20)
        )
        ratios.append(float(str(row[4])))
        yield row
    at_least = sum(ratio >= 20 for ratio in ratios)
    yield (
        "median",
        "",
        "",
        "",
        f"{np.median(ratios):.1f}",
        "",
        "",
        "",
        f"{at_least} of {len(ratios)} >= 20",
        "",
        "",
    )


def of_a_cart_and_pole(count: int) -> Iterator[Row]:
    """Windows of predictive control, short and long, from random initial states."""
    for steps, dt in ((15, 0.05), (20, 0.05), (20, 0.08), (20, 0.1), (40, 0.05)):
        name = f"cart-pole, {steps} steps of {dt:g} s"
        yield compared(name, *cart_poles(count, steps, dt), max(5, count // 20))


def large(count: int) -> Iterator[Row]:
    """A tenth as many instances of sparse programs with 300 to 5000 variables."""
    for program, sizes in ((masses, (20, 334)), (elliptic_control, (12, 50))):
        for size in sizes:
            nlp, instances = program(count // 10, size)
            yield compared(nlp.name, nlp, instances, 5)


def around(one: Instances, count: int, spread: float) -> Instances:
    """Instances with random parameters and initial guesses around those of a single one."""
    rng = np.random.default_rng(0)
    x0, p = (
        values + spread * rng.normal(size=(count, values.shape[1])) * np.maximum(least, abs(values))
        for values, least in ((one.x0, 1.0), (one.p, 0.0))
    )
    x0 = np.clip(x0, one.lbx, one.ubx)
    return Instances(x0, p, one.lbx, one.ubx, one.lbg, one.ubg, scale=one.scale)


PARTS: dict[str, Callable[[int], Iterator[Row]]] = {
    "own": own,
    "stages": stages,
    "published": of_hock_and_schittkowski,
    "cart-pole": of_a_cart_and_pole,
    "large": large,
    "warm": warm,
}

if __name__ == "__main__":
    options = arguments(__doc__, PARTS)
    for part in options.parts:
        columns = WARM_COLUMNS if part == "warm" else COLUMNS
        print_table(columns, PARTS[part](100 if options.quick else 1000))
