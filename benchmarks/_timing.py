"""Timing and tables that all benchmarks share: medians, ratios within one run, Markdown.

Machines differ and are shared: ratios of programs that run in turn say more than seconds.
"""

from __future__ import annotations

import argparse
import math
import os
import statistics
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, Generic, NamedTuple, TypeVar

import numpy as np

T = TypeVar("T")


class Timed(NamedTuple, Generic[T]):
    """A result, and the median seconds it took: wall-clock time, and CPU time with children."""

    result: T
    wall: float
    cpu: float

    def __str__(self) -> str:
        return f"{self.wall:.2f} s ({self.cpu:.2f})"


def timed(work: Callable[[], T], repeats: int = 1) -> Timed[T]:
    """Call `work` some times; its last result and medians of its times."""
    walls, cpus = [], []
    for _ in range(repeats):
        wall, cpu = time.perf_counter(), _cpu()
        result = work()
        walls.append(time.perf_counter() - wall)
        cpus.append(_cpu() - cpu)
    return Timed(result, statistics.median(walls), statistics.median(cpus))


def _cpu() -> float:
    """CPU time of this process, finely, and of its children, coarsely."""
    return time.process_time() + sum(os.times()[2:4])


def in_turn(
    first: Callable[[], object], second: Callable[[], object], repeats: int
) -> tuple[float, float, float]:
    """Median wall-clock times of two programs run in turn, and the median ratio second / first.

    Both are called once before, so that nothing is compiled or loaded while they are timed.
    """
    first(), second()
    pairs = [(timed(first).wall, timed(second).wall) for _ in range(repeats)]
    ones, others = zip(*pairs, strict=True)
    ratio = statistics.median(b / a for a, b in pairs)
    return statistics.median(ones), statistics.median(others), ratio


def print_table(columns: Sequence[str], rows: Iterable[Iterable[object]]) -> None:
    """Print a Markdown table, each row as soon as it is there."""
    for line in _lines(columns, rows):
        print(line, flush=True)
    print()


def markdown(columns: Sequence[str], rows: Iterable[Iterable[object]]) -> str:
    """A Markdown table."""
    return "\n".join(_lines(columns, rows))


def _lines(columns: Sequence[str], rows: Iterable[Iterable[object]]) -> Iterator[str]:
    yield f"| {' | '.join(columns)} |\n|{' --- |' * len(columns)}"
    for row in rows:
        yield f"| {' | '.join(map(_text, row))} |"


def _text(value: object) -> str:
    if isinstance(value, float | np.floating):
        return "" if math.isnan(value) else f"{value:.4g}"
    return str(value)


def arguments(
    description: str | None, parts: Mapping[str, Any] | None = None, out: str | None = None
) -> argparse.Namespace:
    """Command-line arguments of a benchmark: ``parts``, ``quick`` and ``out``.

    Parameters
    ----------
    description : str
        The module's docstring, whose first line is shown.
    parts : mapping, optional
        Parts that can be chosen by name; all by default.
    out : str, optional
        Default of ``--out``, a folder for tables and figures; None if the benchmark writes none.
    """
    parser = argparse.ArgumentParser(description=(description or "").splitlines()[0])
    known = list(parts or {})
    if known:
        parser.add_argument("parts", nargs="*", metavar="PART", help=", ".join(known))
    parser.add_argument("--quick", action="store_true", help="fewer cases, states and repeats")
    if out is not None:
        parser.add_argument("--out", type=Path, default=Path(out) if out else None)
    options = parser.parse_args()
    if unknown := set(getattr(options, "parts", [])) - set(known):
        parser.error(f"unknown part {', '.join(sorted(unknown))}; known: {', '.join(known)}")
    options.parts = getattr(options, "parts", []) or known
    return options
