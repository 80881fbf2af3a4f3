"""Guides and laws as tables; studies make their own."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pandas as pd

from .chain.evaluate import Law
from .guide import Guide


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
