"""A guide as tables; studies make their own."""

from __future__ import annotations

import numpy as np
import pandas as pd

from .guide import Guide


def guide_table(guide: Guide) -> pd.DataFrame:
    """A row a step t = 0..T: step, x, y, vx, vy, speed, rate, risk and survival so far.

    V(T) is missing: the guide ends on arrival. The rate is that at X(t), zero at the start, whose
    rate costs nothing: risk is sum over t = 1..T of dt rate.
    """
    velocities = np.vstack([guide.velocities, np.full((1, 2), np.nan)])
    rates = np.concatenate([[0.0], guide.rates])
    risk = guide.dt * np.cumsum(rates)
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
