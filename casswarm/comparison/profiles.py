"""Profiles and means of benchmark results, with error bars by resampling problems.

All functions take costs as a table with a row per problem, or copy of it, and a column per solver,
in which failures are infinite. A profile is a table with a row per point at which some curve rises
and a column per solver: the fraction of problems at or below that point.

- E. D. Dolan, J. J. More, Benchmarking optimization software with performance profiles,
  Math. Program. 91 (2002) 201-213.
- J. J. More, S. M. Wild, Benchmarking derivative-free optimization algorithms,
  SIAM J. Optim. 20 (2009) 172-191.
- N. Gould, J. Scott, A note on performance profiles for benchmarking software,
  ACM Trans. Math. Software 43 (2016) 15.

**Error bars.** The problems are a sample of those that one could pose, so a comparison on other
problems of the same kind would differ. The bootstrap estimates by how much: it draws problems with
replacement and repeats the calculation. All runs of a problem (its perturbed copies) are drawn
together, since they are not independent: a cluster bootstrap. Where the numbers of problems of
several kinds are fixed, they are drawn from each: strata.

- B. Efron, R. J. Tibshirani, An Introduction to the Bootstrap, Chapman and Hall, 1993.
- C. A. Field, A. H. Welsh, Bootstrapping clustered data, J. R. Stat. Soc. B 69 (2007) 369-390.
- J. N. K. Rao, C. F. J. Wu, Resampling inference with complex survey data, J. Am. Stat. Assoc. 83
  (1988) 231-241.
- F. E. Satterthwaite, An approximate distribution of estimates of variance components, Biometrics
  Bulletin 2 (1946) 110-114.
- A. Agresti, B. A. Coull, Approximate is better than "exact" for interval estimation of binomial
  proportions, Am. Stat. 52 (1998) 119-126.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations
from statistics import NormalDist

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike
from scipy.special import chdtri

from ..typing import FloatArray, IntArray

LEVEL = 0.95
"""Nominal probability of bands and intervals."""

RESAMPLES = 2000
"""Number of samples that are drawn."""


def cluster_means(values: ArrayLike, clusters: ArrayLike) -> FloatArray:
    """Mean (C, ...) over the rows (N, ...) of every cluster, in the order in which they appear."""
    array = np.asarray(values, dtype=float)
    _, first, member, sizes = np.unique(
        np.asarray(clusters), return_index=True, return_inverse=True, return_counts=True
    )
    sums = np.zeros((len(first), *array.shape[1:]))
    np.add.at(sums, member, array)
    means = sums / sizes.reshape(-1, *[1] * (array.ndim - 1))
    return np.asarray(means[np.argsort(first)])


def resampled_means(
    values: ArrayLike,
    strata: ArrayLike | None = None,
    resamples: int = RESAMPLES,
    seed: int = 0,
) -> FloatArray:
    """Means over clusters that are drawn with replacement, with the spread of a small sample.

    Of the n clusters of a stratum, n - 1 are drawn (Rao and Wu): n would make the variance too
    small by the factor (n - 1) / n. Every resample's deviation from the mean is multiplied by
    sqrt(f / chi2) with a random chi2 of f degrees of freedom (Satterthwaite): so it is distributed
    as Student's t instead of normally, since the variance is estimated from few clusters.

    Of values (C, K), a row per cluster, they are (resamples, K). Strata (C,) keep their sizes in
    every resample; each has at least two clusters, or a ValueError is raised. By default there is
    one for all.
    """
    array = np.asarray(values, dtype=float)
    labels = np.zeros(len(array)) if strata is None else np.asarray(strata)
    _, member, sizes = np.unique(labels, return_inverse=True, return_counts=True)
    if (sizes < 2).any():
        raise ValueError("a stratum of a single cluster has no variance")
    rng = np.random.default_rng(seed)
    weights = np.empty((resamples, len(array)))
    variances = np.empty((len(sizes), array.shape[1]))  # of each stratum's share of the mean
    for stratum, size in enumerate(sizes):
        drawn = rng.multinomial(size - 1, np.full(size, 1.0 / size), size=resamples)
        inside = member == stratum
        weights[:, inside] = drawn * (size / (size - 1) / len(array))
        variances[stratum] = size * array[inside].var(axis=0, ddof=1) / len(array) ** 2
    freedom = _degrees_of_freedom(variances, sizes)
    heavy = np.sqrt(freedom / chdtri(freedom, rng.uniform(size=(resamples, 1))))
    means = array.mean(axis=0)
    return np.asarray(means + heavy * (weights @ array - means))


def fraction_band(fractions: ArrayLike, level: float = LEVEL) -> tuple[FloatArray, FloatArray]:
    """Pointwise confidence band of mean fractions, after Agresti and Coull.

    With z the normal quantile of the level, z^2 / 2 clusters of zeros and as many of ones are added
    (about two of each at 95 %); the band is z standard errors of the mean of all of them. Of
    fractions (C, K) that are 0 or 1, a row per cluster, it is the interval of Agresti and Coull.
    Its ends (K,) are monotone if the rows are.
    """
    array = np.asarray(fractions, dtype=float)
    z = NormalDist().inv_cdf((1 + level) / 2)
    count = len(array) + z**2
    mean = (array.sum(axis=0) + z**2 / 2) / count
    variance = ((array**2).sum(axis=0) + z**2 / 2) / count - mean**2
    error = z * np.sqrt(variance / count)
    return np.maximum(mean - error, 0.0), np.minimum(mean + error, 1.0)


def ranks(scores: ArrayLike) -> FloatArray:
    """Fractional ranks of scores (R, S), from 1 for the least; ties share the mean of theirs."""
    less, equal = _order(np.asarray(scores, dtype=float))
    return 1.0 + less + (equal - 1) / 2


def rank_probabilities(resampled: ArrayLike) -> FloatArray:
    """Probability of each rank of S solvers, by scores (R, S) in R resamples, the least first.

    Row s, column k of the result (S, S) is the fraction of the resamples in which solver s has rank
    k + 1. Solvers with equal scores share their ranks. Rows and columns sum to one.
    """
    less, equal = _order(np.asarray(resampled, dtype=float))
    place = np.arange(less.shape[1])
    held = (place >= less[..., None]) & (place < (less + equal)[..., None])
    return np.asarray((held / equal[..., None]).mean(axis=0))


def _degrees_of_freedom(variances: FloatArray, sizes: IntArray) -> FloatArray:
    """Degrees of freedom of sums (K,) of H estimated variances (H, K) (Satterthwaite 1946)."""
    squares = (variances**2 / (sizes[:, None] - 1)).sum(axis=0)
    full = np.full(len(squares), float((sizes - 1).sum()))
    np.divide(variances.sum(axis=0) ** 2, squares, out=full, where=squares > 0)
    return full


def _order(scores: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Numbers of scores that are less than each, and equal to it up to rounding: (R, S)."""
    mine, other = scores[:, :, None], scores[:, None, :]
    equal = np.isclose(mine, other, rtol=1e-12, atol=0.0)
    return (~equal & (other < mine)).sum(axis=2), equal.sum(axis=2)


