"""Certified gaps against time, local searches against the bound, and scale.

Run with the installed package::

    python benchmarks/certificate.py                # all tables but the last: some minutes
    python benchmarks/certificate.py long           # the gap after 60 seconds each: half an hour
    python benchmarks/certificate.py --quick        # every table, on few cases
    python benchmarks/certificate.py gaps scale     # some tables

Prints Markdown tables. The random geometries are seeded; machines differ. Times are wall-clock and,
in parentheses, CPU times.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import numpy as np
from _timing import Timed, arguments, print_table, timed

import casswarm as csw
from casswarm import Guide, Scenario
from casswarm.bounds import Certificate
from casswarm.guide import certify_guide

SEEDS = 24


def scenario_of(radars: np.ndarray, target: tuple[float, float], **values: object) -> Scenario:
    """One agent from the origin, Table I's numbers, no acceleration limit."""
    data: dict[str, Any] = {
        "name": "random",
        "swarm": {"positions": [(0.0, 0.0)], "v_max": 2.0, "a_max": 0.5},
        "target": {"center": target, "radius": 0.5},
        "time": {"dt": 0.33, "t_f": 10.0},
        "hazard": {
            "kind": "saturation",
            "radars": radars,
            "alpha_1": 4.0,
            "alpha_2": 3.0,
            "alpha_3": 4.0,
        },
        "guide": {"acceleration_limited": False},
    }
    for key, value in values.items():
        table, _, name = key.partition(".")
        data[table][name] = value
    return Scenario.from_data(data)


