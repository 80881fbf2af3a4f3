"""Studies: several policies simulated on one scenario, with their tables."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from numbers import Integral
from typing import TYPE_CHECKING, Any

import pandas as pd
from typing_extensions import Unpack

from .._util.checkpoint import Checkpoint, file_name, opened
from .._util.child import Workers, done_jobs, require_sendable, require_workers
from .._util.display import Displayed
from .._util.numbers import require_seed
from .._util.parts import Part, part_of
from .._util.progress import reporter
from .._util.settings import SAVED, Execution, SavedKeywords, given_values
from ..chain.confidence import required_runs
from ..chain.monte_carlo import Chain, Purpose, Runs, RunTrajectory
from ..guide.guide import Guide
from ..policies.base import Policy
from ..policies.user import repeated
from ..scenario.scenario_files import require_scenario
from ..solvers import Solver
from ..typing import Progress, Seed
from .inputs import PosedStudy, require_runs, study_inputs
from .tables import paired_table, run_table, summarise, with_cases

if TYPE_CHECKING:
    from ..scenario import Scenario


BATCH = 20_000
"""Maximum number of runs that are simulated together: bounds memory, changes no result."""

_EXECUTOR_SIZE = 8
"""Assumed number of workers of an executor, which does not report it."""

Job = tuple[str, partial[Runs]]
"""A policy's name, and the call that simulates consecutive runs of it."""


