"""A step of the formation policies, from states to verified velocities, against JAX's solver.

Run with the installed package, on one core::

    taskset -c 0 python benchmarks/formation_step.py          # a few minutes
    python benchmarks/formation_step.py cores                 # one thread against two

casswarm selects leaders, builds, solves and verifies the problems. JAX (``pip install jax``) only
solves problems that are already arrays, from one start. Ratios are medians of pairs that run in
turn; batches on one core are compared in processor time. States are those of real runs, or random
ones: members around the guide's point, with a normal deviation of 0.3, and their velocities around
the guide's with 0.1.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from unittest import mock

import numpy as np
from _timing import arguments, in_turn, print_table, timed
from batch import jax, recorded

import casswarm as csw
from casswarm.compiled import parallel as kernel_threads
from casswarm.formation import Auto
from casswarm.formation.task import LEADER_SELECTION, FormationTask
from casswarm.policies.formation_policies import formation_decision
from casswarm.solvers import Ipopt

PROBLEMS = {
    "leader": ("paper-1", "leader", None),
    "leader, collisions": ("paper-2", "leader", None),
    "constrained": ("paper-1", "constrained", None),
    "leader, n = 20": ("paper-1", "leader", 20),
}
"""Scenario, policy, and number of members where it is not the scenario's."""

SECONDS = 60.0
"""Time of a comparison, beyond which it has fewer repeats, but no fewer than seven."""


def random_states(task: FormationTask) -> FormationTask:
    """The same number of random states, around the guide's point after five steps."""
    batch, n = task.step.alive.shape
    guide = csw.plan(csw.load_scenario("paper-1"))
    rng = np.random.default_rng(0)
    alive = rng.random((batch, n)) < 0.9
    alive[:, 0] = True
    positions = guide.positions[5] + rng.normal(0.0, 0.3, (batch, n, 2))
    velocities = guide.velocities[5] + rng.normal(0.0, 0.1, (batch, n, 2))
    shown = alive[..., None]
    step = replace(
        task.step,
        positions=positions * shown,
        previous_velocities=velocities * shown,
        alive=alive,
        goals=np.broadcast_to(guide.reference(6), (1, batch, 2)),
    )
    leaders = task.leaders
    if task.rho is None:
        leaders = LEADER_SELECTION["nearest"](step, guide.reference(5))
    return FormationTask(step, leaders, task.rho)


def decide(task: FormationTask, size: int) -> Callable[[], object]:
    """Decisions in the first states, leader selection included."""
    task = task[np.arange(size)]
    reference, solver = task.step.goal[:, 0], Auto()

    def work() -> object:
        leaders = task.leaders
        if task.rho is None:
            leaders = LEADER_SELECTION["nearest"](task.step, reference)
        return formation_decision(replace(task, leaders=leaders), solver)

    return work


@contextmanager
def threads(number: int) -> Iterator[None]:
    """Let casswarm use so many threads."""

    def cores() -> int:
        return number

    with mock.patch.object(kernel_threads, "_cores", cores):
        yield


def processor_times(
    first: Callable[[], object], second: Callable[[], object], repeats: int, calls: int
) -> tuple[float, float, np.ndarray]:
    """Medians and quartiles of ratios in turn, of processor time, which other work changes less."""

    def several(work: Callable[[], object]) -> float:
        return timed(lambda: [work() for _ in range(calls)]).cpu / calls

    first(), second()
    with threads(1):
        pairs = [(several(first), several(second))]
        affordable = int(SECONDS / (calls * sum(pairs[0])))
        more = range(min(repeats, max(7, affordable)) - 1)
        pairs += [(several(first), several(second)) for _ in more]
    ones, others = np.array(pairs).T
    return (
        float(np.median(ones)),
        float(np.median(others)),
        np.percentile(others / ones, (25, 50, 75)),
    )


def one_core(quick: bool) -> Iterator[list[str]]:
    """Time of a call with one state, and times a state in batches, with ratios to JAX."""
    repeats, large = (7, 2000) if quick else (21, 10_000)
    for name, (scenario, policy, n) in PROBLEMS.items():
        real = recorded(scenario, policy, large, n)
        for kind, task in (("runs", real), ("random", random_states(real))):
            single = decide(task, 1)
            single()
            ipopt = Ipopt().solve_batch(task.nlp, task[np.arange(7)].formation().instances)
            cells = [
                f"{name}; {kind}",
                f"{1e6 * timed(single, 301).wall:.0f} us",
                f"{1e6 * ipopt.seconds / 7:.0f} us",
            ]
            for size in (500, large):
                work = decide(task, size)
                try:
                    program = jax(task[np.arange(size)], 1)
                except ImportError as error:
                    cells.append(f"{1e6 * timed(work, repeats).wall / size:.2f} us; {error}")
                    continue
                own, other, ratios = processor_times(work, program, repeats, large // size)
                low, ratio, high = ratios
                cells.append(
                    f"{1e6 * own / size:.2f} us; {1e6 * other / size:.2f} us; "
                    f"{ratio:.2f} ({low:.2f} to {high:.2f}) x"
                )
            decision = decide(task, large)()
            cells.append(f"{decision.fallbacks.sum()} / {decision.failures.sum()}")  # type: ignore[attr-defined]
            yield cells


def cores(quick: bool) -> Iterator[list[str]]:
    """Times a state in batches of 10,000 with one thread and with two."""
    for name, (scenario, policy, n) in PROBLEMS.items():
        work = decide(recorded(scenario, policy, 10_000, n), 10_000)

        def with_threads(number: int, work: Callable[[], object] = work) -> object:
            with threads(number):
                return work()

        two, one, ratio = in_turn(
            lambda: with_threads(2), lambda: with_threads(1), 7 if quick else 21
        )
        yield [name, f"{1e2 * one:.2f} us", f"{1e2 * two:.2f} us", f"{ratio:.2f} x"]


COLUMNS = {
    "one_core": (
        "problem; states",
        "one state, a call",
        "Ipopt alone",
        "batch of 500: casswarm; JAX; ratio (quartiles)",
        "batch of 10,000 (--quick: 2,000)",
        "fallbacks / failures",
    ),
    "cores": ("problem, 10,000 states", "one thread", "two threads", "ratio"),
}
PARTS = {part.__name__: part for part in (one_core, cores)}


def main() -> None:
    """Print the chosen tables, by default that of one core."""
    os.environ["XLA_FLAGS"] = (
        "--xla_cpu_multi_thread_eigen=false intra_op_parallelism_threads=1 "
        + os.environ.get("XLA_FLAGS", "")
    )
    options = arguments(__doc__, PARTS)
    for name in options.parts:
        print_table(COLUMNS[name], PARTS[name](options.quick))


if __name__ == "__main__":
    main()
