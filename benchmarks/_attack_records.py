"""What the claims of ``attack.py`` yield, and how it is counted."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field
from typing import NamedTuple

from scipy.stats import binom

MIN_COVERAGE, COVERAGE_LEVEL = 0.93, 1e-6
"""Intervals of 95 % are a violation if the binomial test of this level excludes this coverage."""


class Skip(Exception):  # noqa: N818  (not an error)
    """A draw, or the rest of it, that checks nothing, with the reason."""


class Check(NamedTuple):
    """A comparison: the claim `part` holds if `excess` <= `limit` (NaN does not).

    Parameters
    ----------
    part : str
        Which part of the claim.
    excess, limit : float
    detail : str
        What was compared, printed with a violation.
    """

    part: str
    excess: float
    limit: float = 0.0
    detail: str = ""

    @property
    def holds(self) -> bool:
        """Whether the claim holds."""
        return bool(self.excess <= self.limit)


class Trial(NamedTuple):
    """Whether a 95 % interval missed the exact value."""

    part: str
    missed: bool


@dataclass
class Tally:
    """Counts of one part of a claim."""

    checks: int = 0
    violations: int = 0
    worst: float = -float("inf")
    limit: float = float("nan")
    misses: int | None = None

    def add(self, record: Check | Trial) -> None:
        """Count a record."""
        self.checks += 1
        if isinstance(record, Trial):
            self.misses = (self.misses or 0) + record.missed
            return
        self.violations += not record.holds
        excess = record.excess if record.excess == record.excess else float("inf")
        if not excess - record.limit <= self.worst - (self.limit if self.checks > 1 else 0.0):
            self.worst, self.limit = excess, record.limit

    @property
    def coverage(self) -> float | None:
        """Fraction of the intervals that contain the exact value; None for other claims."""
        return None if self.misses is None else 1 - self.misses / self.checks

    @property
    def covers_too_little(self) -> bool:
        """Whether the coverage is below `MIN_COVERAGE`, beyond chance."""
        if self.misses is None:
            return False
        chance = binom.sf(self.misses - 1, self.checks, 1 - MIN_COVERAGE)
        return bool(chance < COVERAGE_LEVEL)


@dataclass
class Record:
    """Counts of one claim.

    Parameters
    ----------
    draws : int
    parts : dict of name to Tally
    skipped : Counter
        Reasons.
    crashes : int
        Draws that raised an exception which is not one of casswarm's own.
    """

    draws: int = 0
    parts: dict[str, Tally] = field(default_factory=dict)
    skipped: Counter[str] = field(default_factory=Counter)
    crashes: int = 0

    @property
    def violations(self) -> int:
        """Violated checks, crashes, and parts whose coverage is too low."""
        tallies = self.parts.values()
        return self.crashes + sum(t.violations + t.covers_too_little for t in tallies)

    def add(self, record: Check | Trial) -> None:
        """Count a record."""
        self.parts.setdefault(record.part, Tally()).add(record)