def random_geometry(seed: int) -> Scenario:
    """Two to six radars around the diagonal to (10, 10); every fourth is symmetric about it."""
    rng = np.random.default_rng(seed)
    count = int(rng.integers(2, 7))
    radars = rng.uniform(0.5, 9.5, (count, 2))
    if seed % 4 == 0:  # mirrored at the diagonal, the odd one on it
        half = radars[: count // 2]
        middle = [[radars[-1].mean()] * 2] if count % 2 else np.empty((0, 2))
        radars = np.vstack([half, half[:, ::-1], middle])
    return scenario_of(radars, (10.0, 10.0))


def cases(quick: bool) -> dict[str, Scenario]:
    """Random and built-in scenarios, without acceleration limits and margin."""
    free = {"guide.acceleration_limited": False, "guide.search": "global", "guide.arrival": "any"}
    scenarios = {f"seed {seed}": random_geometry(seed) for seed in range(3 if quick else SEEDS)}
    for name, scenario in known(quick).items():
        values = free | {"guide.margin": 1e-6 * scenario.target.radius}
        scenarios[name] = scenario.with_values(values)
    return scenarios


def known(quick: bool) -> dict[str, Scenario]:
    """Built-in scenarios whose hazard is known."""
    names = list(csw.builtin_scenarios())[: 2 if quick else None]
    scenarios = {name: csw.load_scenario(name) for name in names}
    return {name: each for name, each in scenarios.items() if len(each.cases) == 1}


def planned(
    scenario: Scenario, solver: str = "ipopt", **options: object
) -> tuple[Guide, Timed[Guide]]:
    """A guide and its planning time, including the first build of its program."""
    run = timed(lambda: csw.plan(scenario, solver, **options))  # type: ignore[arg-type]
    return run.result, run


def gaps(quick: bool) -> None:
    """Gap and time, planning included, for two requested gaps."""
    planned(random_geometry(999))  # loads and builds what is shared
    rows, met = [], {0.01: 0, 0.001: 0}
    for name, scenario in cases(quick).items():
        row = [name, str(len(scenario.hazard.radar_positions))]
        for requested, limit in ((0.01, 2.0), (0.001, 10.0)):
            guide, took = planned(scenario, gap=requested)
            assert guide.gap is not None
            met[requested] += guide.gap <= requested and took.wall <= limit
            row += [f"{100 * guide.gap:.4f} %", str(took)]
        rows.append([*row[:2], f"{guide.risk:.4f}", *row[2:]])
    print_table(
        ["case", "radars", "risk", "gap, 1 % requested", "time", "gap, 0.1 % requested", "time"],
        rows,
    )
    print(
        f"{met[0.01]} of {len(rows)} within 1 % in 2 s, "
        f"{met[0.001]} of {len(rows)} within 0.1 % in 10 s\n"
    )


def long(quick: bool) -> None:
    """The best gap after 60 seconds."""
    rows = []
    for name, scenario in cases(quick).items():
        guide, took = planned(scenario, gap=1e-9, time_limit=5.0 if quick else 60.0)
        proof = guide.certificate
        assert proof is not None
        nodes = max(level.nodes for level in proof.levels)
        rows.append([name, f"{guide.gap:.1e}", str(took), f"{nodes:,}", proof.reason])
        print(rows[-1], file=sys.stderr, flush=True)
    print_table(["case", "gap", "time", "maximum nodes", "reason"], rows)


def baselines(quick: bool) -> None:
    """Ipopt from the straight line, and the paper's projected gradient, against the bound."""
    rows, worse, factors = [], np.zeros(2, int), ([], [])  # type: ignore[var-annotated]
    for name, scenario in cases(quick).items():
        best, _ = planned(scenario, gap=1e-4)
        row = [name, f"{best.risk:.4f}", f"{best.risk_bound:.4f}"]
        for column, (solver, search) in enumerate(
            (("ipopt", "local"), ("projected-gradient", "local"))
        ):
            guide, _ = planned(scenario, solver, search=search, certify=False, check=False)
            factor = guide.risk / best.risk if guide.arrives else np.inf
            worse[column] += factor > 1.01
            factors[column].append(factor)
            row.append(f"{guide.risk:.4f}" if guide.arrives else "does not arrive")
        rows.append(row)
    print_table(["case", "global", "bound", "Ipopt, straight line", "projected gradient"], rows)
    for name, count, ratios in zip(("Ipopt", "projected gradient"), worse, factors, strict=True):
        print(
            f"{name}: more than 1 % worse in {count} of {len(rows)}; risk times "
            f"{np.median(ratios):.2f} in the median, {np.max(ratios):.1f} at worst"
        )
    print()


def acceleration_limited(quick: bool) -> None:
    """Gaps with limits of acceleration and margin, for the built-in scenarios as global searches.

    The guide is planned once without a certificate, so that the times are those of the proofs.
    """
    proven_guide(csw.load_scenario("gauntlet"), 0.01)  # loads and compiles what is shared
    rows = []
    for name, own in known(quick).items():
        scenario = own.with_values({"guide.search": "global", "guide.arrival": "any"})
        row: list[str] = []
        for gap in (0.005, 0.001):
            guide, certificate, took = proven_guide(scenario, gap)
            if not row:
                without = 1 - certificate.bound / guide.risk
                row = [name, f"{guide.risk:.4f}", f"{100 * without:.2f} %"]
            reached = 1 - certificate.risk_bound / guide.risk
            proof = certificate.accelerated
            regions = "" if proof is None else str(proof.regions)
            row += [f"{certificate.risk_bound:.4f}", f"{100 * reached:.3f} %", regions, str(took)]
        rows.append(row)
    columns = ["bound", "gap", "regions", "time"]
    print_table(["case", "risk", "gap without a_max", *columns, *columns], rows)


def proven_guide(
    scenario: Scenario, gap: float, time_limit: float = 60.0
) -> tuple[Guide, Certificate, Timed[Any]]:
    """A guide, its certificate, and the time of the proof."""
    guide = csw.plan(scenario, certify=False)
    deadline = time.monotonic() + time_limit
    run = timed(lambda: certify_guide(scenario, guide, gap, deadline))
    assert run.result is not None
    return guide, run.result, run


def sizes(quick: bool) -> Iterator[tuple[str, Scenario]]:
    """Horizons, by finer steps and by more time; radars; extents, in lengths of a step."""
    radars = np.array([[3.0, 4.0], [7.0, 6.0]])
    for steps in (30, 300) if quick else (30, 100, 300, 1000, 3000):
        fine = {"time.dt": 9.9 / steps, "time.t_f": 9.9 * (1 + 1e-9)}
        yield f"{steps} steps in the same time", scenario_of(radars, (10.0, 10.0), **fine)
    for steps in (300,) if quick else (100, 300, 1000, 3000):
        late = {"time.t_f": 0.33 * steps * (1 + 1e-9)}
        yield f"{steps} steps in more time", scenario_of(radars, (10.0, 10.0), **late)
    for count in (2, 20) if quick else (2, 20, 200):
        rng = np.random.default_rng(count)
        points = rng.uniform(-5, 15, (4 * count, 2))
        clear = (np.hypot(*points.T) > 1) & (np.hypot(*(points - 10).T) > 1)
        yield f"{count} radars", scenario_of(points[clear][:count], (10.0, 10.0))
    for scale in (0.3,) if quick else (0.1, 0.3, 3.0, 10.0):
        far = {"time.t_f": 9.9 * max(scale, 0.2) * (1 + 1e-9)}
        target = (10 * scale, 10 * scale)
        yield f"map {scale:g} times as wide", scenario_of(scale * radars, target, **far)


def sized(scenario: Scenario) -> list[str]:
    """A row of the table of sizes, from a separate process whose memory is measured."""
    planned(random_geometry(999), certify=False)
    guide, took = planned(scenario)
    proof = guide.certificate
    assert proof is not None
    status = Path("/proc/self/status").read_text().splitlines()  # without the parent's peak
    memory = next(int(line.split()[1]) for line in status if line.startswith("VmHWM")) / 1024
    return [
        str(scenario.n_steps),
        str(len(scenario.hazard.radar_positions)),
        str(took),
        f"{proof.seconds:.2f} s",
        f"{100 * (guide.gap or 0):.2f} %",
        f"{max(level.nodes for level in proof.levels):,}",
        f"{memory:.0f} MB",
        proof.reason,
    ]


def scale(quick: bool) -> None:
    """Planning time and memory against the horizon, the radars and the extent of the map."""
    head = ["case", "steps", "radars", "time", "proof", "gap", "nodes", "memory", "reason"]
    rows = []
    with ProcessPoolExecutor(1, get_context("spawn"), max_tasks_per_child=1) as fresh:
        for name, scenario in sizes(quick):
            rows.append([name, *fresh.submit(sized, scenario).result()])
            print(rows[-1], file=sys.stderr, flush=True)
    print_table(head, rows)


TABLES = {
    "gaps": gaps,
    "baselines": baselines,
    "acceleration_limited": acceleration_limited,
    "scale": scale,
    "long": long,
}

if __name__ == "__main__":
    asked = arguments(__doc__, TABLES)
    for name in asked.parts:
        if name != "long" or len(asked.parts) < len(TABLES):  # half an hour: only on demand
            TABLES[name](asked.quick)
