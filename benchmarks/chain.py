"""Performance of the chain: exact distributions, runs, equal states, Monte Carlo, growth, sweeps.

Run with the installed package::

    python benchmarks/chain.py              # all, about ten minutes on two cores
    python benchmarks/chain.py distributions sweep   # some parts
    python benchmarks/chain.py --quick      # fewer runs, repeats and points

Prints Markdown tables and writes them as CSV, and the figure of growth, to ``results/chain`` of the
current folder (or ``--out``). Compiled code is cached on disk before anything is timed. Machines
are shared, so CPU times are given beside wall-clock times, and ratios are of one run.
"""

from __future__ import annotations

import math
import multiprocessing
import sys
import tempfile
from concurrent.futures import ProcessPoolExecutor
from itertools import product
from pathlib import Path
from typing import Any
from unittest import mock

import numpy as np
import pandas as pd
from _timing import arguments, print_table, timed

import casswarm as csw
from casswarm.chain import monte_carlo as sampling
from casswarm.chain.confidence import effective_runs, stratified_interval, wilson
from casswarm.scenario.variations import with_parameters
from casswarm.studies.simulation import PAPER_POLICIES

Rows = list[dict[str, Any]]
Z = 1.959964  # the 97.5 % quantile of the normal distribution


def distributions(quick: bool) -> Rows:
    """Exact distributions: paper-1 to 1e-4, paper-2 to 1e-3; without aggregation, and at 1e-8."""
    rows = []
    for name, tolerance, goal in (("paper-1", 1e-4, "3 s in all"), ("paper-2", 1e-3, "60 s each")):
        scenario = csw.load_scenario(name)
        guide = csw.plan(scenario, certify=False)
        for aggregation_tol in (0.0, 1e-8):
            whole = np.zeros(2)
            for policy in PAPER_POLICIES:
                options: dict[str, Any] = {"guide": guide, "aggregation_tol": aggregation_tol}
                csw.evaluate(scenario, policy, 0.1, **options)
                distribution, wall, cpu = timed(
                    lambda p=policy, s=scenario, o=options, t=tolerance: csw.evaluate(s, p, t, **o),
                    1 if quick else 3,
                )
                whole += wall, cpu
                low, high = distribution.success
                rows.append(
                    {
                        "scenario": name,
                        "aggregation_tol": aggregation_tol,
                        "policy": policy,
                        "low": low,
                        "high": high,
                        "width": high - low,
                        "states": distribution.states,
                        "seconds": wall,
                        "processor": cpu,
                        "goal": goal,
                    }
                )
            rows.append(
                rows[-1]
                | {"policy": "all three", "seconds": whole[0], "processor": whole[1]}
                | dict.fromkeys(("low", "high", "width", "states"), math.nan)
            )
    return rows


def runs(quick: bool) -> Rows:
    """Three policies on paper-1: 10,000 runs, and 1,000,000, on one process and on two."""
    scenario = csw.load_scenario("paper-1")
    csw.simulate(scenario, runs=100)
    rows = []
    for number, workers, goal in (
        (10_000, 1, "5 s"),
        (100_000 if quick else 1_000_000, 1, "120 s"),
        (100_000 if quick else 1_000_000, 2, "120 s"),
    ):
        study, wall, cpu = timed(
            lambda r=number, w=workers: csw.simulate(scenario, runs=r, workers=w)
        )
        rows.append(
            {
                "runs": number,
                "workers": workers,
                "seconds": wall,
                "processor": cpu,
                "goal": goal,
                "states": int(study.effort["states"].sum()),
            }
            | dict(zip(study.summary["policy"], study.summary["success"], strict=True))
        )
    return rows


