"""What the certificate promises, measured: gaps against time, local searches, and scale.

Run with the installed package::

    python benchmarks/certificate.py                # gaps and rivals, about a minute
    python benchmarks/certificate.py scale          # horizons and radars
    python benchmarks/certificate.py long           # the gap after 60 seconds each, half an hour

Prints Markdown tables. The random geometries are seeded; machines differ.
"""

from __future__ import annotations

import sys
import time

import numpy as np

import casswarm as cs
from casswarm import Guide, Scenario

SEEDS = 24


def scenario_of(radars: np.ndarray, target: tuple[float, float], **values: object) -> Scenario:
    """One agent from the origin, Table I's numbers, no limit of acceleration."""
    data = {
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
        "guide": {"flyable": False},
    }
    return Scenario.from_data(data).with_values(values)


def random_geometry(seed: int) -> Scenario:
    """Two to six radars around the way to (10, 10); every fourth is symmetric about it."""
    rng = np.random.default_rng(seed)
    count = int(rng.integers(2, 7))
    radars = rng.uniform(0.5, 9.5, (count, 2))
    if seed % 4 == 0:  # mirrored at the diagonal, the odd one on it
        half = radars[: count // 2]
        middle = [[radars[-1].mean()] * 2] if count % 2 else np.empty((0, 2))
        radars = np.vstack([half, half[:, ::-1], middle])
    return scenario_of(radars, (10.0, 10.0))


def cases() -> dict[str, Scenario]:
    """All that is certified without limits of acceleration and margin: random and built in."""
    free = {"guide.flyable": False, "guide.search": "global", "guide.arrival": "any"}
    found = {f"seed {seed}": random_geometry(seed) for seed in range(SEEDS)}
    for name in cs.builtin_scenarios():
        scenario = cs.load_scenario(name)
        found[name] = scenario.with_values(free | {"guide.margin": 1e-6 * scenario.target.radius})
    return found


def timed(scenario: Scenario, solver: str = "ipopt", **options: object) -> tuple[Guide, float]:
    """A guide and the seconds that it took, the first build of its program included."""
    started = time.perf_counter()
    guide = cs.plan(scenario, solver, **options)  # type: ignore[arg-type]
    return guide, time.perf_counter() - started


def table(head: list[str], rows: list[list[str]]) -> None:
    print("| " + " | ".join(head) + " |\n|" + " --- |" * len(head))
    print("\n".join("| " + " | ".join(row) + " |" for row in rows) + "\n", flush=True)


def gaps() -> None:
    """Gap and time, planning included, at two gaps asked for."""
    timed(random_geometry(999))  # what is loaded once
    rows, met = [], {0.01: 0, 0.001: 0}
    for name, scenario in cases().items():
        row = [name, str(len(scenario.hazard.radar_positions))]
        for asked, limit in ((0.01, 2.0), (0.001, 10.0)):
            guide, took = timed(scenario, gap=asked)
            assert guide.gap is not None
            met[asked] += guide.gap <= asked and took <= limit
            row += [f"{100 * guide.gap:.4f} %", f"{took:.2f} s"]
        rows.append([*row[:2], f"{guide.risk:.4f}", *row[2:]])
    table(["case", "radars", "risk", "gap, 1 % asked", "time", "gap, 0.1 % asked", "time"], rows)
    print(
        f"{met[0.01]} of {len(rows)} within 1 % in 2 s, "
        f"{met[0.001]} of {len(rows)} within 0.1 % in 10 s\n"
    )


def long() -> None:
    """The best gap after 60 seconds."""
    rows = []
    for name, scenario in cases().items():
        guide, took = timed(scenario, gap=1e-9, time_limit=60.0)
        assert guide.certificate is not None
        rows.append([name, f"{guide.gap:.2e}", f"{took:.1f} s", guide.certificate.reason])
        table(["case", "gap", "time", "end"], rows[-1:])


def rivals() -> None:
    """Ipopt from the straight line, and the paper's projected gradient, against the bound."""
    rows, worse, factors = [], np.zeros(2, int), ([], [])  # type: ignore[var-annotated]
    for name, scenario in cases().items():
        best, _ = timed(scenario, gap=1e-4)
        row = [name, f"{best.risk:.4f}", f"{best.risk_bound:.4f}"]
        for place, (solver, search) in enumerate(
            (("ipopt", "local"), ("projected-gradient", "local"))
        ):
            guide, _ = timed(scenario, solver, search=search, certify=False, check=False)
            factor = guide.risk / best.risk if guide.arrives else np.inf
            worse[place] += factor > 1.01
            factors[place].append(factor)
            row.append(f"{guide.risk:.4f}" if guide.arrives else "does not arrive")
        rows.append(row)
    table(["case", "global", "bound", "Ipopt, straight line", "projected gradient"], rows)
    for name, count, found in zip(("Ipopt", "projected gradient"), worse, factors, strict=True):
        print(
            f"{name}: more than 1 % worse in {count} of {len(rows)}; risk times "
            f"{np.median(found):.2f} in the median, {np.max(found):.1f} at worst"
        )
    print()


def flyable() -> None:
    """What the limit of acceleration and the margin explain of the gap, on the built-in cases."""
    rows = []
    for name in cs.builtin_scenarios():
        values = {"guide.search": "global", "guide.arrival": "any"}
        guide, took = timed(cs.load_scenario(name).with_values(values), gap=0.001)
        proof = guide.certificate
        assert proof is not None
        assert guide.gap is not None
        explained = (guide.risk - proof.best) / guide.risk
        rows.append(
            [
                name,
                f"{guide.risk:.4f}",
                f"{guide.risk_bound:.4f}",
                f"{100 * guide.gap:.2f} %",
                f"{100 * explained:.2f} %",
                f"{100 * (guide.gap - explained):.3f} %",
                f"{took:.2f} s",
            ]
        )
    table(["case", "risk", "bound", "gap", "of it limits", "of it the proof's", "time"], rows)


def scale() -> None:
    """Planning time against the horizon, by finer steps and by more of them, and the radars."""
    rows = []
    radars = np.array([[3.0, 4.0], [7.0, 6.0]])
    for steps in (30, 300, 3000):
        for kind, values in (
            ("finer steps", {"time.dt": 9.9 / steps, "time.t_f": 9.9 * (1 + 1e-9)}),
            ("longer time", {"time.t_f": 0.33 * steps * (1 + 1e-9)}),
        ):
            scenario = scenario_of(radars, (10.0, 10.0), **values)
            guide, took = timed(scenario)
            assert guide.certificate is not None
            rows.append(
                [
                    kind,
                    str(scenario.n_steps),
                    "2",
                    f"{took:.2f} s",
                    f"{guide.certificate.seconds:.2f} s",
                    f"{100 * (guide.gap or 0):.2f} %",
                    guide.certificate.reason,
                ]
            )
            table(HEAD, rows[-1:])
    for count in (2, 20, 200):
        rng = np.random.default_rng(count)
        places = rng.uniform(-5, 15, (4 * count, 2))
        clear = (np.hypot(*places.T) > 1) & (np.hypot(*(places - 10).T) > 1)
        scenario = scenario_of(places[clear][:count], (10.0, 10.0))
        guide, took = timed(scenario)
        assert guide.certificate is not None
        proof = guide.certificate
        table(
            HEAD,
            [
                [
                    "more radars",
                    "30",
                    str(count),
                    f"{took:.2f} s",
                    f"{proof.seconds:.2f} s",
                    f"{100 * (guide.gap or 0):.2f} %",
                    proof.reason,
                ]
            ],
        )


HEAD = ["case", "steps", "radars", "time", "of it the proof", "gap", "end of the proof"]

if __name__ == "__main__":
    wanted = sys.argv[1:] or ["gaps", "rivals", "flyable"]
    for name in wanted:
        {"gaps": gaps, "rivals": rivals, "flyable": flyable, "scale": scale, "long": long}[name]()
