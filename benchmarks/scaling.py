"""How the batch solver's time grows with the swarm.

Run with the installed package::

    python benchmarks/scaling.py            # n = 5 ... 1000, a minute or two
    python benchmarks/scaling.py --quick    # up to 200

A square lattice of n members flies along a straight line without losses, by the policy measured;
each of its first ten states is a formation problem, solved by `auto` in one thread and judged,
compiled code cached. Times are medians over states and repeats. A gradient is one call of the
compiled objective; "per gradient" is the solve's time over that of the gradients that it needed (1
is the least that is possible). The exponent is the slope of log time over log n, from n = 50 up.
The constrained trajectory with collisions has no row for n = 1000: it takes minutes a state.
"""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import cache

import numba
import numpy as np
from _timing import arguments, print_table, timed

import casswarm as csw
from casswarm.formation import Auto
from casswarm.formation.objective import CompiledObjective
from casswarm.formation.task import (
    LEADER_SELECTION,
    Formation,
    corridor_formation,
    leader_formation,
)
from casswarm.motion.step import Motion, Step

SIZES = (5, 20, 50, 200, 1000)
STEPS, SPACING = 10, 0.5
MOTION = Motion(v_max=2.0, a_max=0.5, dt=0.33)
PACE = np.array([0.8, 0.8])  # of the guide
RADARS = ((4.4, 4.6), (4.5, 3.0))
HAZARDS = {
    "": csw.Saturation(RADARS, alpha_1=4.0, alpha_2=3.0, alpha_3=4.0),
    ", collisions": csw.SaturationCollision(
        RADARS, alpha_1=4.0, alpha_2=3.0, alpha_3=4.0, beta_1=0.2, beta_2=6.0
    ),
}


@dataclass
class Measured:
    """One state: seconds to build and to solve, evaluations, seconds of a gradient, outcome."""

    build: float
    solve: float
    evaluations: int
    gradient: float
    solved: bool
    fallbacks: bool


def lattice(n: int) -> np.ndarray:
    """Places (n, 2) on a square lattice around the origin."""
    side = int(np.ceil(np.sqrt(n)))
    grid = np.stack(np.meshgrid(np.arange(side), np.arange(side)), -1).reshape(-1, 2)[:n]
    return SPACING * (grid - grid.mean(axis=0))


def formation(step: Step, policy: str, here: np.ndarray) -> Formation:
    """The policy's formation problem; the corridor grows with the swarm's area."""
    if policy == "leader":
        return leader_formation(step, LEADER_SELECTION["nearest"](step, here))
    n = step.alive.shape[1]
    return corridor_formation(step, max(0.05, 0.3 * n * SPACING**2))


def gradient_seconds(found: np.ndarray, problem: Formation) -> float:
    """Median time of one compiled objective and gradient, called from compiled code."""
    nlp, n = problem.nlp, found.size // 2
    compiled = nlp.attached(CompiledObjective)
    assert compiled is not None
    given = found, problem.instances.p[0].copy(), compiled.constants
    work = np.empty(2 * n), np.empty(n * (n + 8))
    repeated, calls = _repeated(compiled.evaluate), max(3, 20_000 // n)
    repeated(1, *given, *work)
    return timed(lambda: repeated(calls, *given, *work), 5).wall / calls


@cache
def _repeated(evaluate: Callable[..., float]) -> Callable[..., float]:
    """Compiled code that calls `evaluate` a number of times, from points that differ."""

    def repeat(calls, x, p, shared, gradient, scratch):  # type: ignore[no-untyped-def]
        total, kept = 0.0, x[0]
        for call in range(calls):
            x[0] = kept + 1e-12 * call
            total += evaluate(x, p, shared, gradient, scratch)
        x[0] = kept
        return total

    return numba.njit(repeat)  # type: ignore[no-any-return]


def flight(hazard: csw.Hazard, policy: str, n: int) -> list[Measured]:
    """Measure the states of one flight."""
    positions, velocities = lattice(n)[None], np.broadcast_to(PACE, (1, n, 2))
    alive, solver, rows = np.ones((1, n), bool), Auto(), []
    copies = max(1, 4000 // n) if n < 200 else 1  # so that no call's overhead counts
    for t in range(STEPS):
        here, goal = MOTION.dt * PACE * t, MOTION.dt * PACE * (t + 1)
        started = time.perf_counter()
        step = Step(hazard, MOTION, positions, velocities, alive, goal[None])
        problem = formation(step, policy, here)
        build = time.perf_counter() - started
        many = problem.instances[np.zeros(copies, int)]
        solver.batch.run_batch(problem.nlp, many)  # compiled, or read from disk
        runs = [solver.batch.run_batch(problem.nlp, many) for _ in range(7 if n < 1000 else 1)]
        found = solver.solve_batch(problem.nlp, problem.instances)
        rows.append(
            Measured(
                build,
                statistics.median(run.seconds for run in runs) / copies,
                int(runs[0].results.counts[0, 1]) + 1,  # and one to verify
                gradient_seconds(found.x[0], problem),
                bool(found.success[0]),
                bool(found.used_fallback[0]),
            )
        )
        velocities = found.x.reshape(1, n, 2)
        positions = positions + MOTION.dt * velocities
    return rows


def table(sizes: Sequence[int]) -> Iterator[list[str]]:
    """A row for every problem and size, and one with the exponent of its growth."""
    for kind, hazard in HAZARDS.items():
        for policy in ("leader", "constrained"):
            medians = {}
            for n in sizes:
                if n == SIZES[-1] and policy == "constrained" and hazard.collides:
                    continue
                rows = flight(hazard, policy, n)
                medians[n] = statistics.median(row.solve for row in rows)
                yield [
                    f"{policy}{kind}",
                    str(n),
                    f"{1e3 * statistics.median(row.build for row in rows):.1f} ms",
                    f"{1e3 * medians[n]:.3g} ms",
                    f"{1e3 * max(row.solve for row in rows):.3g} ms",
                    f"{statistics.median(row.evaluations for row in rows):.0f}",
                    f"{statistics.median(r.solve / r.evaluations / r.gradient for r in rows):.2f}",
                    f"{sum(not row.solved for row in rows)} unsolved, "
                    f"{sum(row.fallbacks for row in rows)} fallbacks of {len(rows)}",
                ]
            large = [n for n in medians if n >= 50]
            logs = np.log(large), np.log([medians[n] for n in large])
            yield [f"{policy}{kind}", f"n^{np.polyfit(*logs, 1)[0]:.2f}", *[""] * 6]


def main() -> None:
    """Print the table."""
    sizes = SIZES[:-1] if arguments(__doc__).quick else SIZES
    columns = ("problem", "n", "build", "solve", "longest", "evaluations", "per gradient")
    print_table((*columns, "answers"), table(sizes))


if __name__ == "__main__":
    main()