def performance_profile(costs: pd.DataFrame) -> pd.DataFrame:
    """Performance profile (Dolan and More): how often a solver is within a factor of the best.

    With r(p, s) = cost(p, s) / min over s of cost(p, s), the fraction of problems with
    r(p, s) <= tau, for every tau at which it changes. At tau = 1 that is how often a solver is the
    fastest (ties count for all), and at the end how often it solves the problem at all.

    Parameters
    ----------
    costs : DataFrame
        A row per problem, a column per solver; above zero, infinite for failures. A problem that
        no solver solves counts as failed by all.

    Returns
    -------
    DataFrame
        Index tau, from 1; a column per solver.

    Raises
    ------
    ValueError
        Costs that are NaN, zero or negative, or no problem.
    """
    return _fractions(_ratios(costs), costs, "tau", [1.0])


def data_profile(costs: pd.DataFrame, units: ArrayLike = 1.0) -> pd.DataFrame:
    """Data profile (More and Wild): fraction of problems that a solver solves within a budget.

    The fraction of problems with cost(p, s) / unit(p) <= kappa. Unlike a performance profile it
    does not depend on the other solvers. More and Wild count function values in units of n + 1, the
    cost of a simplex gradient; with derivatives the natural units are evaluations, or the time of
    one.

    Parameters
    ----------
    costs : DataFrame
        As in `performance_profile`.
    units : scalar or (problems,)

    Returns
    -------
    DataFrame
        Index kappa; a column per solver.

    Raises
    ------
    ValueError
        Costs or units that are NaN, zero or negative, or no problem.
    """
    return _fractions(_budgets(costs, units), costs, "kappa")


def performance_bands(costs: pd.DataFrame) -> tuple[pd.DataFrame, pd.DataFrame]:
    """Pointwise 95 % confidence bands of a performance profile, low and high.

    They are confidence bands for the profile of all problems of this kind.

    Parameters
    ----------
    costs : DataFrame
        As in `performance_profile`. Rows with the same index are copies of one problem, whose mean
        counts: see `casswarm.comparison.profiles.fraction_band`.

    Returns
    -------
    low, high : DataFrame
        With the index and columns of the profile.
    """
    profile = performance_profile(costs)
    return _bands(_ratios(costs), costs, profile.index)


def data_bands(costs: pd.DataFrame, units: ArrayLike = 1.0) -> tuple[pd.DataFrame, pd.DataFrame]:
    """The same of a data profile; `units` as in `data_profile`."""
    profile = data_profile(costs, units)
    return _bands(_budgets(costs, units), costs, profile.index)


