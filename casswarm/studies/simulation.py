"""A study: several policies simulated on one scenario, as tables."""

from __future__ import annotations

import hashlib
import tomllib
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field
from functools import partial
from importlib.metadata import version
from numbers import Integral
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pandas as pd

from .._util.parallel import Workers, checked_workers, require_sendable
from ..chain.monte_carlo import Chain
from ..chain.trajectories import RunTrajectory
from ..errors import PolicyError
from ..optimization.solvers import Solver
from ..planning.guide import Guide
from ..planning.plan import initial_velocities, plan
from ..policies import as_policy, make_policy
from ..policies.base import Policy
from ..typing import Progress
from .batches import Parts, jobs_left, kept_parts, sample_jobs
from .checkpoint import Checkpoint, IfExists
from .tables import paired_table, run_table, summarise

if TYPE_CHECKING:
    from ..scenario import Scenario

PAPER_POLICIES = ("naive", "constrained", "leader")
"""The three policies that the paper compares, in its order."""


@dataclass(frozen=True, eq=False)
class Study:
    """What simulating policies on a scenario gave.

    Parameters
    ----------
    scenario : Scenario
    guide : Guide
    seed : int
    summary : DataFrame
        A row a policy: policy, runs, successes, success with its Wilson 95 % interval
        success_low and success_high, survivors_mean, arrival_step_mean, shortfalls,
        solver_failures, resolved, clipped.
    paired : DataFrame
        A row a pair of policies: their difference in success with its 95 % interval; see
        `casswarm.studies.tables.paired_table`.
    runs : DataFrame
        A row a run: policy, run, success, survivors, arrival_step (missing where no member
        arrived), steps, shortfalls, solver_failures, resolved, clipped.
    effort : DataFrame
        A row a policy: distinct states in which it was asked, seconds. Not reproducible.
    trajectories : dict of policy name to tuple of RunTrajectory
        Trajectories of the first runs.
    """

    scenario: Scenario = field(repr=False)
    guide: Guide
    seed: int
    summary: pd.DataFrame
    paired: pd.DataFrame = field(repr=False)
    runs: pd.DataFrame = field(repr=False)
    effort: pd.DataFrame = field(repr=False)
    trajectories: dict[str, tuple[RunTrajectory, ...]] = field(repr=False)

    def __str__(self) -> str:
        return f"{self.guide}\n{self.summary.to_string(index=False)}"