def every_state(*arrays: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """As the functions of distinct states would answer if no two were equal."""
    rows = np.arange(len(arrays[0]))
    return rows, rows


def equal(quick: bool) -> Rows:
    """Whether it pays to solve equal states once, in sampling: runs with and without, in turn."""
    number, rows = 2_000 if quick else 20_000, []
    for name in ("paper-1", "paper-2"):
        scenario = csw.load_scenario(name)
        guide = csw.plan(scenario, certify=False)
        for policy in PAPER_POLICIES:

            def sample(policy: str = policy, s: Any = scenario, g: Any = guide) -> csw.Study:
                return csw.simulate(s, [policy], number, guide=g, save_trajectories=0)

            sample()
            once, wall, cpu = timed(sample, 3)
            names = ("distinct_states", "distinct_survivors")
            with mock.patch.multiple(sampling, **dict.fromkeys(names, every_state)):
                each, wall_each, cpu_each = timed(sample)
            same = (once.runs["success"] == each.runs["success"]).mean()
            rows.append(
                {
                    "scenario": name,
                    "policy": policy,
                    "runs": number,
                    "states once": int(once.effort["states"][0]),
                    "states each": int(each.effort["states"][0]),
                    "seconds once": wall,
                    "seconds each": wall_each,
                    "processor ratio": cpu_each / cpu,
                    "runs that agree": same,
                }
            )
    return rows


def versus(quick: bool) -> Rows:
    """Time to the same width: exact evaluation and plain Monte Carlo, extrapolated in its runs."""
    number, rows = 10_000 if quick else 100_000, []
    for name, tolerances in (("paper-1", (1e-3, 1e-4)), ("paper-2", (1e-2, 1e-3))):
        scenario = csw.load_scenario(name)
        guide = csw.plan(scenario, certify=False)
        for policy in PAPER_POLICIES:
            _, _, plain = timed(
                lambda p=policy, s=scenario, g=guide: csw.simulate(
                    s, [p], number, guide=g, save_trajectories=0
                )
            )
            for tolerance in tolerances:
                distribution, _, cpu = timed(
                    lambda p=policy, s=scenario, g=guide, t=tolerance: csw.evaluate(
                        s, p, t, guide=g
                    )
                )
                width = distribution.success[1] - distribution.success[0]
                p = sum(distribution.success) / 2
                needed = 4 * Z**2 * p * (1 - p) / width**2
                rows.append(
                    {
                        "scenario": name,
                        "policy": policy,
                        "width": width,
                        "exact, processor": cpu,
                        "runs needed": needed,
                        "runs, processor": needed * plain / number,
                        "ratio": needed * plain / number / cpu,
                    }
                )
    return rows


def estimates(quick: bool) -> Rows:
    """Estimates against plain sampling: widths at the same number of solved states."""
    numbers, rows = (100, 500) if quick else (100, 1000, 5000), []
    seeds, swarm = range(3 if quick else 7), csw.load_scenario("large-swarm")
    small = [(csw.load_scenario(n), p) for n in ("paper-1", "paper-2") for p in PAPER_POLICIES[1:]]
    cases = [(*case, number) for case in small for number in numbers]
    cases += [(with_parameters(swarm, {"n": n}), "leader", numbers[1]) for n in (10, 50)]
    for scenario, policy, runs in cases:
        guide = csw.plan(scenario, certify=False)
        results = [
            csw.estimate(scenario, policy, runs, seed, tolerance=1e-4, guide=guide)
            for seed in seeds
        ]
        states = float(np.median([result.states for result in results]))
        more, solved = runs, 0
        while solved < states and more < 60 * numbers[-1]:
            plain = csw.simulate(scenario, [policy], more, guide=guide, save_trajectories=0)
            solved, done = int(plain.effort["states"][0]), more
            more = math.ceil(more * max(1.05, states / solved))
        others = [
            csw.simulate(
                scenario, [policy], done, seed, guide=guide, save_trajectories=0
            ).summary.iloc[0]
            for seed in seeds
        ]
        own = float(np.median([result.success.width for result in results]))
        wide = float(np.median([row.success_high - row.success_low for row in others]))
        width = wide * math.sqrt(solved / states)  # of exactly as many states
        rows.append(
            {
                "scenario": scenario.name,
                "n": scenario.n,
                "policy": policy,
                "runs": runs,
                "sampled mass": results[0].sampled_mass,
                "states": states,
                "width": own,
                "plain runs": done,
                "plain states": solved,
                "plain width": width,
                "ratio": width / own,
            }
        )
    return rows


def coverage(quick: bool) -> Rows:
    """Coverage of 95 % intervals from one run of each of R strata, before and after the fallback.

    The strata's probabilities are equal, rise linearly, or are 0 and 1/2; q is their mean. `wilson`
    is Wilson's interval with the effective runs; `coverage` is that of `stratified_interval`, and
    `width` its mean width relative to the former's. 2000 repetitions (200).
    """
    repetitions, rng, rows = 200 if quick else 2000, np.random.default_rng(1), []
    kinds = {
        "equal": np.full_like,
        "linear": lambda u, q: 2 * q * u,
        "half": lambda u, q: np.where(u > 1 - 2 * q, 0.5, 0.0),
    }
    for number, kind, q in product((50, 100), kinds, (0.005, 0.01, 0.02, 0.05, 0.1, 0.3)):
        chances = kinds[kind]((np.arange(number) + 0.5) / number, q)
        ends = np.empty((repetitions, 4))
        for row, outcomes in zip(ends, rng.random((repetitions, number)) < chances, strict=True):
            effective, successes = effective_runs(outcomes), int(outcomes.sum())
            row[:2] = wilson(successes / number * effective, effective)
            row[2:] = stratified_interval(successes, number, effective)
        covered = (ends[:, ::2] <= chances.mean()) & (chances.mean() <= ends[:, 1::2])
        widths = (ends[:, 1::2] - ends[:, ::2]).mean(axis=0)
        rows.append({"R": number, "strata": kind, "q": q, "wilson": covered[:, 0].mean()})
        rows[-1] |= {"coverage": covered[:, 1].mean(), "width": widths[1] / widths[0]}
    return rows


def measured(n: int, number: int) -> dict[str, Any]:
    """Growth's point, in a process of its own: seconds, states, and the peak of memory."""
    import resource

    scenario = with_parameters(csw.load_scenario("paper-1"), {"n": n})
    guide = csw.plan(scenario, certify=False)
    csw.simulate(scenario, ["leader"], 2, guide=guide)
    study, wall, cpu = timed(
        lambda: csw.simulate(scenario, ["leader"], number, guide=guide, save_trajectories=0)
    )
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return {
        "n": n,
        "runs": number,
        "seconds": wall,
        "processor": cpu,
        "microseconds a run": 1e6 * cpu / number,
        "states": int(study.effort["states"][0]),
        "peak MiB": peak / (1 << (20 if sys.platform == "darwin" else 10)),
    }


def growth(quick: bool) -> Rows:
    """Leader protection on paper-1 with more runs, and with more members (on a lattice)."""
    points = [(5, 10**k) for k in range(3, 6 if quick else 7)]
    points += [(n, 300 if quick else 3000) for n in (2, 5, 10, 20, 50)]
    rows = []
    for point in points:
        with ProcessPoolExecutor(1, multiprocessing.get_context("spawn")) as pool:
            rows.append(pool.submit(measured, *point).result())
    return rows


def growth_chart(table: pd.DataFrame, path: Path) -> None:
    """Time over runs and over members."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    from casswarm.figures import save
    from casswarm.figures.style import MEMBERS, despine

    fig = Figure(figsize=(8.4, 3.6), layout="constrained")
    FigureCanvasAgg(fig)
    left, right = fig.subplots(1, 2)
    fewest = table["runs"].iloc[-1]
    for axes, rows, key in (
        (left, table[(table["n"] == 5) & (table["runs"] != fewest)], "runs"),
        (right, table[table["runs"] == fewest], "n"),
    ):
        axes.loglog(rows[key], rows["processor"], "o-", color=MEMBERS[0])
        axes.set_xlabel("runs (n = 5)" if key == "runs" else f"members n ({fewest:,} runs)")
        axes.set_ylabel("processor time, s")
        for row in rows.to_dict("records"):
            axes.annotate(
                f"{row['peak MiB']:.0f} MiB",
                (row[key], row["processor"]),
                (0, 7),
                textcoords="offset points",
                ha="center",
                fontsize=8,
            )
        axes.margins(0.15)
        despine(axes)
    right.set_xticks([2, 5, 10, 20, 50], ["2", "5", "10", "20", "50"])
    right.minorticks_off()
    fig.suptitle("leader protection on paper-1: time, and peak of memory", fontsize=11)
    save(fig, path)


def sweep(quick: bool) -> Rows:
    """100 points of 50,000 runs (20 of 2,000) on one process and on two; equality of the tables."""
    side, number = (5, 2_000) if quick else (10, 50_000)
    scenario = csw.load_scenario("paper-1")
    grid = {
        "formation.rho": np.linspace(0.02, 0.2, side if not quick else 4).round(4).tolist(),
        "hazard.alpha_2": np.linspace(1.0, 9.0, side).round(4).tolist(),
    }
    results, rows = {}, []
    csw.simulate(scenario, ["constrained"], 100)
    for workers in (1, 2):
        with tempfile.TemporaryDirectory() as folder:
            results[workers], wall, cpu = timed(
                lambda w=workers, f=folder: csw.sweep(
                    scenario, grid, ["constrained"], runs=number, workers=w, checkpoint=Path(f)
                )
            )
        rows.append(
            {
                "workers": workers,
                "points": len(results[workers].table),
                "seconds": wall,
                "processor": cpu,
                "seconds of points": results[workers].effort["seconds"].sum(),
                "ratio": rows[0]["seconds"] / wall if rows else 1.0,
                "goal": "1.7 x",
                "same table": results[workers].table.equals(results[1].table),
            }
        )
    return rows


PARTS = {
    part.__name__: part
    for part in (distributions, runs, equal, versus, estimates, coverage, growth, sweep)
}


def main() -> None:
    """Print the tables, and write them to --out."""
    options = arguments(__doc__, PARTS, out="results/chain")
    options.out.mkdir(parents=True, exist_ok=True)
    for name in options.parts:
        table = pd.DataFrame(PARTS[name](options.quick))
        table.to_csv(options.out / f"{name}.csv", index=False)
        print(f"\n{PARTS[name].__doc__}\n")
        print_table(list(table.columns), table.itertuples(index=False))
        if name == "growth":
            growth_chart(table, options.out / "growth.png")


if __name__ == "__main__":
    main()
