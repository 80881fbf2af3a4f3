"""A study: several policies simulated on one scenario, as tables."""

from __future__ import annotations

import pickle
import signal
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Executor, ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass, field
from multiprocessing import get_context
from numbers import Integral
from typing import TYPE_CHECKING, Any

import pandas as pd

from .chain.simulate import Chain, Runs, Trace
from .errors import PolicyError
from .guide import Guide
from .planning import plan
from .policies import as_policy, initial_velocities, make_policy
from .policies.base import Policy
from .solvers import Solver
from .tables import run_table, summarise

if TYPE_CHECKING:
    from .scenario import Scenario

PAPER_POLICIES = ("naive", "constrained", "leader")
"""The three policies that the paper compares, in its order."""

BATCH = 20_000
"""Runs that advance together at the most: bounds memory, changes no result."""

Progress = Callable[[str, int, int], None]


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
    runs : DataFrame
        A row a run: policy, run, success, survivors, arrival_step (missing where no member
        arrived), steps, shortfalls, solver_failures, resolved, clipped.
    effort : DataFrame
        A row a policy: distinct states in which it was asked, seconds. Not reproducible.
    traces : dict of policy name to tuple of Trace
        The ways of the first runs.
    """

    scenario: Scenario = field(repr=False)
    guide: Guide
    seed: int
    summary: pd.DataFrame
    runs: pd.DataFrame = field(repr=False)
    effort: pd.DataFrame = field(repr=False)
    traces: dict[str, tuple[Trace, ...]] = field(repr=False)

    def __str__(self) -> str:
        return f"{self.guide}\n{self.summary.to_string(index=False)}"


def simulate(
    scenario: Scenario,
    policies: Sequence[Any] = PAPER_POLICIES,
    runs: int = 1000,
    seed: int = 0,
    workers: int = 1,
    *,
    guide: Guide | None = None,
    solver: str | Solver = "auto",
    traces: int = 1,
    progress: Progress | None = None,
) -> Study:
    """Estimate by Monte Carlo how often the swarm reaches the target under each policy.

    Success means that some member arrives alive by t_f. The same run index sees the same random
    numbers under every policy. The tables depend on the scenario, the guide, the policies, the
    number of runs and the seed only, not on workers or batches.

    Parameters
    ----------
    scenario : Scenario
    policies : sequence
        Names, `Policy` objects, functions of (step, positions, previous, alive), or objects with
        such a method ``velocities``. Their names must differ.
    runs : int
        Runs of every policy, at least 1.
    seed : int
        At least 0.
    workers : int
        Processes that share the runs; 1 stays in this process. In a script, more than one needs
        the guard ``if __name__ == "__main__":``, since workers import the script again.
    guide : Guide, optional
        Planned from the scenario by default.
    solver : str or Solver
        Of the formation problems of the policies that are given by name.
    traces : int
        Runs of every policy whose way is kept.
    progress : callable, optional
        Called with a policy's name, the number of its runs that have ended, and their total.

    Returns
    -------
    Study

    Raises
    ------
    PolicyError
        An unknown, duplicate or failing policy, or one that cannot be sent to a worker.
    PlanningError
        No guide was found.
    ValueError
        Fewer than one run or worker, or a negative seed.
    """
    for name, value, least in (("runs", runs, 1), ("workers", workers, 1), ("seed", seed, 0)):
        if not isinstance(value, Integral) or value < least:
            raise ValueError(f"{name} = {value}; allowed: whole numbers from {least}")
    guide = plan(scenario) if guide is None else guide
    made = _named(scenario, policies, guide, solver)
    chain = Chain(scenario, initial_velocities(scenario, guide), seed)
    size = min(BATCH, runs if workers == 1 else -(-runs // (2 * workers)))
    jobs = [
        _Job(chain, policy, first, min(size, runs - first), max(0, min(size, traces - first)))
        for policy in made
        for first in range(0, runs, size)
    ]
    parts: dict[str, list[tuple[Runs, float]]] = {policy.name: [] for policy in made}
    for job, part, seconds in _finished(jobs, workers, progress, runs):
        parts[job.policy.name].append((part, seconds))
    return _study(scenario, guide, seed, parts)


@dataclass(frozen=True)
class _Job:
    chain: Chain
    policy: Policy
    first: int
    runs: int
    traces: int

    def __call__(self, progress: Callable[[int], None] | None = None) -> tuple[Runs, float]:
        started = time.perf_counter()
        part = self.chain.run(self.policy, self.first, self.runs, self.traces, progress)
        return part, time.perf_counter() - started


def _named(
    scenario: Scenario, policies: Sequence[Any], guide: Guide, solver: str | Solver
) -> list[Policy]:
    if isinstance(policies, (str, Policy)):
        raise PolicyError(f"policies must be a list; for a single one give [{policies!r}]")
    made = [
        make_policy(policy, scenario, guide, solver)
        if isinstance(policy, str)
        else as_policy(policy)
        for policy in policies
    ]
    names = [policy.name for policy in made]
    repeated = sorted({name for name in names if names.count(name) > 1})
    if repeated or not names:
        raise PolicyError(
            f"policies need names that differ; repeated: {', '.join(repeated)}; "
            "as_policy(function, name) gives one a name"
            if repeated
            else "no policy given"
        )
    return made


def _finished(
    jobs: list[_Job], workers: int, progress: Progress | None, runs: int
) -> Iterator[tuple[_Job, Runs, float]]:
    """Jobs with their outcome, as they end."""
    done = {job.policy.name: 0 for job in jobs}

    def tell(job: _Job, ended: int) -> None:
        if progress is not None:
            progress(job.policy.name, done[job.policy.name] + ended, runs)

    if workers == 1:
        for job in jobs:
            part, seconds = job(lambda ended, job=job: tell(job, ended))  # type: ignore[misc]
            done[job.policy.name] += job.runs
            tell(job, 0)
            yield job, part, seconds
        return
    _require_sendable(jobs)
    # spawned, not forked: CasADi and Ipopt's linear solver do not survive a fork of their threads
    pool = ProcessPoolExecutor(workers, get_context("spawn"), initializer=_leave_interrupts)
    try:
        yield from _gathered(pool, jobs, done, tell)
    except BaseException:  # nobody waits for work that nobody will read
        processes = list((pool._processes or {}).values())
        pool.shutdown(wait=False, cancel_futures=True)
        for process in processes:
            process.terminate()
        raise
    pool.shutdown()


def _leave_interrupts() -> None:
    """Ctrl-C is for the parent, which ends its workers."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)


