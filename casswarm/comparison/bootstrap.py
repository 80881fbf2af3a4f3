"""Error bars of a comparison by resampling its problems, as functions of arrays.

The problems are a sample of those that one could pose, so a comparison on other problems of the
same kind would differ. The bootstrap estimates by how much: it draws problems with replacement and
repeats the calculation. All runs of a problem (its perturbed copies) are drawn together, since they
are not independent: a cluster bootstrap. Where the numbers of problems of several kinds are fixed,
they are drawn from each: strata.

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

from statistics import NormalDist

import numpy as np
from numpy.typing import ArrayLike
from scipy.special import chdtri

from ..typing import FloatArray, IntArray

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

    Parameters
    ----------
    values : (C, K)
        A row per cluster: see `cluster_means`.
    strata : (C,), optional
        Label of every cluster's stratum, each of at least two clusters; by default one for all.
        Strata keep their sizes in every resample.
    resamples, seed : int

    Returns
    -------
    (resamples, K)

    Raises
    ------
    ValueError
        A stratum of a single cluster.
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
    fractions that are 0 or 1 it is the interval of Agresti and Coull.

    Parameters
    ----------
    fractions : (C, K)
        A row per cluster, each between 0 and 1, such as whether its runs are below K points of a
        profile.
    level : float
        Between 0 and 1.

    Returns
    -------
    low, high : (K,)
        Monotone if the rows are.
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


def _degrees_of_freedom(variances: FloatArray, sizes: IntArray) -> FloatArray:
    """Those of a sum (K,) of estimated variances (H, K) from H samples (Satterthwaite 1946)."""
    squares = (variances**2 / (sizes[:, None] - 1)).sum(axis=0)
    full = np.full(len(squares), float((sizes - 1).sum()))
    np.divide(variances.sum(axis=0) ** 2, squares, out=full, where=squares > 0)
    return full


def _order(scores: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Numbers of scores that are less than each, and equal to it up to rounding: (R, S)."""
    mine, other = scores[:, :, None], scores[:, None, :]
    equal = np.isclose(mine, other, rtol=1e-12, atol=0.0)
    return (~equal & (other < mine)).sum(axis=2), equal.sum(axis=2)
