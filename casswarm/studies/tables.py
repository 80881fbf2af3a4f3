"""Outcome distributions, estimates, runs, guides and joint plans as tables."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from itertools import combinations
from typing import Any

import numpy as np
import pandas as pd

from .._util.text import counted
from ..chain.confidence import Paired, wilson
from ..chain.distribution import Estimate, OutcomeDistribution
from ..chain.monte_carlo import Runs, RunTrajectory
from ..chain.transition import COUNTS
from ..guide.guide import Guide
from ..guide.mixture import MixedGuide
from ..joint import MixedPlan
from ..joint.swarm_plan import SwarmPlan
from ..typing import FloatArray


def trajectory_table(trajectories: Mapping[str, Sequence[RunTrajectory]]) -> pd.DataFrame:
    """Trajectories of saved runs: a row per policy, run, step and member.

    Columns: policy, run, step, member, x, y, alive, leads (from this step to the next); where
    news are late, ghost (lost, and not known to be); of a hazard that is not known, its true case.
    """
    parts = []
    for policy, saved in trajectories.items():
        for run, trajectory in enumerate(saved):
            steps, members = trajectory.alive.shape
            leaders = np.append(trajectory.leaders, -1)
            columns = {
                "policy": policy,
                "run": run,
                "step": np.repeat(np.arange(steps), members),
                "member": np.tile(np.arange(members), steps),
                "x": trajectory.positions[..., 0].ravel(),
                "y": trajectory.positions[..., 1].ravel(),
                "alive": trajectory.alive.ravel(),
                "leads": (leaders[:, None] == np.arange(members)).ravel(),
            }
            if trajectory.believed is not None:
                columns["ghost"] = trajectory.ghosts.ravel()
            if trajectory.case is not None:
                columns["case"] = trajectory.case
            parts.append(pd.DataFrame(columns))
    return pd.concat(parts, ignore_index=True)


def by_case(answers: Sequence[Any]) -> list[tuple[str, float, Any]]:
    """Distributions or estimates with their cases: (case or "prior", weight, answer)."""
    return [
        row
        for answer in answers
        for row in [
            ("prior", 1.0, answer),
            *((str(k), weight, each) for k, (weight, each) in enumerate(answer.cases)),
        ]
    ]


def case_table(answers: Sequence[Any]) -> pd.DataFrame:
    """Distributions or estimates for the prior and every case: `distribution_table` of each.

    With the columns case and weight, as `with_cases` has them.
    """
    cases, weights, each = zip(*by_case(answers), strict=True)
    make = estimate_table if isinstance(answers[0], Estimate) else distribution_table
    table = make(each)
    table.insert(1, "case", cases)
    table.insert(2, "weight", weights)
    return table


def distribution_table(distributions: Sequence[OutcomeDistribution]) -> pd.DataFrame:
    """Bounds of success and of the mean number of survivors, and counts: a row per policy."""
    return pd.DataFrame(
        {
            "policy": distribution.policy,
            "success_low": distribution.success.low,
            "success_high": distribution.success.high,
            "survivors_mean_low": distribution.survivors_mean.low,
            "survivors_mean_high": distribution.survivors_mean.high,
            "residual_mass": distribution.residual_mass,
            "complete": distribution.complete,
            "aggregation_tol": distribution.aggregation_tol,
            "states": distribution.states,
            "infeasible_mean": distribution.infeasible,
            "solver_failures_mean": distribution.failures,
        }
        for distribution in distributions
    )


def estimate_table(estimates: Sequence[Estimate]) -> pd.DataFrame:
    """Estimates of success and their parts: a row per policy.

    The bounds of the enumerated part are proven; the part of `sampled_mass` is statistical.
    """
    return pd.DataFrame(
        {
            "policy": estimate.policy,
            "success_low": estimate.success[0],
            "success_high": estimate.success[1],
            "level": estimate.level,
            "enumerated_low": estimate.enumerated.success[0],
            "enumerated_high": estimate.enumerated.success[1],
            "aggregation_tol": estimate.enumerated.aggregation_tol,
            "sampled_mass": estimate.sampled_mass,
            "pruned_mass": estimate.pruned_mass,
            "runs": estimate.runs,
            "successes": estimate.successes,
            "effective_runs": estimate.effective_runs,
            "states": estimate.states,
        }
        for estimate in estimates
    )


def arrival_table(distributions: Sequence[OutcomeDistribution]) -> pd.DataFrame:
    """Probability of the first arrival at every step: a row per step, a column per policy.

    These are lower bounds; the upper bound is larger by the column POLICY_residual_mass.
    """
    steps = np.arange(len(distributions[0].arrival))
    columns = {distribution.policy: distribution.arrival for distribution in distributions}
    return pd.DataFrame({"step": steps} | columns | _residual_masses(distributions))


def population_table(distributions: Sequence[OutcomeDistribution]) -> pd.DataFrame:
    """Probability that k members are alive: a row per step, a column POLICY_k, lower bounds.

    Runs that have ended count with their last number.
    """
    steps = np.arange(len(distributions[0].arrival))
    columns = {
        f"{distribution.policy}_{k}": distribution.population[:, k]
        for distribution in distributions
        for k in range(distribution.population.shape[1])
    }
    return pd.DataFrame({"step": steps} | columns | _residual_masses(distributions))


def _residual_masses(distributions: Sequence[OutcomeDistribution]) -> dict[str, FloatArray]:
    return {
        f"{distribution.policy}_residual_mass": distribution.residual_mass_before
        for distribution in distributions
    }


def survivor_table(distributions: Sequence[OutcomeDistribution]) -> pd.DataFrame:
    """Probability of every number of survivors: a row per number, a column per policy."""
    numbers = np.arange(len(distributions[0].survivors))
    return pd.DataFrame(
        {"survivors": numbers}
        | {distribution.policy: distribution.survivors for distribution in distributions}
    )


def member_table(distributions: Sequence[OutcomeDistribution]) -> pd.DataFrame:
    """Bounds of the probability that a member is alive at the end: a row per member."""
    columns = {}
    for distribution in distributions:
        columns[f"{distribution.policy}_low"] = distribution.members
        columns[f"{distribution.policy}_high"] = np.minimum(
            1.0, distribution.members + distribution.residual_mass
        )
    return pd.DataFrame({"member": np.arange(len(distributions[0].members))} | columns)


def run_table(name: str, part: Runs, cases: int = 1) -> pd.DataFrame:
    """Runs of a policy, of a hazard with so many cases: a row per run; see `Study`."""
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
            "distance": part.distance,
        }
        | part.counts
        | ({"case": part.case} if cases > 1 else {})
    )


def summarise(runs: pd.DataFrame) -> pd.DataFrame:
    """Summary of a table of runs: a row per policy; see `Study`."""
    table = (
        runs.groupby("policy", sort=False)
        .agg(
            runs=("success", "size"),
            successes=("success", "sum"),
            success=("success", "mean"),
            survivors_mean=("survivors", "mean"),
            arrival_step_mean=("arrival_step", "mean"),
            **{name: (name, "sum") for name in COUNTS},
        )
        .reset_index()
        .astype({"arrival_step_mean": float})
    )
    intervals = map(wilson, table["successes"], table["runs"])
    bounds = pd.DataFrame(intervals, columns=["success_low", "success_high"])
    return pd.concat([table.loc[:, :"success"], bounds, table.loc[:, "survivors_mean":]], axis=1)


def with_cases(summary: pd.DataFrame, runs: pd.DataFrame, weights: Sequence[float]) -> pd.DataFrame:
    """A summary of runs for the prior over the cases of a hazard, and one of those in each case.

    Rows as of `summarise`, with the columns case ("prior", "0", "1", ...) and weight.
    """
    parts = [summary.assign(case="prior", weight=1.0)]
    parts += [
        summarise(runs[runs["case"] == k]).assign(case=str(k), weight=weight)
        for k, weight in enumerate(weights)
    ]
    order = [*dict.fromkeys(["policy", "case", "weight", *summary.columns])]
    return pd.concat([part for part in parts if len(part)], ignore_index=True)[order]


def paired_table(runs: pd.DataFrame) -> pd.DataFrame:
    """Differences in success of pairs of policies, from a table of runs: a row per pair.

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
    """The summary for people: probabilities with their intervals, all as text.

    `count_notes` has the counts.
    """
    return pd.DataFrame(
        {"policy": str(row["policy"])}
        | ({"case": str(row["case"])} if "case" in row else {})
        | {
            "runs": f"{row['runs']}",
            "success": success_text(row),
            "95 % interval": f"{row['success_low']:.4f} to {row['success_high']:.4f}",
            "survivors": f"{row['survivors_mean']:.2f}",
            "arrival step": f"{row['arrival_step_mean']:.1f}" if row["successes"] else "-",
        }
        for row in summary.to_dict("records")
    )


