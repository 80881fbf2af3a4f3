"""Runs of a study in batches: simulated by workers, saved in a checkpoint."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial
from numbers import Integral

from .._util.parallel import Workers, done_jobs
from ..chain.monte_carlo import Chain, Runs
from ..policies.base import Policy
from ..typing import Progress
from .checkpoint import Checkpoint, file_name

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
) -> list[Job]:
    """Jobs of the runs that `results` lacks, in batches of a size that keeps all workers busy."""
    number = int(workers) if isinstance(workers, Integral) else _EXECUTOR_SIZE
    size = min(BATCH, runs if number == 1 else -(-runs // (2 * number)))
    return [
        (policy.name, partial(chain.run, policy, first, min(size, end - first), saved))
        for policy in policies
        for start, end in _gaps(results[policy.name], runs)
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
        part = _saved_runs(store, name)
        policy = by_file_name.get(name.split("-", 2)[-1])
        if part is None or policy is None:
            continue
        end = results[policy][-1].end if results[policy] else 0
        if end <= part.first and part.end <= runs:
            results[policy].append(part)
    return results


def _saved_runs(store: Checkpoint, name: str) -> Runs | None:
    """Runs of a record; None if it holds no runs."""
    record = store.load(name)
    try:
        return None if record is None else Runs.from_arrays(record)
    except (KeyError, TypeError, ValueError, OverflowError):
        return None


def _gaps(saved: Sequence[Runs], runs: int) -> list[tuple[int, int]]:
    """Ranges (first, last + 1) of runs that are not among the saved ones."""
    ends = [0, *(part.end for part in saved)]
    firsts = [*(part.first for part in saved), runs]
    return [(a, b) for a, b in zip(ends, firsts, strict=True) if a < b]
