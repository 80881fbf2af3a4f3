"""First use in a new process: processor time with compiled code on disk, and without.

Run with the installed package::

    python benchmarks/startup.py                            # all, some minutes
    python benchmarks/startup.py leader interior_point      # some
    python benchmarks/startup.py --against OTHER/bin/python # in turn with another environment
    python benchmarks/startup.py --kernels leader           # where the compilation's time goes

A part prepares what it needs, imports, scenario and guide, and then makes one call. Of that call
the table gives the processor time in seconds, medians over processes: ``cold`` with an empty folder
of compiled code, ``warm`` with that of the process before; ``imports`` is that of preparing.
`simulate` is a whole command, against importing CasADi, pandas and Matplotlib.
"""

from __future__ import annotations

import argparse
import json
import os
import statistics
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
from _timing import print_table

Call = Callable[[], object]


def first_decision(scenario_name: str, policy: str) -> Call:
    """The first decision of a policy for a single state."""
    import casswarm as csw

    scenario = csw.load_scenario(scenario_name)
    guide = csw.plan(scenario, search="local")
    decide = csw.make_policy(policy, scenario, guide).velocities
    velocities = np.tile(guide.velocities[0], (scenario.n, 1))
    return lambda: decide(0, scenario.positions, velocities, np.ones(scenario.n, bool))


def leader() -> Call:
    """See `first_decision`."""
    return first_decision("paper-1", "leader")


def constrained() -> Call:
    """See `first_decision`."""
    return first_decision("paper-1", "constrained")


def collisions() -> Call:
    """See `first_decision`."""
    return first_decision("paper-2", "leader")


def interior_point() -> Call:
    """A batch of two small programs."""
    import casadi as ca

    import casswarm as csw
    from casswarm.solvers import FilterInteriorPoint

    x = ca.SX.sym("x", 2)
    program = {"x": x, "f": (1 - x[0]) ** 2 + ca.exp(x[1]), "g": x[0] * x[1]}
    problem = csw.Problem.from_casadi(program, x0=[0.5, 2.0], lbx=-3.0, ubx=3.0, lbg=1.0)
    instances = next(iter(problem.starts.values()))[np.zeros(2, int)]
    return lambda: FilterInteriorPoint().solve_batch(problem.nlp, instances)


def evaluate() -> Call:
    """The exact law of the leader policy to 0.001."""
    import casswarm as csw

    scenario = csw.load_scenario("paper-1")
    return lambda: csw.evaluate(scenario, "leader", tolerance=1e-3)


def optimal_value() -> Call:
    """Brackets of the best success of two members, with a limit of one second for the grids."""
    import casswarm as csw
    from casswarm.scenario.variations import with_parameters

    scenario = with_parameters(csw.load_scenario("gauntlet"), {"n": 2, "time.t_f": 5.3})
    return lambda: csw.optimal_value(scenario, time_limit=1.0)


CASES = {
    case.__name__: case
    for case in (leader, constrained, collisions, interior_point, evaluate, optimal_value)
}


def child(name: str) -> None:
    """Print the processor times of preparing a case and of its first call."""
    started = time.process_time()
    call = CASES[name]()
    prepared = time.process_time()
    call()
    print(json.dumps([prepared - started, time.process_time() - prepared]))


def run(python: str, code: str, cache: str) -> str:
    """Standard output of a process with this folder of compiled code, on one thread."""
    single = dict.fromkeys(("OPENBLAS_NUM_THREADS", "NUMBA_NUM_THREADS", "OMP_NUM_THREADS"), "1")
    folders = {"CASSWARM_CACHE": cache, "NUMBA_CACHE_DIR": cache}
    return subprocess.run(
        [python, "-c", code],
        cwd=Path(__file__).parent,
        env=os.environ | single | folders,
        check=True,
        capture_output=True,
        text=True,
    ).stdout


