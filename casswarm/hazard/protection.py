"""The least rate of a member of a swarm, as a function of its lone rate.

However n members place themselves, a member whose lone rate is b has a rate of at least phi(b). For
the paper's saturation, whose density is at most n,

    phi(b) = b (1 + alpha_2) / (1 + alpha_2 n).

With collisions, who gathers pays. Let h_j in [0, 1] be the density that neighbour j adds, 0 for one
that is lost, S their sum, m = n - 1, g(h) the collision rate at the distance at which the density
is h, which rises with h, and psi a convex function nowhere above g. By Jensen's inequality the
collisions add up to at least m psi(S / m), so that

    phi(b) = min over S in [0, m] of  b (1 + alpha_2) / (1 + alpha_2 (1 + S)) + m psi(S / m).

On each interval [S_k, S_(k+1)] the first term is at least its value at the end and the second at
least its value at the beginning: affine functions of b, whose least is below phi. A minimum of
affine functions that do not fall is concave and does not fall, which is what the certificate needs.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from ..typing import FloatArray

_CELLS = 4096
_ROUNDED = 1 - 1e-12
"""Down by more than all rounding here."""


@dataclass(frozen=True, eq=False)
class LeastRate:
    """phi(b) = min over k of intercepts_k + slopes_k b, concave and not falling, for b >= 0.

    Parameters
    ----------
    intercepts, slopes : (k,)
        Not negative.
    """

    intercepts: FloatArray
    slopes: FloatArray
    _ends: FloatArray = field(init=False, repr=False)

    def __post_init__(self) -> None:
        kept = _lowest(np.asarray(self.intercepts), np.asarray(self.slopes))
        object.__setattr__(self, "intercepts", np.asarray(self.intercepts)[kept])
        object.__setattr__(self, "slopes", np.asarray(self.slopes)[kept])
        fall, rise = -np.diff(self.slopes), np.diff(self.intercepts)
        object.__setattr__(self, "_ends", rise / fall)

    def __call__(self, rates: FloatArray) -> FloatArray:
        """phi at lone rates (...), which are not negative."""
        line = np.searchsorted(self._ends, rates)
        return np.asarray(self.intercepts[line] + self.slopes[line] * rates)


def _lowest(intercepts: FloatArray, slopes: FloatArray) -> list[int]:
    """Indices of the lines that are lowest somewhere on b >= 0, steepest first."""
    order = np.lexsort((slopes, intercepts))
    kept: list[int] = []
    for line in order:
        if kept and slopes[line] >= slopes[kept[-1]]:
            continue  # never below the one before
        while len(kept) > 1:
            a, b = kept[-2], kept[-1]
            before = (intercepts[b] - intercepts[a]) / (slopes[a] - slopes[b])
            after = (intercepts[line] - intercepts[b]) / (slopes[b] - slopes[line])
            if after > before:
                break
            kept.pop()
        kept.append(int(line))
    return kept


def saturated(n: int, alpha_2: float) -> LeastRate:
    """phi of the paper's saturation."""
    share = (1 + alpha_2) / (1 + alpha_2 * n)
    return LeastRate(np.zeros(1), np.array([share * _ROUNDED]))


def saturated_apart(
    n: int, alpha_2: float, collision: Callable[[FloatArray], FloatArray]
) -> LeastRate:
    """phi with collisions; `collision` is g, the rate of a neighbour of densities h in (0, 1]."""
    neighbours = n - 1
    if neighbours == 0:
        return saturated(n, alpha_2)
    share = np.linspace(0.0, 1.0, _CELLS + 1)
    with np.errstate(all="ignore"):
        g = np.nan_to_num(collision(np.maximum(share, 1e-300)), nan=0.0, posinf=1e300)
    g[0] = 0.0
    # on [h_k, h_(k+1)) g is at least g(h_k): the convex hull of the steps' lower right corners
    psi = _convex_below(np.append(0.0, share[1:]), np.append(0.0, g[:-1]))
    density = 1.0 + neighbours * share[1:]
    return LeastRate(
        neighbours * psi[:-1] * _ROUNDED,
        (1 + alpha_2) / (1 + alpha_2 * density) * _ROUNDED,
    )


def _convex_below(x: FloatArray, y: FloatArray) -> FloatArray:
    """The greatest convex function below points of ascending x, at them."""
    hull: list[int] = []
    for point in range(len(x)):
        while len(hull) > 1:
            a, b = hull[-2], hull[-1]
            turn = (x[b] - x[a]) * (y[point] - y[a]) - (y[b] - y[a]) * (x[point] - x[a])
            if turn > 0:
                break
            hull.pop()
        hull.append(point)
    return np.asarray(np.interp(x, x[hull], y[hull]))
