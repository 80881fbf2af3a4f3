"""Empty constraint sets of the paper's formation problems, and their cost in success."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pandas as pd

from ..chain.trajectories import RunTrajectory
from ..planning.guide import Guide
from ..planning.plan import initial_velocities, plan
from ..policies import make_policy
from ..scenario import Scenario
from ..studies.evaluation import evaluate
from ..studies.simulation import simulate
from .success import WIDTH, Report

POLICIES = ("constrained", "leader")


def infeasible_steps(
    scenario: Scenario, guide: Guide, runs: int = 500, seed: int = 0
) -> pd.DataFrame:
    """Number of members with an empty constraint set at every step, in `runs` simulated runs.

    A row per policy and step: policy, step, runs (not yet ended), alive (their mean number of
    living members), infeasible (mean number of members whose constraint set is empty),
    any_infeasible (fraction of those runs with at least one).
    """
    study = simulate(scenario, POLICIES, runs, seed, guide=guide, save_trajectories=runs)
    rows = []
    for name in POLICIES:
        policy = make_policy(name, scenario, guide)
        for step in range(scenario.n_steps):
            active = [run for run in study.trajectories[name] if len(run.alive) > step + 1]
            if not active:
                break
            state = _states(scenario, guide, active, step)
            infeasible = policy.decide(step, *state).infeasible
            rows.append(
                {
                    "policy": name,
                    "step": step,
                    "runs": len(active),
                    "alive": float(state[2].sum(axis=1).mean()),
                    "infeasible": float(infeasible.mean()),
                    "any_infeasible": float((infeasible > 0).mean()),
                }
            )
    return pd.DataFrame(rows).round(4)


def _states(
    scenario: Scenario, guide: Guide, trajectories: Sequence[RunTrajectory], step: int
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Positions, previous velocities and living members of the runs at a step."""
    positions = np.stack([trace.positions[step] for trace in trajectories])
    alive = np.stack([trace.alive[step] for trace in trajectories])
    if step == 0:
        previous_velocities = initial_velocities(scenario, guide)
    else:
        previous = np.stack([trace.positions[step - 1] for trace in trajectories])
        previous_velocities = (positions - previous) / scenario.time.dt
    lost = ~alive[..., None]
    return np.where(lost, 0.0, positions), np.where(lost, 0.0, previous_velocities), alive


def infeasibility_cost(scenario: Scenario, report: Report) -> pd.DataFrame:
    """Success with looser limits, along the same guide: what empty constraint sets cost.

    A row per change and policy: change, policy, success_low, success_high (proven), infeasible
    (mean number of infeasible member-steps per run).
    """
    guide = plan(scenario, certify=False)
    rows = []
    rho = scenario.formation.rho
    for factor, corridor in ((1, rho), (2, rho), (8, rho), (1, 0.1), (1, 0.2), (8, 0.2)):
        a_max = factor * scenario.swarm.a_max
        name = f"a_max = {a_max:g}, rho = {corridor:g}"
        report(f"empty sets: {name}")
        changed = scenario.with_values({"swarm.a_max": a_max, "formation.rho": corridor})
        for policy in POLICIES:
            distribution = evaluate(changed, policy, 5 * WIDTH, guide=guide)
            rows.append(
                {
                    "change": name,
                    "policy": policy,
                    "success_low": distribution.success.low,
                    "success_high": distribution.success.high,
                    "infeasible": round(distribution.infeasible, 3),
                }
            )
    return pd.DataFrame(rows).round(4)
