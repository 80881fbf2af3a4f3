"""Confidence intervals of sampled probabilities, and tests of paired runs."""

from __future__ import annotations

import math
from bisect import bisect_left
from dataclasses import dataclass

from ..typing import BoolArray, Interval

LEVEL = 0.95
"""Confidence level of every interval that casswarm prints, unless it says otherwise."""

FEW = 50
"""Successes or failures below which the interval of a stratified sample is an exact one."""


def wilson(successes: float, runs: float, level: float = LEVEL) -> Interval:
    """Wilson's score interval (J. Amer. Statist. Assoc. 22, 1927) for a probability.

    Parameters
    ----------
    successes, runs : float
        0 <= successes <= runs, runs > 0; not integers where `runs` is an effective number.
    level : float
    """
    from scipy.special import ndtri  # slow to import

    z, mean = float(ndtri((1 + level) / 2)), successes / runs
    scale = 1 + z**2 / runs
    middle = (mean + z**2 / (2 * runs)) / scale
    half = z * math.sqrt(mean * (1 - mean) / runs + (z / (2 * runs)) ** 2) / scale
    low = max(0.0, middle - half) if successes else 0.0
    return Interval(low, min(1.0, middle + half) if successes < runs else 1.0)


def clopper_pearson(successes: int, runs: int, level: float = LEVEL) -> Interval:
    """Interval that holds the mean of the runs' probabilities with at least its level.

    The exact interval of a binomial proportion (Clopper and Pearson, Biometrika 26, 1934). It holds
    for independent runs of different probabilities too: more than one run from its mean, the tails
    of the number of successes are at most the binomial's (Hoeffding, Ann. Math. Statist. 27, 1956);
    for a single success or failure the union bound gives the end.

    Parameters
    ----------
    successes, runs : int
        0 <= successes <= runs, runs > 0.
    level : float
    """
    from scipy.special import betaincinv  # slow to import

    tail = (1 - level) / 2

    def lower_end(count: int) -> float:
        if count < 2:
            return count * tail / runs
        return float(betaincinv(count, runs - count + 1, tail))

    return Interval(lower_end(successes), 1.0 - lower_end(runs - successes))


def stratified_interval(
    successes: int, runs: int, effective: float, level: float = LEVEL
) -> Interval:
    """Interval of the mean of the runs' probabilities, with one run from each of equal strata.

    `wilson` with the `effective` runs; `clopper_pearson` where fewer than `FEW` runs succeed or
    fail, since the levels of both Wilson's interval and of an estimated variance are then nominal.
    """
    if min(successes, runs - successes) < FEW:
        return clopper_pearson(successes, runs, level)
    return wilson(successes / runs * effective, effective, level)


def effective_runs(outcomes: BoolArray) -> float:
    """Number of independent runs with the same variance as one run from each of R equal strata.

    The variance of the sum of outcomes is at most the binomial's (Hoeffding, Ann. Math. Statist.
    27, 1956), and smaller the more the strata differ. Pairs of neighbours bound it: the expected
    sum of their squared differences is at least the variance (collapsed strata: Cochran, Sampling
    Techniques, 3rd ed. 1977, section 5A.12). One discordant pair is added, so that a small number
    of them is not taken for zero. Using the effective number instead of R in the interval of a
    proportion is Korn and Graubard's method (Survey Methodology 24, 1998).

    Parameters
    ----------
    outcomes : (R,) bool
        In the order of the strata, R >= 1; neighbouring strata should be similar.

    Returns
    -------
    float
        At least R.
    """
    runs, pairs = len(outcomes), len(outcomes) // 2
    mean = float(outcomes.mean())
    if not 0 < mean < 1 or not pairs:
        return float(runs)
    discordant = int((outcomes[: 2 * pairs : 2] != outcomes[1 : 2 * pairs : 2]).sum())
    return runs * max(1.0, mean * (1 - mean) / ((discordant + 1) / (2 * pairs)))


def required_runs(half_width: float, successes: int, pilot: int) -> int:
    """Number of runs after which Wilson's interval is no wider than +- `half_width`.

    The probability is unknown; the worst value in the Wilson interval (of level 0.99) of a pilot
    study is assumed. Choosing the number of runs in advance does not bias the study; stopping when
    an interval happens to be narrow would.

    Parameters
    ----------
    half_width : float
        Between 0 and 1/2.
    successes, pilot : int
        Successes and runs of the pilot study.
    """
    low, high = wilson(successes, pilot, 0.99)
    worst = min(max(0.5, low), high)

    def sufficient(runs: int) -> bool:
        return wilson(round(worst * runs), runs).width <= 2 * half_width

    upper = 2
    while not sufficient(upper):
        upper *= 2
    return upper // 2 + bisect_left(range(upper // 2, upper), True, key=sufficient)


@dataclass(frozen=True)
class Paired:
    """Outcomes of two policies with common random numbers, run by run.

    Parameters
    ----------
    both, first_only, second_only, neither : int
        Numbers of runs in which both, only the first, only the second or neither succeeded.
    """

    both: int
    first_only: int
    second_only: int
    neither: int

    @property
    def runs(self) -> int:
        """Number of pairs of runs."""
        return self.both + self.first_only + self.second_only + self.neither

    @property
    def difference(self) -> float:
        """Success rate of the first policy minus that of the second."""
        return (self.first_only - self.second_only) / self.runs

    def interval(self, level: float = LEVEL) -> Interval:
        """Interval of the difference: Newcombe's method 10 for pairs (Stat. Med. 17, 1998, 2635).

        It combines the Wilson intervals of both policies by the correlation of the pairs.
        """
        successes = (self.both + self.first_only, self.both + self.second_only)
        p, q = (count / self.runs for count in successes)
        (p_low, p_high), (q_low, q_high) = (wilson(k, self.runs, level) for k in successes)
        correlation = self._correlation()

        def combined(a: float, b: float) -> float:
            return math.sqrt(max(0.0, a * a - 2 * correlation * a * b + b * b))

        below, above = combined(p - p_low, q_high - q), combined(p_high - p, q - q_low)
        return Interval(self.difference - below, self.difference + above)

    def _correlation(self) -> float:
        """Correlation of the pairs, with the method's continuity correction if it is positive."""
        a, b, c, d = self.both, self.first_only, self.second_only, self.neither
        scale = math.sqrt(float(a + b) * float(c + d) * float(a + c) * float(b + d))
        if scale == 0.0:
            return 0.0
        product = float(a * d - b * c)
        if product > 0:
            product = max(0.0, product - self.runs / 2)
        return product / scale

    @property
    def p_value(self) -> float:
        """McNemar's exact test of equal success: a binomial test of the discordant runs."""
        from scipy.special import bdtr  # slow to import

        fewer = min(self.first_only, self.second_only)
        tail = float(bdtr(fewer, self.first_only + self.second_only, 0.5))
        return min(1.0, 2.0 * tail)

    @property
    def variance_ratio(self) -> float:
        """Variance of the difference, relative to that with independent random numbers.

        Below 1 where common random numbers help; NaN where the outcomes do not vary.
        """
        p, q = ((self.both + only) / self.runs for only in (self.first_only, self.second_only))
        independent = p * (1 - p) + q * (1 - q)
        covariance = self.both / self.runs - p * q
        return 1.0 - 2.0 * covariance / independent if independent > 0 else math.nan
