"""Times of the main commands and building blocks: medians, and ratios within one run.

Run with the installed package::

    python benchmarks/overview.py            # all, a few minutes on two cores
    python benchmarks/overview.py plan rates # some

Prints a Markdown table. Machines differ and are shared: ratios say more than seconds.
"""

from __future__ import annotations

import subprocess
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path

from _timing import arguments, in_turn, print_table, timed

REPEATS = 5
CASSWARM = str(Path(sys.executable).parent / "casswarm")

Row = tuple[str, str, str]


def process(*command: str) -> Callable[[], object]:
    """A whole process in a folder of its own, as `work`."""

    def run() -> None:
        with tempfile.TemporaryDirectory() as folder:
            subprocess.run(command, cwd=folder, check=True, capture_output=True)

    return run


def plan() -> list[Row]:
    """`casswarm plan paper-1` against importing what it needs; pairs in turn."""
    imports = process(sys.executable, "-c", "import casadi, pandas, matplotlib.pyplot")
    command = process(CASSWARM, "plan", "paper-1")
    _, took, ratio = in_turn(imports, command, REPEATS)
    return [("casswarm plan paper-1, as a process", f"{took:.2f} s", f"{ratio:.2f} x its imports")]


def simulate() -> list[Row]:
    """`casswarm simulate paper-1 --runs 1000` by the default solver and by Ipopt."""
    command = (CASSWARM, "simulate", "paper-1", "--quiet", "--runs")
    thousand = timed(process(*command, "1000"), 3).wall
    ipopt = timed(process(*command, "1000", "--solver", "ipopt")).wall
    return [
        ("casswarm simulate paper-1 --runs 1000", f"{thousand:.1f} s", ""),
        ("the same with --solver ipopt", f"{ipopt:.1f} s", f"{ipopt / thousand:.1f} x"),
    ]


def formation() -> list[Row]:
    """One formation step of 50 members, built and solved by Ipopt."""
    import numpy as np

    import casswarm as csw
    from casswarm.formation.objective import formation_program
    from casswarm.guide.agent import initial_velocities
    from casswarm.problems.formation import formation_nlp

    rows = []
    scenario = csw.load_scenario("large-swarm")
    collision = {"hazard.kind": "saturation+collision", "hazard.beta_1": 0.1, "hazard.beta_2": 6.0}
    guide = csw.plan(scenario, search="local")
    for kind, variant in (("", scenario), (" + collision", scenario.with_values(collision))):
        state = (
            scenario.positions[None],
            initial_velocities(scenario, guide)[None],
            np.ones((1, scenario.n), bool),
        )
        for name in ("leader", "constrained"):

            def build_and_solve(name=name, variant=variant, state=state) -> None:
                for built in (formation_nlp, formation_program):
                    built.cache_clear()  # so that nothing is compiled already
                decision = csw.make_policy(name, variant, guide, "ipopt").decide(0, *state)
                assert not decision.failures.any()

            took = timed(build_and_solve, REPEATS).wall
            rows.append((f"formation, n = 50, {name}{kind}: build and solve", f"{took:.2f} s", ""))
    return rows


def rates() -> list[Row]:
    """Rates and their gradient for 1000 members, as expressions and as numbers."""
    import casadi as ca
    import numpy as np

    import casswarm as csw

    hazard = csw.SaturationCollision(radars=((4.4, 4.6), (4.5, 3.0)))
    n = 1000
    positions = np.random.default_rng(0).uniform(0, 10, (n, 2))
    functions = []

    def build() -> None:
        x, alive = ca.MX.sym("x", 2, n), ca.MX.sym("alive", 1, n)
        total = ca.sum2(hazard.expression(x, alive))
        functions.append(ca.Function("f", [x, alive], [total, ca.gradient(total, x)]))

    built = timed(build, REPEATS).wall
    evaluated = timed(lambda: functions[-1](positions.T, np.ones((1, n))), REPEATS).wall
    numeric = timed(lambda: hazard.rates(positions), REPEATS).wall
    return [
        ("rates and gradient, n = 1000: build", f"{built:.2f} s", ""),
        ("rates and gradient, n = 1000: evaluate", f"{1e3 * evaluated:.0f} ms", ""),
        ("rates, n = 1000: evaluate in NumPy", f"{1e3 * numeric:.0f} ms", ""),
    ]


PARTS = {part.__name__: part for part in (plan, simulate, formation, rates)}


def main() -> None:
    """Measure the chosen parts, or all."""
    chosen = arguments(__doc__, PARTS).parts
    print_table(("item", "median", "ratio"), (row for name in chosen for row in PARTS[name]()))


if __name__ == "__main__":
    main()
