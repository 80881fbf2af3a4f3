"""Intervals for what was sampled."""

from __future__ import annotations

from scipy.stats import binomtest

LEVEL = 0.95
"""Confidence level of every interval that casswarm prints, unless it says otherwise."""


def wilson(successes: int, runs: int, level: float = LEVEL) -> tuple[float, float]:
    """Wilson's score interval (J. Amer. Statist. Assoc. 22, 1927) for a probability.

    Parameters
    ----------
    successes, runs : int
        0 <= successes <= runs, runs >= 1.
    level : float

    Returns
    -------
    low, high : float
    """
    interval = binomtest(successes, runs).proportion_ci(level, method="wilson")
    return float(interval.low), float(interval.high)