_NOTES = {
    "infeasible": ("infeasible step", "", "no feasible velocity"),
    "solver_failures": ("solver failure", "", "a fallback velocity was applied"),
    "fallbacks": ("fallback", "", "Ipopt solved again"),
    "saturated": ("saturated velocity", "saturated velocities", "projected to the limits"),
}
"""Noun, plural and meaning of each of `COUNTS`."""


def count_notes(rows: Iterable[Mapping[Any, Any]], unit: str = "") -> list[str]:
    """Notes on the nonzero counts among `COUNTS`: a line per policy that has any.

    Parameters
    ----------
    rows : iterable of mapping
        Of every policy: its name "policy", and all or some of its counts.
    unit : str
        What a count refers to, such as "per run".
    """
    notes = []
    for row in rows:
        counts = [
            f"{counted(row[name], noun, plural)}{unit and f' {unit}'} ({meaning})"
            for name, (noun, plural, meaning) in _NOTES.items()
            if row.get(name)
        ]
        if counts:
            notes.append(f"{row['policy']}: {', '.join(counts)}")
    return notes


_FOLLOWS_GUIDE = re.compile(r"(leader|constrained)(-mpc-\d+)?")
_FULL_SPEED = 1 - 1e-6  # of v_max


def end_notes(runs: pd.DataFrame, guide: Guide, v_max: float) -> list[str]:
    """Notes on runs that end outside the target though a member that counts lives: one per policy.

    Parameters
    ----------
    runs : DataFrame
        A row per run, as of `Study.runs`.
    guide : Guide
        That `leader` and `constrained` follow.
    v_max : float
        Bound on each component of the guide's velocities.
    """
    notes = []
    fast = int((np.abs(guide.velocities).max(axis=1, initial=0.0) >= _FULL_SPEED * v_max).sum())
    left = runs[~runs["success"].astype(bool) & runs["distance"].notna()]
    for name, table in left.groupby("policy", sort=False):
        total, alive = (runs["policy"] == name).sum(), table["survivors"].mean()
        last, nearest = table["steps"].max(), table["distance"].min()
        verb = "ends" if len(table) == 1 else "end"
        note = (
            f"{name}: {counted(len(table), 'run')} of {total} {verb} at step {last} "
            f"with living members outside the target, the nearest {nearest:.2g} away "
            f"({alive:.1f} alive on average)"
        )
        if _FOLLOWS_GUIDE.fullmatch(str(name)) and 2 * fast > guide.arrival:
            note += (
                "; a leader that falls behind cannot catch up: the guide flies at v_max in "
                f"{fast} of its {guide.arrival} steps"
            )
            note += " (guide.max_wait lets it wait)" if guide.arrival < last else ""
        notes.append(note)
    return notes


