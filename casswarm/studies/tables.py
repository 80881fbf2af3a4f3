"""Guides, laws and runs as tables."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import combinations
from typing import Any

import numpy as np
import pandas as pd

from ..chain.confidence import Paired, wilson
from ..chain.distribution import OutcomeDistribution
from ..chain.monte_carlo import Runs
from ..chain.stratified import Estimate
from ..chain.trajectories import RunTrajectory
from ..typing import FloatArray


def trajectory_table(trajectories: Mapping[str, Sequence[RunTrajectory]]) -> pd.DataFrame:
    """A row a member and step of every run that was kept: where it is, alive or not, who leads.

    Columns: policy, run, step, member, x, y, alive, leads (from this step to the next).
    """
    parts = []
    for policy, kept in trajectories.items():
        for run, trace in enumerate(kept):
            steps, members = trace.alive.shape
            leaders = np.append(trace.leaders, -1)
            parts.append(
                pd.DataFrame(
                    {
                        "policy": policy,
                        "run": run,
                        "step": np.repeat(np.arange(steps), members),
                        "member": np.tile(np.arange(members), steps),
                        "x": trace.positions[..., 0].ravel(),
                        "y": trace.positions[..., 1].ravel(),
                        "alive": trace.alive.ravel(),
                        "leads": (leaders[:, None] == np.arange(members)).ravel(),
                    }
                )
            )
    return pd.concat(parts, ignore_index=True)


def distribution_table(laws: Sequence[OutcomeDistribution]) -> pd.DataFrame:
    """A row a law: policy, brackets of success and of the mean number of survivors, counts."""
    return pd.DataFrame(
        {
            "policy": law.policy,
            "success_low": law.success[0],
            "success_high": law.success[1],
            "survivors_mean_low": law.survivors_mean[0],
            "survivors_mean_high": law.survivors_mean[1],
            "residual_mass": law.residual_mass,
            "complete": law.complete,
            "aggregation_tol": law.aggregation_tol,
            "states": law.states,
            "infeasible_mean": law.infeasible,
            "solver_failures_mean": law.failures,
        }
        for law in laws
    )


def estimate_table(estimates: Sequence[Estimate]) -> pd.DataFrame:
    """A row an estimate: its interval, and its parts.

    The head's bracket is proven where `aggregation_tol` is 0; `sampled_mass` is statistical.
    """
    return pd.DataFrame(
        {
            "policy": found.policy,
            "success_low": found.success[0],
            "success_high": found.success[1],
            "level": found.level,
            "enumerated_low": found.enumerated.success[0],
            "enumerated_high": found.enumerated.success[1],
            "aggregation_tol": found.enumerated.aggregation_tol,
            "sampled_mass": found.sampled_mass,
            "pruned_mass": found.pruned_mass,
            "runs": found.runs,
            "successes": found.successes,
            "effective_runs": found.effective_runs,
            "states": found.states,
        }
        for found in estimates
    )


def arrival_table(laws: Sequence[OutcomeDistribution]) -> pd.DataFrame:
    """A row a step: the probability of the first arrival at it, a column a policy, low ends.

    The high end is the low end plus the column NAME_residual_mass.
    """
    steps = np.arange(len(laws[0].arrival))
    columns = {law.policy: law.arrival for law in laws}
    return pd.DataFrame({"step": steps} | columns | _unknown(laws))


def population_table(laws: Sequence[OutcomeDistribution]) -> pd.DataFrame:
    """A row a step: the probability that k members are alive, a column NAME_k, low ends.

    Runs that have ended keep the number that they ended with.
    """
    steps = np.arange(len(laws[0].arrival))
    columns = {
        f"{law.policy}_{k}": law.population[:, k]
        for law in laws
        for k in range(law.population.shape[1])
    }
    return pd.DataFrame({"step": steps} | columns | _unknown(laws))


def _unknown(laws: Sequence[OutcomeDistribution]) -> dict[str, FloatArray]:
    return {f"{law.policy}_residual_mass": law.residual_mass_before for law in laws}


def survivor_table(laws: Sequence[OutcomeDistribution]) -> pd.DataFrame:
    """A row a number of survivors at the end: its probability, a column a policy (low ends)."""
    numbers = np.arange(len(laws[0].survivors))
    return pd.DataFrame({"survivors": numbers} | {law.policy: law.survivors for law in laws})


def member_table(laws: Sequence[OutcomeDistribution]) -> pd.DataFrame:
    """A row a member: the probability that it is alive at the end, brackets."""
    columns = {}
    for law in laws:
        columns[f"{law.policy}_low"] = law.members
        columns[f"{law.policy}_high"] = np.minimum(1.0, law.members + law.residual_mass)
    return pd.DataFrame({"member": np.arange(len(laws[0].members))} | columns)


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
            "infeasible": part.infeasible,
            "solver_failures": part.solver_failures,
            "fallbacks": part.fallbacks,
            "saturated": part.saturated,
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
                "infeasible": int(table["infeasible"].sum()),
                "solver_failures": int(table["solver_failures"].sum()),
                "fallbacks": int(table["fallbacks"].sum()),
                "saturated": int(table["saturated"].sum()),
            }
        )
    return pd.DataFrame(rows)


def paired_table(runs: pd.DataFrame) -> pd.DataFrame:
    """A row a pair of policies of a table with a row a run: their difference in success.

    Columns: first, second, difference (first minus second) with its 95 % interval difference_low
    and difference_high, first_only and second_only (the discordant runs), p_value (McNemar's exact
    test), variance_ratio (of common random numbers to independent ones). See `Paired`.
    """
    outcomes = {
        str(name): table.sort_values("run")["success"].to_numpy(bool)
        for name, table in runs.groupby("policy", sort=False)
    }
    rows = []
    for (first, a), (second, b) in combinations(outcomes.items(), 2):
        pair = Paired(*(int(part.sum()) for part in (a & b, a & ~b, ~a & b, ~a & ~b)))
        low, high = pair.interval()
        rows.append(
            {
                "first": first,
                "second": second,
                "difference": pair.difference,
                "difference_low": low,
                "difference_high": high,
                "first_only": pair.first_only,
                "second_only": pair.second_only,
                "p_value": pair.p_value,
                "variance_ratio": pair.variance_ratio,
            }
        )
    return pd.DataFrame(rows)


def success_text(row: Mapping[Any, Any]) -> str:
    """Text of an estimated success probability; where no run succeeds, with its upper bound."""
    return f"{row['success']:.4f}" if row["successes"] else f"0 (<= {row['success_high']:.3f})"


def summary_texts(summary: pd.DataFrame) -> pd.DataFrame:
    """The summary for people: probabilities with their intervals, counts, all as text."""
    return pd.DataFrame(
        {
            "policy": str(row["policy"]),
            "runs": f"{row['runs']}",
            "success": success_text(row),
            "95 % interval": f"{row['success_low']:.4f} to {row['success_high']:.4f}",
            "survivors": f"{row['survivors_mean']:.2f}",
            "arrival step": f"{row['arrival_step_mean']:.1f}" if row["successes"] else "-",
            "infeasible": f"{row['infeasible']}",
            "solver failures": f"{row['solver_failures']}",
            "fallbacks": f"{row['fallbacks']}",
            "saturated": f"{row['saturated']}",
        }
        for row in summary.to_dict("records")
    )


def paired_texts(paired: pd.DataFrame) -> pd.DataFrame:
    """Differences between policies under common random numbers, all as text."""
    return pd.DataFrame(
        {
            "difference in success": f"{row['first']} - {row['second']}",
            "": f"{row['difference']:+.4f}",
            "95 % interval": f"{row['difference_low']:+.4f} to {row['difference_high']:+.4f}",
            "only A : only B": f"{row['first_only']} : {row['second_only']}",
            "p (McNemar)": f"{row['p_value']:.2g}",
            "variance ratio": f"{row['variance_ratio']:.2f}" if row["variance_ratio"] >= 0 else "-",
        }
        for row in paired.to_dict("records")
    )
