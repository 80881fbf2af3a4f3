"""Where the constraint sets of the paper's formation problems are empty, and what that costs."""

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
from .success import WIDTH, Tell

POLICIES = ("constrained", "leader")


def shortfall_steps(
    scenario: Scenario, guide: Guide, runs: int = 500, seed: int = 0
) -> pd.DataFrame:
    """How many members cannot fulfil their wish at every step, in `runs` sampled runs.

    A row a policy and step: policy, step, runs (still under way), alive (mean, of those), short
    (mean number of members whose set is empty), some (share of those runs with at least one).
    """
    study = simulate(scenario, POLICIES, runs, seed, guide=guide, save_trajectories=runs)
    rows = []
    for name in POLICIES:
        policy = make_policy(name, scenario, guide)
        for step in range(scenario.n_steps):
            going = [trace for trace in study.trajectories[name] if len(trace.alive) > step + 1]
            if not going:
                break
            state = _states(scenario, guide, going, step)
            short = policy.decide(step, *state).infeasible
            rows.append(
                {
                    "policy": name,
                    "step": step,
                    "runs": len(going),
                    "alive": float(state[2].sum(axis=1).mean()),
                    "short": float(short.mean()),
                    "some": float((short > 0).mean()),
                }
            )
    return pd.DataFrame(rows).round(4)


def _states(
    scenario: Scenario, guide: Guide, traces: Sequence[RunTrajectory], step: int
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Positions, previous velocities and who is alive in the runs at a step."""
    positions = np.stack([trace.positions[step] for trace in traces])
    alive = np.stack([trace.alive[step] for trace in traces])
    if step == 0:
        previous_velocities = np.tile(initial_velocities(scenario, guide), (len(traces), 1, 1))
    else:
        before = np.stack([trace.positions[step - 1] for trace in traces])
        previous_velocities = (positions - before) / scenario.time.dt
    gone = ~alive[..., None]
    return np.where(gone, 0.0, positions), np.where(gone, 0.0, previous_velocities), alive


def cost(scenario: Scenario, tell: Tell) -> pd.DataFrame:
    """What empty sets cost: success where limits are looser, and nothing else changes.

    A row a value and policy: change, policy, success_low, success_high (proven), shortfalls in a
    run, mean. The guide is that of the scenario as it is.
    """
    guide = plan(scenario, certify=False)
    rows = []
    for name, change in _looser(scenario):
        tell(f"empty sets: {name}")
        changed = scenario.with_values(change) if change else scenario
        for policy in POLICIES:
            law = evaluate(changed, policy, 5 * WIDTH, guide=guide)
            rows.append(
                {
                    "change": name,
                    "policy": policy,
                    "success_low": law.success[0],
                    "success_high": law.success[1],
                    "infeasible": round(law.infeasible, 3),
                }
            )
    return pd.DataFrame(rows).round(4)


def _looser(scenario: Scenario) -> list[tuple[str, dict[str, object]]]:
    a_max, rho = scenario.swarm.a_max, scenario.formation.rho
    values: list[tuple[str, dict[str, object]]] = [(f"a_max = {a_max:g}, rho = {rho:g}", {})]
    values += [
        (f"a_max = {factor * a_max:g}, rho = {rho:g}", {"swarm.a_max": factor * a_max})
        for factor in (2, 8)
    ]
    values += [
        (f"a_max = {a_max:g}, rho = {wide:g}", {"formation.rho": wide}) for wide in (0.1, 0.2)
    ]
    both: dict[str, object] = {"swarm.a_max": 8 * a_max, "formation.rho": 0.2}
    return [*values, (f"a_max = {8 * a_max:g}, rho = 0.2", both)]
