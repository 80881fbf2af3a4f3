"""How the chain scales: growth of sampling with runs and members, and sweeps on processes."""

from __future__ import annotations

import multiprocessing
import sys
import tempfile
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from _timing import timed

import casswarm as csw
from casswarm.scenario.variations import with_parameters

Rows = list[dict[str, Any]]


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

    from casswarm._util.figure_style import MEMBERS, despine
    from casswarm.figures import save

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
                "same table": results[workers].table.equals(results[1].table),
            }
        )
    return rows
