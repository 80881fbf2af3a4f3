"""Problems whose solutions are known: the form of all, and those that follow by hand."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from casswarm.motion import PlanarSets
from casswarm.nlp import Instances, Nlp

Array = NDArray[np.float64]
INF = math.inf


@dataclass(frozen=True, eq=False)
class Known:
    """A problem, an instance of it, and its solution; multipliers are positive at upper bounds.

    `local` are objectives of other minima, and `traits` say what is hard about it.
    """

    nlp: Nlp
    instance: Instances
    x: Array
    objective: float
    bound_multipliers: Array
    row_multipliers: Array
    local: tuple[float, ...] = ()
    traits: str = ""


def instances(
    x0: Any,
    p: Any = (),
    *,
    lbx: Any = -INF,
    ubx: Any = INF,
    lbg: Any = (),
    ubg: Any = (),
) -> Instances:
    """Instances from guesses (B, n); bounds may be numbers for all of x, or rows for all of B."""
    x0 = np.atleast_2d(np.asarray(x0, float))
    lower, upper = (np.broadcast_to(bound, x0.shape) for bound in (lbx, ubx))
    return Instances(x0, *map(np.atleast_1d, (p, lower, upper, lbg, ubg)))


def known(
    name: str,
    objective: Callable[[Any], Any],
    solution: tuple[Sequence[float], float],
    start: Sequence[float],
    *,
    box: Sequence[Sequence[float]] | None = None,
    rows: dict[str, tuple[Callable[[Any], Any], float, float]] | None = None,
    bound_multipliers: Sequence[float] = (),
    row_multipliers: Sequence[float] = (),
    local: tuple[float, ...] = (),
    traits: str = "",
) -> Known:
    x, n, rows = ca.MX.sym("x", len(start)), len(start), rows or {}
    constraints = {row: function(x) for row, (function, _, _) in rows.items()}
    lower, upper = box or ([-INF] * n, [INF] * n)
    lbg, ubg = ([row[side] for row in rows.values()] for side in (1, 2))
    instance = instances(start, lbx=lower, ubx=upper, lbg=lbg, ubg=ubg)
    return Known(
        Nlp(name, {"x": x}, {}, objective(x), constraints),
        instance,
        np.array(solution[0], float),
        solution[1],
        np.array(bound_multipliers or [0.0] * n),
        np.array(row_multipliers or [0.0] * len(rows)),
        local,
        traits,
    )


def active_box() -> Known:
    """The point of a box nearest to (2, -1)."""
    return known(
        "active box",
        lambda x: (x[0] - 2) ** 2 + (x[1] + 1) ** 2,
        ([1, -1], 1.0),
        [0.2, 2],
        box=([0, -3], [1, 3]),
        bound_multipliers=[2, 0],
    )


def nearest_in_box(points: Array) -> tuple[Nlp, Instances]:
    """B instances: the point of [-1, 1]^2 nearest to points (B, 2), which is a clip."""
    x, goal = ca.MX.sym("x", 2, 1), ca.MX.sym("goal", 2)
    nlp = Nlp("nearest in box", {"x": x}, {"goal": goal}, ca.sumsqr(x - goal), {})
    return nlp, instances(np.zeros_like(points), points, lbx=-1.0, ubx=1.0)


def planar(
    objective: Callable[[Any], Any], start: Array, lower: Array, upper: Array, discs: Array
) -> tuple[Nlp, Instances]:
    """One instance over n points (n, 2), each in a box and in a disc (x, y, radius)."""
    n, radii = len(start), discs[:, 2]
    x, centers = ca.MX.sym("x", 2, n), ca.DM(discs[:, :2].T)
    nlp = Nlp("planar", {"x": x}, {}, objective(x), {"discs": ca.sum1((x - centers) ** 2)})
    box = {"lbx": lower.ravel(), "ubx": upper.ravel()}
    one = instances(start.ravel(), **box, lbg=np.full(n, -INF), ubg=radii**2)
    sets = PlanarSets(lower[None], upper[None], discs[None, :, None, :2], discs[None, :, None, 2])
    return nlp, replace(one, feasible_set=sets)
