"""The runs of a study in jobs: shared out, and kept as they are done."""

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
"""Runs that advance together at the most: bounds memory, changes no result."""

_SHARES = 8
"""Jobs of a policy that an executor gets, twice: it does not tell how many it can do at once."""

Parts = dict[str, list[tuple[Runs, float]]]
"""Runs that are done, by policy, and the seconds that they took."""


@dataclass(frozen=True)
class Job:
    """Some runs of a policy; called, it samples them and tells the seconds that it took."""

    chain: Chain
    policy: Policy
    first: int
    runs: int
    traces: int

    def __call__(self, progress: Progress | None = None) -> tuple[Runs, float]:
        """The runs, and the seconds that they took."""
        started = time.perf_counter()
        part = self.chain.run(self.policy, self.first, self.runs, self.traces, progress)
        return part, time.perf_counter() - started

    @property
    def name(self) -> str:
        """Of the cell that keeps its outcome."""
        return f"{self.first:012d}-{self.runs:06d}-{file_name(self.policy.name)}"


def jobs_left(
    chain: Chain,
    made: Sequence[Policy],
    kept: Parts,
    runs: int,
    traces: int,
    workers: Workers,
) -> list[Job]:
    """What is still to be done, in batches that keep the workers busy."""
    number = int(workers) if isinstance(workers, Integral) else _SHARES
    size = min(BATCH, runs if number == 1 else -(-runs // (2 * number)))
    return [
        Job(chain, policy, first, min(size, end - first), max(0, min(size, traces - first)))
        for policy in made
        for start, end in _gaps(kept[policy.name], runs)
        for first in range(start, end, size)
    ]


def sample_jobs(
    jobs: list[Job],
    workers: Workers,
    parts: Parts,
    progress: Progress | None,
    runs: int,
    store: Checkpoint | None,
) -> None:
    """Add the outcome of every job to `parts`, and keep it, as soon as it is there."""
    done = {name: sum(len(part.arrival) for part, _ in kept) for name, kept in parts.items()}

    def tell(policy: str, ended: float = 0, total: float | None = None) -> None:  # noqa: ARG001
        if progress is not None:
            progress(policy, done[policy] + ended, runs)

    for name, ended in done.items():
        if ended:
            tell(name)
    calls: list[Callable[[], tuple[Runs, float]]] = (
        [partial(job, tell) for job in jobs] if workers == 1 else list(jobs)
    )
    for place, (part, seconds) in done_jobs(calls, workers):
        job = jobs[place]
        if store is not None:
            store.save(job.name, part.to_arrays() | {"seconds": np.array(seconds)})
        parts[job.policy.name].append((part, seconds))
        done[job.policy.name] += job.runs
        tell(job.policy.name)


def kept_parts(store: Checkpoint | None, made: Sequence[Policy], runs: int) -> Parts:
    """What an earlier study kept, without overlaps."""
    parts: Parts = {policy.name: [] for policy in made}
    if store is None:
        return parts
    by_cell = {file_name(policy.name): policy.name for policy in made}
    for name in store.names():  # by their first run
        cell = store.load(name)
        policy = by_cell.get(name.split("-", 2)[-1])
        if cell is None or policy is None:
            continue
        part = Runs.from_arrays(cell)
        end = parts[policy][-1][0].end if parts[policy] else 0
        if end <= part.first and part.end <= runs:
            parts[policy].append((part, float(cell["seconds"])))
    return parts


def _gaps(kept: Sequence[tuple[Runs, float]], runs: int) -> list[tuple[int, int]]:
    """First and last + 1 of the stretches of runs that nobody has done."""
    ends = [0, *(part.end for part, _ in kept)]
    firsts = [*(part.first for part, _ in kept), runs]
    return [(a, b) for a, b in zip(ends, firsts, strict=True) if a < b]
