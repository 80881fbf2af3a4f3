"""Cases that `against.py` times in two versions: ways of using casswarm that have not changed.

A case does what is not timed, and returns what is. Only public names are used, inside the cases,
so that a version without a name lacks a case, not the whole benchmark.
Run as a program, it is the worker process of one version, and answers lines of standard input::

    prepare leader-1
    run 30
"""

from __future__ import annotations

import json
import resource
import subprocess
import sys
import tempfile
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from itertools import count
from pathlib import Path
from typing import Any

import numpy as np
from _timing import timed

Work = Callable[[], object]


def states(scenario: Any, guide: Any, size: int) -> tuple[Any, ...]:
    """Random states around the guide's point after five steps, most members alive."""
    rng = np.random.default_rng(0)
    alive = rng.random((size, scenario.n)) < 0.9
    alive[:, 0] = True
    shape = (size, scenario.n, 2)
    shown = alive[..., None]
    positions = guide.positions[5] + rng.normal(0.0, 0.3, shape)
    velocities = guide.velocities[5] + rng.normal(0.0, 0.1, shape)
    return 5, positions * shown, velocities * shown, alive


def with_members(scenario: Any, number: int) -> Any:
    """The scenario with another number of members, on a lattice."""
    from casswarm.scenario.variations import with_parameters

    return with_parameters(scenario, {"n": number})


def decision(name: str, policy: str, size: int, members: int | None = None) -> Work:
    """Decisions of a policy in random states."""
    import casswarm as csw

    scenario = csw.load_scenario(name)
    guide = csw.plan(scenario, search="local")
    if members is not None:
        scenario = with_members(scenario, members)
    maker = csw.make_policy(policy, scenario, guide)
    return partial(maker.decide_batch, *states(scenario, guide, size))


def planned(name: str, **options: Any) -> Work:
    """A guide."""
    import casswarm as csw

    return partial(csw.plan, csw.load_scenario(name), **options)


def jointly_planned() -> Work:
    """Paths of three members."""
    import casswarm as csw

    return partial(csw.plan_swarm, with_members(csw.load_scenario("ring"), 3))


def bounded() -> Work:
    """The bound on the success of every policy, in scenarios that differ: results are cached."""
    import casswarm as csw

    alley, calls = csw.load_scenario("alley"), count(1)
    return lambda: csw.success_bound(alley.with_values({"hazard.alpha_1": 3 + 1e-9 * next(calls)}))


def simulated(name: str, policies: tuple[str, ...], runs: int) -> Work:
    """Runs of policies."""
    import casswarm as csw

    scenario = csw.load_scenario(name)
    guide = csw.plan(scenario, search="local")
    return partial(csw.simulate, scenario, list(policies), runs=runs, guide=guide)


def evaluated(name: str, policy: str) -> Work:
    """The exact law of a policy."""
    import casswarm as csw

    scenario = csw.load_scenario(name)
    guide = csw.plan(scenario, search="local")
    return partial(csw.evaluate, scenario, policy, 1e-2, guide=guide)


def batch_solved(size: int) -> Work:
    """HS71 of Hock and Schittkowski (1981) from random starts, by the compiled interior point."""
    import casadi as ca

    import casswarm as csw

    x = ca.SX.sym("x", 4)
    posed = csw.Problem.from_casadi(
        {
            "x": x,
            "f": x[0] * x[3] * (x[0] + x[1] + x[2]) + x[2],
            "g": ca.vertcat(x[0] * x[1] * x[2] * x[3], ca.sumsqr(x)),
        },
        lbx=1.0,
        ubx=5.0,
        lbg=[25.0, 40.0],
        ubg=[np.inf, 40.0],
    )
    (one,) = posed.starts.values()
    guesses = np.random.default_rng(0).uniform(1.0, 5.0, (size, 4))
    instances = replace(one[np.zeros(size, int)], x0=guesses)
    return partial(csw.make_solver("interior-point").solve_batch, posed.nlp, instances)


def process(*command: str) -> Work:
    """A whole process, with this version of casswarm."""

    def run() -> None:
        with tempfile.TemporaryDirectory() as folder:
            subprocess.run([sys.executable, *command], cwd=folder, check=True, capture_output=True)

    return run


CASES: dict[str, Callable[[], Work]] = {
    "import": partial(process, "-c", "import casswarm"),
    "command-plan": partial(process, "-m", "casswarm", "plan", "paper-1"),
    "plan": partial(planned, "paper-1"),
    "plan-certified": partial(planned, "gauntlet", search="global"),
    "plan-swarm": jointly_planned,
    "success-bound": bounded,
    "leader-1": partial(decision, "paper-1", "leader", 1),
    "leader-10000": partial(decision, "paper-1", "leader", 10_000),
    "leader-20-members": partial(decision, "paper-1", "leader", 2_000, 20),
    "leader-collisions": partial(decision, "paper-2", "leader", 500),
    "constrained-1": partial(decision, "paper-1", "constrained", 1),
    "constrained-10000": partial(decision, "paper-1", "constrained", 10_000),
    "constrained-collisions": partial(decision, "paper-2", "constrained", 500),
    "constrained-200-members": partial(decision, "paper-1", "constrained", 4, 200),
    "constrained-1000-members": partial(decision, "paper-1", "constrained", 1, 1000),
    "look-ahead": partial(decision, "paper-1", "constrained-mpc-3", 500),
    "simulate": partial(simulated, "paper-1", ("naive", "leader", "constrained"), 10_000),
    "simulate-million": partial(simulated, "paper-1", ("leader",), 1_000_000),
    "evaluate": partial(evaluated, "ring", "leader"),
    "solve-batch": partial(batch_solved, 1_000),
}


def imported() -> str:
    """The version that this process imports, from its folder."""
    import casswarm as csw

    return f"{csw.__version__} in {Path(csw.__file__).parent}"


def main() -> None:
    """Answer requests, a line each, until standard input ends."""
    work: Work | None = None
    for line in sys.stdin:
        request, argument = line.split()
        answer: dict[str, Any] = {}
        try:
            if request == "version":
                answer["version"] = imported()
            elif request == "prepare":
                work = CASES[argument]()
                work()
                answer["wall"] = timed(work).wall
            elif work is not None:
                again = work
                result = timed(lambda: [again() for _ in range(int(argument))])  # noqa: B023
                answer = {"wall": result.wall / int(argument), "cpu": result.cpu / int(argument)}
                answer["peak"] = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
        except Exception as error:  # a version that lacks a name; the other goes on
            answer["error"] = f"{type(error).__name__}: {error}".splitlines()[0]
        print(json.dumps(answer), flush=True)


if __name__ == "__main__":
    main()
