"""Error bars of a comparison by resampling its problems, as functions of arrays.

The problems are a sample of those that one could pose, so a comparison on other problems of the
same kind would differ. The bootstrap estimates by how much: it draws as many problems as there are,
with replacement, and repeats the calculation. All runs of a problem (its perturbed copies) are
drawn together, since they are not independent: a cluster bootstrap.

- B. Efron, R. J. Tibshirani, An Introduction to the Bootstrap, Chapman and Hall, 1993.
- C. A. Field, A. H. Welsh, Bootstrapping clustered data, J. R. Stat. Soc. B 69 (2007) 369-390.
- A. Agresti, B. A. Coull, Approximate is better than "exact" for interval estimation of binomial
  proportions, Am. Stat. 52 (1998) 119-126.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from ..typing import FloatArray

LEVEL = 0.95
"""Nominal probability of bands and intervals."""

RESAMPLES = 2000
"""Number of samples that are drawn."""


def cluster_means(values: ArrayLike, clusters: ArrayLike) -> FloatArray:
    """Mean over the rows of every cluster.

    Parameters
    ----------
    values : (N, ...)
    clusters : (N,)
        Label of every row's cluster.

    Returns
    -------
    (C, ...)
        In the order in which the clusters appear.
    """
    array = np.asarray(values, dtype=float)
    _, first, member, sizes = np.unique(
        np.asarray(clusters), return_index=True, return_inverse=True, return_counts=True
    )
    sums = np.zeros((len(first), *array.shape[1:]))
    np.add.at(sums, member, array)
    means = sums / sizes.reshape(-1, *[1] * (array.ndim - 1))
    return np.asarray(means[np.argsort(first)])


def resampled_means(values: ArrayLike, resamples: int = RESAMPLES, seed: int = 0) -> FloatArray:
    """Means over clusters that are drawn with replacement.

    Parameters
    ----------
    values : (C, K)
        A row per cluster: see `cluster_means`.
    resamples : int
    seed : int

    Returns
    -------
    (resamples, K)
    """
    array = np.asarray(values, dtype=float)
    return np.asarray(_drawn(len(array), len(array), resamples, seed) @ array / len(array))


def fraction_band(
    fractions: ArrayLike, level: float = LEVEL, resamples: int = RESAMPLES, seed: int = 0
) -> tuple[FloatArray, FloatArray]:
    """Pointwise percentile band of mean fractions.

    To the clusters that are drawn from, one of zeros and one of ones are added, as Agresti and
    Coull add successes and failures: a solver that solves all of nine problems need not solve all
    of the next nine, although every resample of the nine says so.

    Parameters
    ----------
    fractions : (C, K)
        A row per cluster, each between 0 and 1, such as whether its runs are below K points of a
        profile.
    level : float
        Between 0 and 1.
    resamples, seed : int

    Returns
    -------
    low, high : (K,)
        Monotone if the rows are.
    """
    array = np.asarray(fractions, dtype=float)
    count, points = array.shape
    padded = np.vstack([array, np.zeros((1, points)), np.ones((1, points))])
    means = _drawn(count + 2, count, resamples, seed) @ padded / count
    low, high = np.quantile(means, [(1 - level) / 2, (1 + level) / 2], axis=0)
    mean = array.mean(axis=0)  # with few problems, the added ones can move the band off it
    return np.minimum(low, mean), np.maximum(high, mean)


def ranks(scores: ArrayLike) -> FloatArray:
    """Fractional ranks of scores (R, S), from 1 for the least; ties share the mean of theirs."""
    less, equal = _order(np.asarray(scores, dtype=float))
    return 1.0 + less + (equal - 1) / 2


def rank_probabilities(resampled: ArrayLike) -> FloatArray:
    """How often each of S solvers has each rank.

    Parameters
    ----------
    resampled : (R, S)
        Scores in R resamples, such as `resampled_means`; the least is the best.

    Returns
    -------
    (S, S)
        Row s, column k: fraction of the resamples in which solver s has rank k + 1. Solvers with
        equal scores share their ranks. Rows and columns sum to one.
    """
    less, equal = _order(np.asarray(resampled, dtype=float))
    place = np.arange(less.shape[1])
    held = (place >= less[..., None]) & (place < (less + equal)[..., None])
    return np.asarray((held / equal[..., None]).mean(axis=0))


def _drawn(pool: int, count: int, resamples: int, seed: int) -> FloatArray:
    """How often each of `pool` clusters is among `count` drawn ones: (resamples, pool)."""
    rng = np.random.default_rng(seed)
    return rng.multinomial(count, np.full(pool, 1.0 / pool), size=resamples).astype(float)


def _order(scores: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Numbers of scores that are less than each, and equal to it up to rounding: (R, S)."""
    mine, other = scores[:, :, None], scores[:, None, :]
    equal = np.isclose(mine, other, rtol=1e-12, atol=0.0)
    return (~equal & (other < mine)).sum(axis=2), equal.sum(axis=2)
