"""Performance profiles, data profiles and means of benchmark results.

All functions take costs as a table with a row per problem, or copy of it, and a column per solver,
in which failures are infinite. A profile is a table with a row per point at which some curve rises
and a column per solver: the fraction of problems at or below that point.

- E. D. Dolan, J. J. More, Benchmarking optimization software with performance profiles,
  Math. Program. 91 (2002) 201-213.
- J. J. More, S. M. Wild, Benchmarking derivative-free optimization algorithms,
  SIAM J. Optim. 20 (2009) 172-191.
- N. Gould, J. Scott, A note on performance profiles for benchmarking software,
  ACM Trans. Math. Software 43 (2016) 15.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike

from ..typing import FloatArray
from .bootstrap import cluster_means, fraction_band


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
        counts: see `casswarm.comparison.bootstrap.fraction_band`.

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

    Parameters
    ----------
    times : DataFrame
        Time at which each solver has its answer, infinite if it has none; a row per problem, a
        column per solver.
    qualities : DataFrame
        Quality of these answers between 0 and 1, such as 1 - gap to the best known objective; rows
        and columns as in `times`.

    Returns
    -------
    DataFrame
        Index seconds, a column per solver: mean over the problems of the quality of the answer, 0
        before there is one.
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