def missing_batches(
    chain: Chain,
    policies: Sequence[Policy],
    results: Mapping[str, Sequence[Runs]],
    runs: int,
    save_trajectories: int,
    workers: Workers,
    part: Part,
) -> list[Job]:
    """Jobs of the part's runs that `results` lacks, in batches that keep all workers busy."""
    number = int(workers) if isinstance(workers, Integral) else _EXECUTOR_SIZE
    size = min(BATCH, runs if number == 1 else -(-runs // (2 * number)))
    return [
        (policy.name, partial(chain.run, repeated(policy), first, min(size, end - first), saved))
        for policy in policies
        for start, end in _gaps(results[policy.name], runs, part)
        for first in range(start, end, size)
        for saved in [max(0, min(size, save_trajectories - first))]
    ]


def simulate_batches(
    batches: Sequence[Job],
    workers: Workers,
    results: Mapping[str, list[Runs]],
    progress: Progress | None,
    runs: int,
    store: Checkpoint | None,
) -> None:
    """Add every batch to `results`, and save it, as soon as it is finished."""
    done = {name: sum(len(part.arrival) for part in saved) for name, saved in results.items()}

    def report(policy: str, finished: float = 0, total: float | None = None) -> None:  # noqa: ARG001
        if progress is not None:
            progress(policy, done[policy] + finished, runs)

    for name, finished in done.items():
        if finished:
            report(name)
    jobs = [partial(job, progress=report) if workers == 1 else job for _, job in batches]
    for index, part in done_jobs(jobs, workers):
        name, number = batches[index][0], len(part.arrival)
        if store is not None:
            store.save(f"{part.first:012d}-{number:06d}-{file_name(name)}", part.to_arrays())
        results[name].append(part)
        done[name] += number
        report(name)


def saved_results(
    store: Checkpoint | None, policies: Sequence[Policy], runs: int
) -> dict[str, list[Runs]]:
    """Batches of a checkpoint by policy, without overlaps."""
    results: dict[str, list[Runs]] = {policy.name: [] for policy in policies}
    if store is None:
        return results
    by_file_name = {file_name(name): name for name in results}
    for name in store.names():  # ordered by their first run
        try:
            policy = by_file_name[name.split("-", 2)[-1]]
            part = Runs.from_arrays(store.load(name) or {})
        except (KeyError, TypeError, ValueError, OverflowError):
            continue
        end = results[policy][-1].end if results[policy] else 0
        if end <= part.first and part.end <= runs:
            results[policy].append(part)
    return results


def _gaps(saved: Sequence[Runs], runs: int, part: Part) -> list[tuple[int, int]]:
    """Ranges (first, last + 1) of the part's runs that are not among the saved ones."""
    first, last = part.window(runs)
    ends = [first, *(max(first, batch.end) for batch in saved)]
    firsts = [*(min(last, batch.first) for batch in saved), last]
    return [(a, b) for a, b in zip(ends, firsts, strict=True) if a < b]


PAPER_POLICIES = ("naive", "constrained", "leader")
"""The three policies that the paper compares, in its order."""

PILOT = 1000
"""Runs of a pilot study."""


@dataclass(frozen=True, eq=False, repr=False)
class Study(Displayed):
    """Results of simulating policies on a scenario.

    Parameters
    ----------
    scenario : Scenario
    guide : Guide
    seed : int
    summary : DataFrame
        A row per policy: policy, runs, successes, success with its Wilson 95 % interval
        success_low and success_high, survivors_mean, arrival_step_mean, infeasible (member-steps
        whose soft constraint could not be met), solver_failures, fallbacks (steps solved again by
        the fallback solver), saturated (velocities projected to the limits).
    paired : DataFrame
        A row per pair of policies: their difference in success with its 95 % interval; see
        `casswarm.studies.tables.paired_table`.
    runs : DataFrame
        A row per run: policy, run, success, survivors, arrival_step (missing if no member
        arrived), steps, distance (of the nearest living member from the target zone at the end;
        missing if none lives), infeasible, solver_failures, fallbacks, saturated; and of a hazard
        that is not known, case: the true one, which is drawn by the prior.
    effort : DataFrame
        A row per policy: number of distinct states in which it was evaluated, seconds. Not
        reproducible.
    trajectories : dict of policy name to tuple of RunTrajectory
        Trajectories of the first runs.
    cases : DataFrame or None
        Of a hazard that is not known, the rows of `summary` for the prior, and for the runs in
        which each of the cases is the true one, with the columns case and weight.
    """

    scenario: Scenario
    guide: Guide
    seed: int
    summary: pd.DataFrame
    paired: pd.DataFrame
    runs: pd.DataFrame
    effort: pd.DataFrame
    trajectories: dict[str, tuple[RunTrajectory, ...]]
    cases: pd.DataFrame | None = None

    def as_dict(self) -> dict[str, Any]:
        """Rows of the tables but `runs`, and the guide's values, for a JSON file."""
        guide = self.guide
        names = "summary", "paired", "effort", "cases"
        tables = {name: getattr(self, name) for name in names if getattr(self, name) is not None}
        return {name: table.to_dict("records") for name, table in tables.items()} | {
            "guide": {
                "risk": guide.risk,
                "survival": guide.survival,
                "risk_bound": guide.risk_bound,
                "solution": guide.solution.as_row(),
            },
        }

    def __repr__(self) -> str:
        success = ", ".join(
            f"{row['policy']} {row['success']:.4f}" for row in self.summary.to_dict("records")
        )
        runs = int(self.summary["runs"].iloc[0])
        return f"Study({self.scenario.name!r}, runs={runs}, seed={self.seed}, success: {success})"

    def __str__(self) -> str:
        table = self.summary if self.cases is None else self.cases
        return f"{self.guide}\n{table.to_string(index=False)}"


def simulate(
    scenario: Scenario,
    policies: Any = PAPER_POLICIES,
    runs: int = 1000,
    seed: Seed = 0,
    workers: Workers | None = None,
    *,
    guide: Guide | None = None,
    solver: str | Solver = "auto",
    solver_options: Mapping[str, Any] | None = None,
    save_trajectories: int = 1,
    execution: Execution | None = None,
    **plain: Unpack[SavedKeywords],
) -> Study:
    """Estimate by Monte Carlo how often the swarm reaches the target under each policy.

    Success means that some member arrives alive by t_f. The same run index sees the same random
    numbers under every policy. The tables depend on the scenario, the guide, the policies, the
    number of runs and the seed only, not on workers or batches.

    Parameters
    ----------
    scenario : Scenario
    policies : sequence or a single policy
        Names, `Policy` objects, functions of (step, positions, previous_velocities, alive), or
        objects with such a method ``velocities``. Their names must differ.
    runs : int
        Number of runs per policy, at least 1.
    seed : int or Generator
        From 0 to 2^64 - 1; of a generator of NumPy, one such integer is drawn: `Study.seed`.
    workers : int or executor
        Number of processes, by default this one only, or an executor: see `Execution`.
    guide : Guide, optional
        By default planned from the scenario, without a certificate; `Study.guide` is the one given.
    solver : str or Solver
        For the formation problems of the policies that are given by name.
    solver_options : mapping, optional
        Options of a solver that is given by name.
    save_trajectories : int
        Number of runs per policy, the first ones, whose trajectories are saved.
    execution, **plain
        Workers and these values of `Execution`, in this record or as plain keywords:

        - `progress`, which receives a policy's name, the number of its finished runs, and their
          total.
        - `checkpoint`, a folder in which results are saved as they are computed, and `if_exists`,
          which is "error", "resume" or "overwrite": what to do with an unfinished study in it.

    Returns
    -------
    Study

    Raises
    ------
    PolicyError
        An unknown, duplicate or failing policy, one that cannot be sent to a worker, or one that
        answers the same state differently: runs in equal states share one answer.
    PlanningError
        No guide was found.
    CheckpointError
        The folder is in use, was made with other inputs, or holds an unfinished study.
    ValueError
        Fewer than one run or worker, or a seed out of range.
    TypeError
        A value that is given plainly and in a record, or is none of these.

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
    require_scenario("simulate", scenario)
    seed, runs = require_seed(seed), require_runs("runs", runs)
    given = plain if workers is None else {**plain, "workers": workers}
    values = given_values("simulate", execution, plain=given, workers=1, **SAVED)
    workers, progress, checkpoint, if_exists = values
    progress = reporter(progress)
    require_workers(workers)
    posed = PosedStudy.of(scenario, policies, guide, solver, solver_options, progress)
    chain = Chain(scenario, posed.velocities, seed)
    inputs = {
        "guide": hashlib.sha256(posed.guide.positions.tobytes()).hexdigest(),
        "runs": runs,
        "save_trajectories": int(save_trajectories),
        "seed": seed,
        "solver": f"{solver} {dict(solver_options)}" if solver_options else str(solver),
    }
    described = partial(study_inputs, "simulate", scenario, posed.policies, **inputs)
    with opened(checkpoint, described, if_exists) as store:
        results = saved_results(store, posed.policies, runs)
        part = part_of(checkpoint)
        batches = missing_batches(
            chain, posed.policies, results, runs, save_trajectories, workers, part
        )
        if workers != 1:
            require_sendable(dict(batches))
        simulate_batches(batches, workers, results, posed.progress, runs, store)
    return _study(posed, seed, results)


def _study(posed: PosedStudy, seed: int, results: Mapping[str, list[Runs]]) -> Study:
    tables, effort, trajectories = [], [], {}
    weights = [case.weight for case in posed.scenario.cases]
    for name, batches in results.items():
        batches.sort(key=lambda part: part.first)
        tables += [run_table(name, part, len(weights)) for part in batches]
        trajectories[name] = tuple(path for part in batches for path in part.trajectories)
        states, seconds = sum(b.states for b in batches), sum(b.seconds for b in batches)
        effort.append({"policy": name, "states": states, "seconds": seconds})
    runs = pd.concat(tables, ignore_index=True)
    summary = summarise(runs)
    cases = with_cases(summary, runs, weights) if len(weights) > 1 else None
    tables_of_runs = summary, paired_table(runs), runs, pd.DataFrame(effort)
    return Study(posed.scenario, posed.guide, seed, *tables_of_runs, trajectories, cases)


def runs_needed(
    scenario: Scenario,
    policies: Any = PAPER_POLICIES,
    half_width: float = 0.005,
    seed: Seed = 0,
    *,
    pilot: int = PILOT,
    guide: Guide | None = None,
    solver: str | Solver = "auto",
) -> int:
    """Number of runs for 95 % intervals of about +- `half_width`, from a pilot study.

    The pilot study's random numbers differ from those of a study with the same seed.

    Parameters
    ----------
    scenario, policies, seed, guide, solver
        As in `simulate`.
    half_width : float
        Between 0 and 1/2.
    pilot : int
        Number of runs of the pilot study.

    Raises
    ------
    ValueError
        A half-width that is not between 0 and 1/2; and as `simulate`.
    """
    require_scenario("runs_needed", scenario)
    if not 0 < half_width < 0.5:
        raise ValueError(f"half_width = {half_width}; allowed: between 0 and 0.5")
    seed, pilot = require_seed(seed), require_runs("pilot", pilot)
    posed = PosedStudy.of(scenario, policies, guide, solver)
    chain = Chain(scenario, posed.velocities, seed, Purpose.PILOT)
    runs = [chain.run(repeated(policy), 0, pilot) for policy in posed.policies]
    successes = [int((part.arrival >= 0).sum()) for part in runs]
    return max(required_runs(half_width, number, pilot) for number in successes)
