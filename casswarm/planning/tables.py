"""Tables of guides and joint plans."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import pandas as pd

from ..typing import FloatArray
from .guide import Guide
from .joint.plan import SwarmPlan


def guide_table(guide: Guide) -> pd.DataFrame:
    """Trajectory of a guide, a row per step t = 0..T, with risk and survival so far.

    The last velocity is missing because the guide ends on arrival, and the first rate because the
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
    """Candidates of a guide, a row per solve: homotopy signature, risk, and solver status."""
    return pd.DataFrame([candidate.as_row() for candidate in guide.candidates])


def path_table(kinds: Mapping[str, Mapping[str, FloatArray]]) -> pd.DataFrame:
    """Paths, a row per step of each: kind, name, step, x, y.

    Parameters
    ----------
    kinds : mapping of kind to mapping of name to path (T+1, 2)
    """
    rows = [
        {"kind": kind, "name": name, "step": step, "x": x, "y": y}
        for kind, paths in kinds.items()
        for name, path in paths.items()
        for step, (x, y) in enumerate(path)
    ]
    return pd.DataFrame(rows, columns=["kind", "name", "step", "x", "y"])


def guide_comparison_table(guides: Mapping[str, Guide]) -> pd.DataFrame:
    """Guides by name, a row each: risk, survival, arrival step, bounds, gap, solves and seconds."""
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


def joint_table(plan: SwarmPlan) -> pd.DataFrame:
    """Trajectories of a joint plan, a row per step t = 0..T and member, with survival so far.

    V(T) is missing. Survival is the probability that the member is alive at step t or was when its
    run ended; it is missing for swarms without an exact distribution.
    """
    steps, n = plan.steps, plan.n
    velocities = np.concatenate([plan.velocities, np.full((1, n, 2), np.nan)])
    distribution = plan.distribution
    survival = np.full((steps + 1, n), np.nan) if distribution is None else distribution.survival
    return pd.DataFrame(
        {
            "step": np.repeat(np.arange(steps + 1), n),
            "member": np.tile(np.arange(n), steps + 1),
            "x": plan.positions[..., 0].ravel(),
            "y": plan.positions[..., 1].ravel(),
            "vx": velocities[..., 0].ravel(),
            "vy": velocities[..., 1].ravel(),
            "survival": survival.ravel(),
        }
    )


def outcome_table(plan: SwarmPlan) -> pd.DataFrame:
    """Outcomes of a joint plan's search, a row per start: value, arrivals, and solver status."""
    return pd.DataFrame(
        outcome.as_row() | {"seconds": outcome.seconds} for outcome in plan.outcomes
    )
