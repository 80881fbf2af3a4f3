"""Intervals for what was sampled."""

from __future__ import annotations

import math
from dataclasses import dataclass

from scipy.stats import binomtest, norm

from ..typing import BoolArray

LEVEL = 0.95
"""Confidence level of every interval that casswarm prints, unless it says otherwise."""


def wilson(successes: float, runs: float, level: float = LEVEL) -> tuple[float, float]:
    """Wilson's score interval (J. Amer. Statist. Assoc. 22, 1927) for a probability.

    Parameters
    ----------
    successes, runs : float
        0 <= successes <= runs, runs > 0; no whole numbers where `runs` is an effective number.
    level : float

    Returns
    -------
    low, high : float
    """
    z, mean = float(norm.ppf((1 + level) / 2)), successes / runs
    scale = 1 + z**2 / runs
    middle = (mean + z**2 / (2 * runs)) / scale
    half = z * math.sqrt(mean * (1 - mean) / runs + (z / (2 * runs)) ** 2) / scale
    return max(0.0, middle - half) if successes else 0.0, (
        min(1.0, middle + half) if successes < runs else 1.0
    )


def effective_runs(outcomes: BoolArray) -> float:
    """How many independent runs are as good as one run from each of R strata of equal mass.

    The variance of the sum of outcomes is at most the binomial's (Hoeffding, Ann. Math. Statist.
    27, 1956), and less by as much as strata differ. Neighbours show how much: the squared
    differences of pairs of them sum, in the mean, to no less than the variance (collapsed strata:
    Cochran, Sampling Techniques, 3rd ed. 1977, section 5A.12). One discordant pair is added, so
    that few of them are not taken for none. An interval of a proportion with the effective number
    in the place of R is Korn and Graubard's way (Survey Methodology 24, 1998).

    Parameters
    ----------
    outcomes : (R,) bool
        In the order of the strata, R >= 1; the more alike neighbours are, the better.

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


def exact_interval(successes: int, runs: int, level: float = LEVEL) -> tuple[float, float]:
    """Clopper and Pearson's interval (Biometrika 26, 1934), which covers at least `level`.

    Parameters and returns as in `wilson`.
    """
    interval = binomtest(successes, runs).proportion_ci(level, method="exact")
    return float(interval.low), float(interval.high)


def runs_for(half_width: float, successes: int, pilot: int, level: float = LEVEL) -> int:
    """Runs after which Wilson's interval is no wider than +- `half_width`.

    The probability is not known; a pilot brackets it, and the worst value in its Wilson interval
    (of level 0.99) decides. Runs that are chosen so, before the study, bias nothing; stopping when
    an interval happens to be narrow would.

    Parameters
    ----------
    half_width : float
        Between 0 and 1/2.
    successes, pilot : int
        Of the pilot.
    level : float
    """
    low, high = wilson(successes, pilot, 0.99)
    worst = min(max(0.5, low), high)

    def enough(runs: int) -> bool:
        bottom, top = wilson(round(worst * runs), runs, level)
        return top - bottom <= 2 * half_width

    least, most = 1, 2
    while not enough(most):
        least, most = most, 2 * most
    while least < most:
        middle = (least + most) // 2
        least, most = (least, middle) if enough(middle) else (middle + 1, most)
    return most


@dataclass(frozen=True)
class Paired:
    """Two policies on the same random numbers, run by run.

    Parameters
    ----------
    both, first, second, neither : int
        Runs in which both succeeded, the first alone, the second alone, or neither.
    """

    both: int
    first: int
    second: int
    neither: int

    @property
    def runs(self) -> int:
        """All of them."""
        return self.both + self.first + self.second + self.neither

    @property
    def difference(self) -> float:
        """Success of the first minus success of the second."""
        return (self.first - self.second) / self.runs

    def interval(self, level: float = LEVEL) -> tuple[float, float]:
        """Interval of the difference: Newcombe's method 10 for pairs (Stat. Med. 17, 1998, 2635).

        Wilson's intervals of the two, put together with the correlation of the pairs.
        """
        wins = (self.both + self.first, self.both + self.second)
        p, q = (won / self.runs for won in wins)
        (p_low, p_high), (q_low, q_high) = (wilson(won, self.runs, level) for won in wins)
        correlation = self._correlation()

        def together(a: float, b: float) -> float:
            return math.sqrt(max(0.0, a * a - 2 * correlation * a * b + b * b))

        below, above = together(p - p_low, q_high - q), together(p_high - p, q - q_low)
        return self.difference - below, self.difference + above

    def _correlation(self) -> float:
        """Of the pairs, corrected for continuity where it is positive, as the method has it."""
        a, b, c, d = self.both, self.first, self.second, self.neither
        scale = math.sqrt(float(a + b) * float(c + d) * float(a + c) * float(b + d))
        if scale == 0.0:
            return 0.0
        product = float(a * d - b * c)
        if product > 0:
            product = max(0.0, product - self.runs / 2)
        return product / scale

    @property
    def p_value(self) -> float:
        """McNemar's exact test that the two are equal: a binomial test of the discordant runs."""
        discordant = self.first + self.second
        return float(binomtest(self.first, discordant).pvalue) if discordant else 1.0

    @property
    def variance_ratio(self) -> float:
        """Variance of the difference with common random numbers to that with independent ones.

        Below 1 where common random numbers help; NaN where nothing varies.
        """
        p, q = ((self.both + alone) / self.runs for alone in (self.first, self.second))
        apart = p * (1 - p) + q * (1 - q)
        covariance = self.both / self.runs - p * q
        return 1.0 - 2.0 * covariance / apart if apart > 0 else math.nan
