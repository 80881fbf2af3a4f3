"""Any program in batches: casswarm's interior point against a loop of Ipopt, on one core.

Run in a checkout, with the installed package::

    OPENBLAS_NUM_THREADS=1 python benchmarks/programs.py            # three minutes
    OPENBLAS_NUM_THREADS=1 python benchmarks/programs.py --quick    # fewer instances
    python benchmarks/programs.py published                         # one table

Prints Markdown tables: CPU microseconds per instance of `FilterInteriorPoint` with Ipopt as its
fallback, with verification, and of `Ipopt` on the first twentieth of them, without; the ratio;
the shares that are solved, with a verified violation of at most 1e-6; and how many instances went
to the fallback. Parameters and initial guesses are random.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from _timing import arguments, print_table, timed

sys.path.insert(0, str(Path(__file__).parents[1] / "tests" / "helpers"))

from backend_cases import guide
from cart_pole import cart_poles
from hock_schittkowski import NUMBERS, published
from window_cases import both, window

from casswarm.nlp.program import Instances, Nlp
from casswarm.solvers import FilterInteriorPoint, Ipopt

COLUMNS = (
    "program",
    "nx, ng",
    "interior point",
    "Ipopt",
    "ratio",
    "solved",
    "by Ipopt",
    "fallback",
)
Row = tuple[object, ...]


def compared(name: str, nlp: Nlp, instances: Instances, few: int, **options: Any) -> Row:
    """A row: both solvers on the same instances, Ipopt on the first few of them."""
    ipopt = Ipopt(**options)
    ours = FilterInteriorPoint(fallback=ipopt, **options)
    for solver in (ours, ipopt):
        solver.solve_batch(nlp, instances[:2])  # compiles
    batch, _, own = timed(partial(ours.solve_batch, nlp, instances))
    seconds = 0.0
    answers = []
    for i in range(few):
        answer, _, cpu = timed(partial(ipopt.run, nlp, instances[i : i + 1]))
        answers.append(ipopt.verified(nlp, instances[i : i + 1], answer[0]))
        seconds += cpu
    own, other = 1e6 * own / len(instances), 1e6 * seconds / few
    return (
        name,
        f"{nlp.sizes[0]}, {nlp.sizes[2]}",
        f"{own:.0f} us",
        f"{other:.0f} us",
        f"{other / own:.1f}",
        f"{batch.success.mean():.3f}",
        f"{np.mean([answer.status.success for answer in answers]):.3f}",
        int(batch.used_fallback.sum()),
    )


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
        f"{at_least} of {len(ratios)} >= 20",
        "",
    )


def of_a_cart_and_pole(count: int) -> Iterator[Row]:
    """Windows of predictive control, short and long, from random initial states."""
    for steps, dt in ((15, 0.05), (20, 0.05), (20, 0.08), (20, 0.1), (40, 0.05)):
        name = f"cart-pole, {steps} steps of {dt:g} s"
        yield compared(name, *cart_poles(count, steps, dt), max(5, count // 20))


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
    "published": of_hock_and_schittkowski,
    "cart-pole": of_a_cart_and_pole,
}

if __name__ == "__main__":
    options = arguments(__doc__, PARTS)
    for part in options.parts:
        print_table(COLUMNS, PARTS[part](100 if options.quick else 1000))
