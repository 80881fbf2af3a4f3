"""Runs of a study in batches: simulated by workers, saved in a checkpoint."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from numbers import Integral

import numpy as np

from .._util.parallel import Workers, done_jobs
from ..chain.monte_carlo import Chain, Runs
from ..policies.base import Policy
from ..typing import Progress
from .checkpoint import Checkpoint, file_name

BATCH = 20_000
"""Maximum number of runs that are simulated together: bounds memory, changes no result."""

_EXECUTOR_SIZE = 8
"""Assumed number of workers of an executor, which does not report it."""

BatchResults = dict[str, list[tuple[Runs, float]]]
"""Simulated batches by policy, each with the seconds that it took."""


@dataclass(frozen=True)
class Batch:
    """Consecutive runs of a policy, as a job for a worker."""

    chain: Chain
    policy: Policy
    first: int
    runs: int
    save_trajectories: int

    def __call__(self, progress: Progress | None = None) -> tuple[Runs, float]:
        """Simulate the runs; also return the seconds that they took."""
        started = time.perf_counter()
        options = (self.first, self.runs, self.save_trajectories)
        runs = self.chain.run(self.policy, *options, progress)
        return runs, time.perf_counter() - started

    @property
    def name(self) -> str:
        """Name of the checkpoint record."""
        return f"{self.first:012d}-{self.runs:06d}-{file_name(self.policy.name)}"


def missing_batches(
    chain: Chain,
    policies: Sequence[Policy],
    results: BatchResults,
    runs: int,
    save_trajectories: int,
    workers: Workers,
) -> list[Batch]:
    """Runs that `results` lacks, in batches of a size that keeps all workers busy."""
    number = int(workers) if isinstance(workers, Integral) else _EXECUTOR_SIZE
    size = min(BATCH, runs if number == 1 else -(-runs // (2 * number)))
    return [
        Batch(chain, policy, first, length, max(0, min(size, save_trajectories - first)))
        for policy in policies
        for start, end in _gaps(results[policy.name], runs)
        for first in range(start, end, size)
        for length in [min(size, end - first)]
    ]


def simulate_batches(
    batches: list[Batch],
    workers: Workers,
    results: BatchResults,
    progress: Progress | None,
    runs: int,
    store: Checkpoint | None,
) -> None:
    """Add every batch to `results`, and save it, as soon as it is finished."""
    done = {name: sum(len(part.arrival) for part, _ in saved) for name, saved in results.items()}

    def report(policy: str, finished: float = 0, total: float | None = None) -> None:  # noqa: ARG001
        if progress is not None:
            progress(policy, done[policy] + finished, runs)

    for name, finished in done.items():
        if finished:
            report(name)
    jobs: list[Callable[[], tuple[Runs, float]]] = (
        [partial(batch, report) for batch in batches] if workers == 1 else list(batches)
    )
    for index, (part, seconds) in done_jobs(jobs, workers):
        batch = batches[index]
        if store is not None:
            store.save(batch.name, part.to_arrays() | {"seconds": np.array(seconds)})
        results[batch.policy.name].append((part, seconds))
        done[batch.policy.name] += batch.runs
        report(batch.policy.name)


def saved_results(store: Checkpoint | None, policies: Sequence[Policy], runs: int) -> BatchResults:
    """Batches of a checkpoint, without overlaps."""
    results: BatchResults = {policy.name: [] for policy in policies}
    if store is None:
        return results
    by_file_name = {file_name(policy.name): policy.name for policy in policies}
    for name in store.names():  # ordered by their first run
        record = store.load(name)
        policy = by_file_name.get(name.split("-", 2)[-1])
        if record is None or policy is None:
            continue
        part = Runs.from_arrays(record)
        end = results[policy][-1][0].end if results[policy] else 0
        if end <= part.first and part.end <= runs:
            results[policy].append((part, float(record["seconds"])))
    return results


def _gaps(saved: Sequence[tuple[Runs, float]], runs: int) -> list[tuple[int, int]]:
    """Ranges (first, last + 1) of runs that are not among the saved ones."""
    ends = [0, *(part.end for part, _ in saved)]
    firsts = [*(part.first for part, _ in saved), runs]
    return [(a, b) for a, b in zip(ends, firsts, strict=True) if a < b]