def quality_profile(times: pd.DataFrame, qualities: pd.DataFrame) -> pd.DataFrame:
    """Quality of the objectives that are reached within a time, for problems with many minima.

    Rows are problems and columns solvers: the times at which they have their answers, infinite if
    there is none, and the qualities of these, between 0 and 1, such as 1 - gap to the best known
    objective. The index of the result is the time; its values are means over the problems, of 0
    before there is an answer.
    """
    values = _checked(times)
    weights = np.where(np.isfinite(values), qualities[times.columns].to_numpy(dtype=float), 0.0)
    points = np.unique(values[np.isfinite(values)])
    means = {
        solver: np.where(mine[:, None] <= points, weight[:, None], 0.0).mean(axis=0)
        for solver, mine, weight in zip(times.columns, values.T, weights.T, strict=True)
    }
    return pd.DataFrame(means, pd.Index(points, name="seconds"), times.columns)


def pairwise_profiles(costs: pd.DataFrame) -> dict[tuple[str, str], pd.DataFrame]:
    """Performance profile of every pair of solvers.

    In a profile of more than two solvers, the order of those that are not the best can depend on
    the set of solvers (Gould and Scott): only pairs compare two solvers with each other.
    """
    return {(a, b): performance_profile(costs[[a, b]]) for a, b in combinations(costs.columns, 2)}


def pairwise_wins(costs: pd.DataFrame) -> pd.DataFrame:
    """Fraction of problems on which the row's solver is faster than the column's.

    Ties count for neither; solving is faster than failing. The diagonal is NaN.
    """
    values = _checked(costs)
    wins = np.mean(values[:, :, None] < values[:, None, :], axis=0)
    np.fill_diagonal(wins, np.nan)
    return pd.DataFrame(wins, index=costs.columns, columns=costs.columns)


def shifted_geometric_mean(costs: ArrayLike, shift: float) -> FloatArray:
    """Shifted geometric mean (product of (cost + shift))^(1/P) - shift of costs (P, ...).

    The shift limits the influence of problems with tiny costs. Infinite where a cost is: to count
    failures at a limit, replace them first.

    Raises
    ------
    ValueError
        A negative cost, or a shift that is not above zero.
    """
    values = np.asarray(costs, dtype=float)
    if not shift > 0 or not (values >= 0).all():
        raise ValueError("costs must not be negative, and the shift must be above zero")
    return np.asarray(np.exp(np.log(values + shift).mean(axis=0)) - shift)


def fraction_at(profile: pd.DataFrame, point: float) -> pd.Series:
    """Value of every curve of a profile at a point."""
    row = int(np.searchsorted(profile.index.to_numpy(), point, side="right")) - 1
    return profile.iloc[row] if row >= 0 else profile.iloc[0] * 0.0


def _fractions(
    values: FloatArray, costs: pd.DataFrame, name: str, first: Sequence[float] = ()
) -> pd.DataFrame:
    points = np.union1d(values[np.isfinite(values)], first)
    fractions = {
        solver: np.searchsorted(np.sort(column), points, side="right") / len(values)
        for solver, column in zip(costs.columns, values.T, strict=True)
    }
    return pd.DataFrame(fractions, pd.Index(points, name=name), costs.columns)


def _ratios(costs: pd.DataFrame) -> FloatArray:
    """Costs relative to the least of each row; infinite for failures."""
    values = _checked(costs)
    best = values.min(axis=1, keepdims=True)
    finite = np.isfinite(values)
    return np.asarray(np.divide(values, best, out=np.full_like(values, np.inf), where=finite))


def _budgets(costs: pd.DataFrame, units: ArrayLike) -> FloatArray:
    """Costs in units of each row."""
    values = _checked(costs)
    scale = np.broadcast_to(np.asarray(units, dtype=float), len(values))
    if not (np.isfinite(scale).all() and (scale > 0).all()):
        raise ValueError("units must be finite and above zero")
    return np.asarray(values / scale[:, None])


def _bands(
    values: FloatArray, costs: pd.DataFrame, points: pd.Index
) -> tuple[pd.DataFrame, pd.DataFrame]:
    bands = [
        fraction_band(cluster_means(column[:, None] <= points.to_numpy(), costs.index))
        for column in values.T
    ]
    low, high = (
        pd.DataFrame(np.column_stack(part), points, costs.columns)
        for part in zip(*bands, strict=True)
    )
    return low, high


def _checked(costs: pd.DataFrame) -> FloatArray:
    values = costs.to_numpy(dtype=float)
    if not len(values):
        raise ValueError("a profile needs at least one problem")
    if not (values > 0).all():
        raise ValueError("costs must be above zero, infinite for failures")
    return values
