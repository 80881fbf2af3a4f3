"""Steps of environments against VMAS, with the same numbers of agents and environments.

Run with the installed package, and with VMAS (``pip install casswarm[rl] vmas``)::

    OPENBLAS_NUM_THREADS=1 NUMBA_NUM_THREADS=1 python benchmarks/envs.py           # minutes
    OPENBLAS_NUM_THREADS=1 NUMBA_NUM_THREADS=1 python benchmarks/envs.py --quick   # one size

VMAS (Bettini, Kortvelesy, Blumenkamp, Prorok, "VMAS: a vectorized multi-agent simulator for
collective robot learning", DARS 2022) runs on PyTorch, here with one thread on the CPU.

- ``simple_spread`` is the scenario of VMAS that is most like casswarm's: every agent moves in the
  plane, depends on all others (there by collisions, here by rates), and observes its own
  position and velocity, landmarks (there n, here the target and the radars) and the others.
- ``dispersion`` has no collisions, and agents do not observe each other.
- ``navigation`` has a range sensor for every agent.

Actions are sampled before. Chunks of steps are timed in turn; the ratio is the median of those of
the pairs. casswarm begins a new run where one has ended; VMAS is not reset.
"""

from __future__ import annotations

from collections.abc import Callable
from itertools import product
from typing import Any

import numpy as np
import torch
import vmas
from _timing import arguments, in_turn, print_table

import casswarm as csw
from casswarm.envs import SwarmVectorEnv

SCENARIOS = ("simple_spread", "dispersion", "navigation")
AGENTS = (3, 5, 10)
SIZES = (1, 32, 256, 1024, 8192)
CHUNK = 0.1  # seconds of a chunk of steps, about
REPEATS = 9


def scenario(n: int) -> csw.Scenario:
    """`paper-1` with n members on a circle, at rest."""
    angles = 2 * np.pi * np.arange(n) / n
    positions = 0.2 * n * np.stack([np.cos(angles), np.sin(angles)], axis=1)
    values = {"swarm.positions": positions.tolist(), "swarm.velocity": [0.0, 0.0]}
    return csw.load_scenario("paper-1").with_values(values)


def of_casswarm(n: int, size: int) -> Callable[[int], None]:
    """Steps of casswarm's environment, as a function of their number."""
    env = SwarmVectorEnv(scenario(n), size)
    env.action_space.seed(0)
    env.reset(seed=0)
    actions = [env.action_space.sample() for _ in range(4)]

    def steps(number: int) -> None:
        for k in range(number):
            env.step(actions[k % 4])

    return steps


def of_vmas(name: str, n: int, size: int) -> Callable[[int], None]:
    """The same of a scenario of VMAS."""
    env: Any = vmas.make_env(
        scenario=name, num_envs=size, device="cpu", continuous_actions=True, seed=0, n_agents=n
    )
    env.reset()
    actions = [[2.0 * torch.rand(size, 2) - 1.0 for _ in range(n)] for _ in range(4)]

    def steps(number: int) -> None:
        for k in range(number):
            env.step(actions[k % 4])

    return steps


def row(name: str, n: int, size: int, repeats: int) -> list[Any]:
    """Environment steps a second of both, and the ratio."""
    own, other = of_casswarm(n, size), of_vmas(name, n, size)
    seconds, of_other, _ = in_turn(lambda: own(3), lambda: other(3), 3)
    number, of_other = max(3, int(CHUNK * 3 / seconds)), max(3, int(CHUNK * 3 / of_other))
    first, second, ratio = in_turn(lambda: own(number), lambda: other(int(of_other)), repeats)
    per_second, others = size * number / first, size * of_other / second
    return [name, n, size, f"{per_second:,.0f}", f"{others:,.0f}", ratio * number / of_other]


def main() -> None:
    """Print a table."""
    quick = arguments(__doc__).quick
    torch.set_num_threads(1)
    cases = [("simple_spread", 5, 1024)] if quick else product(SCENARIOS, AGENTS, SIZES)
    columns = "VMAS scenario", "agents", "environments", "casswarm steps/s", "VMAS steps/s", "ratio"
    print_table(columns, (row(*case, 3 if quick else REPEATS) for case in cases))


if __name__ == "__main__":
    main()