def simulate(
    scenario: Scenario,
    policies: Sequence[Any] = PAPER_POLICIES,
    runs: int = 1000,
    seed: int = 0,
    workers: Workers = 1,
    *,
    guide: Guide | None = None,
    solver: str | Solver = "auto",
    save_trajectories: int = 1,
    progress: Progress | None = None,
    checkpoint: Path | None = None,
    if_exists: IfExists = "error",
) -> Study:
    """Estimate by Monte Carlo how often the swarm reaches the target under each policy.

    Success means that some member arrives alive by t_f. The same run index sees the same random
    numbers under every policy. The tables depend on the scenario, the guide, the policies, the
    number of runs and the seed only, not on workers or batches.

    Parameters
    ----------
    scenario : Scenario
    policies : sequence
        Names, `Policy` objects, functions of (step, positions, previous_velocities, alive), or objects with
        such a method ``velocities``. Their names must differ.
    runs : int
        Runs of every policy, at least 1.
    seed : int
        At least 0.
    workers : int or executor
        Processes that share the runs; 1 stays in this process. In a script, more than one needs
        the guard ``if __name__ == "__main__":``, since workers import the script again. Or an
        executor in the style of `concurrent.futures`, such as Dask's ``client.get_executor()``.
        A process of ours that dies costs time, and no result.
    guide : Guide, optional
        Planned from the scenario by default.
    solver : str or Solver
        Of the formation problems of the policies that are given by name.
    save_trajectories : int
        Number of runs per policy, the first ones, whose trajectories are saved.
    progress : callable, optional
        Called with a policy's name, the number of its runs that have ended, and their total.
    checkpoint : Path, optional
        Folder in which results are saved as they are computed.
    if_exists : {"error", "resume", "overwrite"}
        If that folder holds an unfinished study: refuse it, continue it (the inputs must be equal;
        the tables are those of an uninterrupted study), or start over.

    Returns
    -------
    Study

    Raises
    ------
    PolicyError
        An unknown, duplicate or failing policy, or one that cannot be sent to a worker.
    PlanningError
        No guide was found.
    CheckpointError
        The folder is in use, was made with other inputs, or holds an unfinished study.
    ValueError
        Fewer than one run or worker, or a negative seed.

    Examples
    --------
    >>> import casswarm as csw
    >>> study = csw.simulate(csw.load_scenario("paper-1"), ["leader"], runs=50)
    >>> study.runs.columns[:5].tolist()
    ['policy', 'run', 'success', 'survivors', 'arrival_step']
    >>> row = study.summary.loc[0]
    >>> bool(row["success_low"] < row["success"] < row["success_high"])
    True
    """
    for name, value, least in (("runs", runs, 1), ("seed", seed, 0)):
        if not isinstance(value, Integral) or value < least:
            raise ValueError(f"{name} = {value}; allowed: whole numbers from {least}")
    checked_workers(workers)
    guide = plan(scenario) if guide is None else guide
    named = partial(make_policy, scenario=scenario, guide=guide, solver=solver)
    made: list[Policy] = distinct_policies(policies, named)
    chain = Chain(scenario, initial_velocities(scenario, guide), seed)
    with ExitStack() as stack:
        store = None
        if checkpoint is not None:
            inputs = _inputs(chain, guide, made, runs, save_trajectories, solver)
            store = stack.enter_context(Checkpoint(checkpoint, inputs, if_exists))
        parts = kept_parts(store, made, runs)
        jobs = jobs_left(chain, made, parts, runs, save_trajectories, workers)
        if workers != 1:
            require_sendable({job.policy.name: job for job in jobs})
        sample_jobs(jobs, workers, parts, progress, runs, store)
        if store is not None:
            store.finish()
        return _study(scenario, guide, seed, parts)


def _inputs(
    chain: Chain,
    guide: Guide,
    made: Sequence[Policy],
    runs: int,
    save_trajectories: int,
    solver: str | Solver,
) -> dict[str, Any]:
    """All that decides a study, for its folder."""
    return {
        "study": "simulate",
        "scenario": tomllib.loads(chain.scenario.to_toml()),
        "guide": hashlib.sha256(guide.positions.tobytes()).hexdigest(),
        "policies": [policy.name for policy in made],
        "runs": int(runs),
        "save_trajectories": int(save_trajectories),
        "seed": int(chain.seed),
        "solver": str(solver),
        "casswarm": version("casswarm"),
    }


def distinct_policies(policies: Sequence[Any], named: Callable[[str], Any]) -> list[Any]:
    """Policies of what users give: names by `named`, functions and methods by `as_policy`.

    Raises
    ------
    PolicyError
        No list, an empty one, or policies of one name.
    """
    if isinstance(policies, (str, Policy)):
        raise PolicyError(f"policies must be a list; for a single one give [{policies!r}]")
    made = [named(policy) if isinstance(policy, str) else as_policy(policy) for policy in policies]
    names = [policy if isinstance(policy, str) else policy.name for policy in made]
    repeated = sorted({name for name in names if names.count(name) > 1})
    if repeated or not names:
        raise PolicyError(
            f"policies need names that differ; repeated: {', '.join(repeated)}; "
            "as_policy(function, name) gives one a name"
            if repeated
            else "no policy given"
        )
    return made


def _study(scenario: Scenario, guide: Guide, seed: int, parts: Parts) -> Study:
    tables, effort, trajectories = [], [], {}
    for name, done in parts.items():
        done.sort(key=lambda item: item[0].first)
        tables.append(pd.concat([run_table(name, part) for part, _ in done], ignore_index=True))
        trajectories[name] = tuple(trace for part, _ in done for trace in part.trajectories)
        effort.append(
            {
                "policy": name,
                "states": sum(part.states for part, _ in done),
                "seconds": sum(seconds for _, seconds in done),
            }
        )
    runs = pd.concat(tables, ignore_index=True)
    return Study(
        scenario,
        guide,
        seed,
        summarise(runs),
        paired_table(runs),
        runs,
        pd.DataFrame(effort),
        trajectories,
    )