def measured(python: str, name: str) -> tuple[float, float, float]:
    """Preparing, the cold call and the warm call."""
    with tempfile.TemporaryDirectory() as cache:
        code = f"import startup; startup.child({name!r})"
        _, cold = json.loads(run(python, code, cache))
        warm = [json.loads(run(python, code, cache)) for _ in range(3)]
    prepared, again = (statistics.median(times) for times in zip(*warm, strict=True))
    return prepared, cold, again


def rows(names: list[str], pythons: list[str], repeats: int) -> Iterator[list[object]]:
    """A row for each case and environment."""
    for name in names:
        times = [[measured(python, name) for python in pythons] for _ in range(repeats)]
        for which, python in enumerate(pythons):
            middle = np.median([each[which] for each in times], axis=0)
            yield [name, python if which else "this", *(f"{second:.2f}" for second in middle)]


def simulate(python: str) -> list[object]:
    """CPU seconds of `casswarm simulate paper-1` without compiled code, and of its imports."""
    command = "import sys; from casswarm.cli import main; sys.argv[1:] = {}; main()"
    imports = "import casadi, pandas, matplotlib.pyplot"
    with tempfile.TemporaryDirectory() as folder:
        arguments = ["simulate", "paper-1", "--quiet", "--out", str(Path(folder) / "out")]
        used = []
        for code in (imports, command.format(arguments), command.format(arguments)):
            before = sum(os.times()[2:4])
            run(python, code, str(Path(folder) / "cache"))
            used.append(sum(os.times()[2:4]) - before)
    name = "this" if python == sys.executable else python
    return ["simulate", name, *(f"{seconds:.2f}" for seconds in used)]


def own_seconds(records: list[Any], label: Callable[[Any], str]) -> Counter[str]:
    """Seconds of Numba's events by label, without those of events within them."""
    seconds: Counter[str] = Counter()
    started: list[list[float]] = []
    for when, event in records:
        if event.is_start:
            started.append([when, 0.0])
            continue
        first, nested = started.pop()
        seconds[label(event.data)] += when - first - nested
        if started:
            started[-1][1] += when - first
    return seconds


def kernels(name: str) -> None:
    """Print which functions a cold first call compiles, and in which passes the time goes."""
    call = CASES[name]()
    with tempfile.TemporaryDirectory() as cache:
        os.environ["CASSWARM_CACHE"] = os.environ["NUMBA_CACHE_DIR"] = cache
        from numba.core.event import install_recorder

        recorders = install_recorder("numba:compile"), install_recorder("numba:run_pass")
        with recorders[0] as functions, recorders[1] as passes:
            call()
    tables = {
        "function": own_seconds(functions.buffer, lambda data: data["dispatcher"].__name__),
        "pass": own_seconds(passes.buffer, lambda data: data["name"].split(" ")[0]),
    }
    for title, seconds in tables.items():
        most = [(label, f"{own:.2f}") for label, own in seconds.most_common(15)]
        print_table((title, "s"), [*most, (f"all {len(seconds)}", f"{seconds.total():.2f}")])


def main() -> None:
    """Print the chosen tables."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("parts", nargs="*", metavar="PART", help=", ".join([*CASES, "simulate"]))
    parser.add_argument("--against", metavar="PYTHON", help="of another environment")
    parser.add_argument("--repeats", type=int, default=3)
    parser.add_argument("--kernels", action="store_true", help="what is compiled, and in how long")
    options = parser.parse_args()
    parts = options.parts or [*CASES, "simulate"]
    names = [name for name in parts if name in CASES]
    if unknown := set(parts) - {*CASES, "simulate"}:
        parser.error(f"unknown part {', '.join(sorted(unknown))}")
    if options.kernels:
        for name in names:
            kernels(name)
        return
    pythons = [sys.executable, *([options.against] if options.against else [])]
    if names:
        columns = ("first use", "environment", "imports", "cold", "warm")
        print_table(columns, rows(names, pythons, options.repeats))
    if "simulate" in parts:
        columns = ("command", "environment", "imports alone", "cold", "warm")
        print_table(columns, map(simulate, pythons))


if __name__ == "__main__":
    main()