def _require_sendable(jobs: list[_Job]) -> None:
    """Raise PolicyError for what does not pickle; a pool whose tasks do not ends untidily."""
    for policy, job in {job.policy.name: job for job in jobs}.items():
        try:
            pickle.dumps(job)
        except (pickle.PicklingError, AttributeError, TypeError) as error:
            raise PolicyError(
                f"policy {policy!r}, or the scenario's hazard, cannot be sent to a worker "
                f"({error}): define its function in a module, or use workers=1"
            ) from error


def _gathered(
    pool: Executor, jobs: list[_Job], done: dict[str, int], tell: Callable[[_Job, int], None]
) -> Iterator[tuple[_Job, Runs, float]]:
    futures = {pool.submit(job): job for job in jobs}
    for future in as_completed(futures):
        job = futures[future]
        try:
            part, seconds = future.result()
        except BrokenProcessPool as error:
            raise PolicyError(
                "a worker process died: in a script, call simulate with workers > 1 only under "
                "`if __name__ == '__main__':`, and never from standard input; or use workers=1"
            ) from error
        done[job.policy.name] += job.runs
        tell(job, 0)
        yield job, part, seconds


def _study(
    scenario: Scenario, guide: Guide, seed: int, parts: dict[str, list[tuple[Runs, float]]]
) -> Study:
    tables, effort, traces = [], [], {}
    for name, done in parts.items():
        done.sort(key=lambda item: item[0].first)
        tables.append(pd.concat([run_table(name, part) for part, _ in done], ignore_index=True))
        traces[name] = tuple(trace for part, _ in done for trace in part.traces)
        effort.append(
            {
                "policy": name,
                "states": sum(part.states for part, _ in done),
                "seconds": sum(seconds for _, seconds in done),
            }
        )
    runs = pd.concat(tables, ignore_index=True)
    return Study(scenario, guide, seed, summarise(runs), runs, pd.DataFrame(effort), traces)
