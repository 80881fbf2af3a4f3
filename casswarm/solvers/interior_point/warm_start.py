"""Warm starts of the interior-point method, from initial guesses of x and of the multipliers.

A large barrier parameter mu leads away from a good guess, and so do bounds from which the guess is
pushed far. Here mu is chosen from the complementarity and the residuals of the guess, and every gap
of a bound whose multiplier is z is then at least min(mu / z, sqrt(mu)), every multiplier at least
mu over its gap. What is far from its bound, or has a large multiplier, stays where it is.
"""

from __future__ import annotations

import numpy as np

from ...nlp.program import Instances
from ...typing import FloatArray
from .derivatives import Problems
from .iterates import Filter, Iterates, Options

_COMPLEMENTARITY, _RESIDUAL = 0.1, 1e-5
"""Ratios of mu to the mean complementarity of a guess, and to its largest residual."""

_LEAST = 0.1  # of mu, relative to the tolerance


def warm_start(problems: Problems, every: Instances, iterates: Iterates, options: Options) -> None:
    """Move the iterates of instances with multipliers to their guesses, just inside the bounds.

    Instances without multipliers, or with any that are not finite, stay as they are.
    """
    if every.lam_x0 is None or every.lam_g0 is None:
        return
    given = np.hstack([every.lam_x0[iterates.rows], every.lam_g0[iterates.rows]]).T
    places = np.flatnonzero(np.isfinite(given).all(axis=0))
    if not places.size:
        return
    now, lam = iterates[places], np.ascontiguousarray(given[:, places])
    x0 = every.x0[now.rows].T
    _move(problems, now, x0, np.zeros((2, *now.y.shape)))
    now.lam = lam[now.size :]
    bounded = np.isfinite(now.bounds.gaps(now.y))
    now.z = np.where(bounded, np.maximum([-lam, lam], 0.0), 0.0)
    now.mu = _barrier_parameters(problems, now, options)
    near = np.minimum(np.sqrt(now.mu), now.mu / np.maximum(now.z, np.finfo(float).tiny))
    _move(problems, now, x0, near)
    now.z = np.maximum(now.z, now.mu / now.bounds.gaps(now.y))
    iterates.move(places, (now.y, now.f, now.g, now.bounds.log_barrier(now.y)))
    iterates.lam[:, places], iterates.z[:, :, places] = now.lam, now.z
    iterates.mu[places] = now.mu
    iterates.filter.scale[places] = Filter.empty(now.violation).scale


def _move(problems: Problems, now: Iterates, x0: FloatArray, push: FloatArray) -> None:
    """Move iterates to guesses x0 (n, b), with gaps of at least `push` (2, k, b) where possible."""
    bounds, size = now.bounds, now.size
    with np.errstate(invalid="ignore"):
        below, above = np.fmin(push, 0.1 * (bounds.upper - bounds.lower))
    lower, upper = bounds.lower + below, bounds.upper - above
    x = np.clip(x0, lower[:size], upper[:size])
    x = np.where(bounds.fixed[:size], now.y[:size], x)
    now.f, now.g = problems.evaluate(now.rows, x)
    slacks = np.clip(now.g, lower[size:], upper[size:])
    now.y = np.vstack([x, np.where(bounds.fixed[size:], now.y[size:], slacks)])


def _barrier_parameters(problems: Problems, now: Iterates, options: Options) -> FloatArray:
    """Barrier parameters (b,): at most those of a cold start."""
    gaps, size = now.bounds.gaps(now.y), now.size
    bounded = np.isfinite(gaps)
    products = now.z * np.where(bounded, gaps, 0.0)
    mean = products.sum(axis=(0, 1)) / np.maximum(bounded.sum(axis=(0, 1)), 1)
    at = problems.linearise(now.rows, np.ascontiguousarray(now.y[:size]))
    dual = at.gradient + at.transposed_times(now.lam) + (now.z[1] - now.z[0])[:size]
    dual[now.bounds.fixed[:size]] = 0.0
    primal = now.g - now.y[size:]
    largest = abs(np.vstack([dual, primal])).max(axis=0, initial=0.0)
    mu = np.maximum(_COMPLEMENTARITY * mean, _RESIDUAL * largest)
    return np.asarray(np.clip(mu, _LEAST * options.tolerance, options.mu_init))