def paired_texts(paired: pd.DataFrame) -> pd.DataFrame:
    """Differences between policies under common random numbers, all as text."""
    return pd.DataFrame(
        {
            "difference in success": f"{row['first']} - {row['second']}",
            "": f"{row['difference']:+.4f}",
            "95 % interval": f"{row['difference_low']:+.4f} to {row['difference_high']:+.4f}",
            "A : B": f"{row['first_only']} : {row['second_only']}",
            "p": f"{row['p_value']:.2g}",
            "variance": f"{row['variance_ratio']:.2f}" if row["variance_ratio"] >= 0 else "-",
        }
        for row in paired.to_dict("records")
    )


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


def mixture_table(mixed: MixedGuide | MixedPlan) -> pd.DataFrame:
    """Paths, or joint plans, of a mixture, a row each: weight, last step, survival_k in case k.

    The last row is of the mixture. Of joint plans, success is in place of survival, and the last
    step in place of the arrival.
    """
    names = ("path", "arrival", "survival")
    if isinstance(mixed, MixedPlan):
        names = ("plan", "last_step", "success")
    what, last, measure = names
    rows: list[dict[str, Any]] = [
        {what: f"{what} {k}", "weight": weight, last: len(route) - 1}
        for k, (route, weight) in enumerate(zip(mixed.routes, mixed.weights, strict=True))
    ]
    rows.append({what: "mixture", "weight": 1.0, last: None})
    for row, values in zip(rows, [*mixed.survivals, mixed.survival], strict=True):
        row |= {f"{measure}_{k}": float(value) for k, value in enumerate(values)}
    return pd.DataFrame(rows).astype({last: "Int64"})


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


def stacked(tables: Sequence[pd.DataFrame]) -> pd.DataFrame:
    """The rows of several tables, the last column first."""
    table = pd.concat(tables, ignore_index=True)
    return table[[table.columns[-1], *table.columns[:-1]]]


def outcome_table(plan: SwarmPlan) -> pd.DataFrame:
    """Outcomes of a joint plan's search, a row per start: value, arrivals, and solver status."""
    return pd.DataFrame(
        outcome.as_row() | {"seconds": outcome.seconds} for outcome in plan.outcomes
    )
