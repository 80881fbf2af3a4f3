"""Guides, laws and runs as tables."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
import pandas as pd

from .chain.evaluate import Law
from .chain.simulate import Runs
from .guide import Guide
from .statistics import wilson


def guide_table(guide: Guide) -> pd.DataFrame:
    """A row a step t = 0..T: step, x, y, vx, vy, speed, rate, risk and survival so far.

    V(T) is missing: the guide ends on arrival. So is the rate at the start, which costs nothing:
    risk is the sum over t = 1..T of dt times the rate at X(t).
    """
    velocities = np.vstack([guide.velocities, np.full((1, 2), np.nan)])
    rates = np.concatenate([[np.nan], guide.rates])
    risk = guide.dt * np.cumsum(np.concatenate([[0.0], guide.rates]))
    return pd.DataFrame(
        {
            "step": np.arange(guide.arrival + 1),
            "x": guide.positions[:, 0],
            "y": guide.positions[:, 1],
            "vx": velocities[:, 0],
            "vy": velocities[:, 1],
            "speed": np.hypot(velocities[:, 0], velocities[:, 1]),
            "rate": rates,
            "risk": risk,
            "survival": np.exp(-risk),
        }
    )


def candidate_table(guide: Guide) -> pd.DataFrame:
    """A row a start and arrival step: sides of the radars, risk, and how the solve ended."""
    return pd.DataFrame([candidate.as_row() for candidate in guide.candidates])


def rival_table(guides: Mapping[str, Guide]) -> pd.DataFrame:
    """A row a guide: risk, survival, arrival step, the proven bound and the gap to it, seconds."""
    return pd.DataFrame(
        {
            "guide": name,
            "risk": guide.risk,
            "survival": guide.survival,
            "arrival": guide.arrival,
            "risk_bound": guide.risk_bound,
            "survival_bound": guide.survival_bound,
            "gap": guide.gap,
            "solves": len(guide.candidates),
            "seconds": sum(c.solution.solve_seconds for c in guide.candidates),
        }
        for name, guide in guides.items()
    )


def law_table(laws: Sequence[Law]) -> pd.DataFrame:
    """A row a law: policy, brackets of success and of the mean number of survivors, counts."""
    return pd.DataFrame(
        {
            "policy": law.policy,
            "success_low": law.success[0],
            "success_high": law.success[1],
            "survivors_mean_low": law.survivors_mean[0],
            "survivors_mean_high": law.survivors_mean[1],
            "unresolved": law.unresolved,
            "states": law.states,
            "shortfalls_mean": law.shortfalls,
            "solver_failures_mean": law.failures,
        }
        for law in laws
    )


def arrival_table(laws: Sequence[Law]) -> pd.DataFrame:
    """A row a step: the probability of the first arrival at it, a column a policy (low ends)."""
    steps = np.arange(len(laws[0].arrival))
    return pd.DataFrame({"step": steps} | {law.policy: law.arrival for law in laws})


def survivor_table(laws: Sequence[Law]) -> pd.DataFrame:
    """A row a number of survivors at the end: its probability, a column a policy (low ends)."""
    numbers = np.arange(len(laws[0].survivors))
    return pd.DataFrame({"survivors": numbers} | {law.policy: law.survivors for law in laws})


def run_table(name: str, part: Runs) -> pd.DataFrame:
    """A row a run of a policy; see `Study`."""
    arrived = part.arrival >= 0
    arrival = pd.array(np.where(arrived, part.arrival, 0), dtype="Int64")
    arrival[~arrived] = pd.NA
    return pd.DataFrame(
        {
            "policy": name,
            "run": part.first + np.arange(len(arrived)),
            "success": arrived,
            "survivors": part.survivors,
            "arrival_step": arrival,
            "steps": part.steps,
            "shortfalls": part.shortfalls,
            "solver_failures": part.solver_failures,
            "resolved": part.resolved,
            "clipped": part.clipped,
        }
    )


def summarise(runs: pd.DataFrame) -> pd.DataFrame:
    """A row a policy of a table with a row a run; see `Study`."""
    rows = []
    for name, table in runs.groupby("policy", sort=False):
        successes = int(table["success"].sum())
        low, high = wilson(successes, len(table))
        rows.append(
            {
                "policy": name,
                "runs": len(table),
                "successes": successes,
                "success": successes / len(table),
                "success_low": low,
                "success_high": high,
                "survivors_mean": float(table["survivors"].mean()),
                "arrival_step_mean": float(table["arrival_step"].astype("Float64").mean())
                if successes
                else float("nan"),
                "shortfalls": int(table["shortfalls"].sum()),
                "solver_failures": int(table["solver_failures"].sum()),
                "resolved": int(table["resolved"].sum()),
                "clipped": int(table["clipped"].sum()),
            }
        )
    return pd.DataFrame(rows)
