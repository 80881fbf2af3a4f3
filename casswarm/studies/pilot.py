"""How many runs a study needs, from a pilot."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from ..chain.confidence import required_runs
from ..optimization.solvers import Solver
from ..planning.guide import Guide
from .simulation import PAPER_POLICIES, simulate

if TYPE_CHECKING:
    from ..scenario import Scenario

PILOT = 1000
"""Runs of the pilot."""

_PILOT_SEED = 1 << 40  # far from the seeds that people choose


def runs_needed(
    scenario: Scenario,
    policies: Sequence[Any] = PAPER_POLICIES,
    half_width: float = 0.005,
    seed: int = 0,
    *,
    pilot: int = PILOT,
    guide: Guide | None = None,
    solver: str | Solver = "auto",
) -> int:
    """Runs after which the 95 % interval of every policy is about +- `half_width`, from a pilot.

    The pilot's random numbers are not those of a study with the same seed.

    Parameters
    ----------
    scenario, policies, seed, guide, solver
        As in `simulate`.
    half_width : float
        Between 0 and 1/2.
    pilot : int
        Runs of the pilot.

    Raises
    ------
    ValueError
        A half-width that is not between 0 and 1/2; and as `simulate`.
    """
    if not 0 < half_width < 0.5:
        raise ValueError(f"half_width = {half_width}; allowed: between 0 and 0.5")
    tried = simulate(
        scenario,
        policies,
        pilot,
        seed + _PILOT_SEED,
        guide=guide,
        solver=solver,
        save_trajectories=0,
    )
    return max(required_runs(half_width, int(won), pilot) for won in tried.summary["successes"])
