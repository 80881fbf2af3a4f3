"""Problems of Hock and Schittkowski with their published optima.

W. Hock, K. Schittkowski, Test Examples for Nonlinear Programming Codes, Lecture Notes in Economics
and Mathematical Systems 187, Springer, 1981. Numbers, starts and optima are the book's; x is given
where the minimiser is unique.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from typing import Any

import casadi as ca
from known_problems import INF, hs_1, hs_6, hs_7, hs_21, hs_35, hs_71, known

from casswarm.nlp import Instances, Nlp

SQRT2, SQRT3, SQRT7 = math.sqrt(2), math.sqrt(3), math.sqrt(7)
FREE = (-INF, INF)
POSITIVE = (0.0, INF)


@dataclass(frozen=True, eq=False)
class Published:
    """A problem, its start, its published objective and other local minima that are known.

    `local` are objectives of other points that fulfil the first-order conditions: solvers may end
    there without being wrong. `traits` say what is hard about it.
    """

    number: int
    nlp: Nlp
    instance: Instances
    objective: float
    local: tuple[float, ...] = ()
    traits: str = ""


def valley(x: Any) -> Any:
    """Rosenbrock's, the objective of many."""
    return 100 * (x[1] - x[0] ** 2) ** 2 + (1 - x[0]) ** 2


Row = tuple[Callable[[Any], Any], float, float]


@dataclass(frozen=True)
class Statement:
    """What the book prints: objective, start, box as pairs, rows, optimum."""

    objective: Callable[[Any], Any]
    start: tuple[float, ...]
    optimum: float
    box: tuple[tuple[float, float], ...] = ()
    rows: tuple[Row, ...] = ()
    local: tuple[float, ...] = ()
    traits: str = ""


def equal(function: Callable[[Any], Any]) -> Row:
    return function, 0.0, 0.0


def positive(function: Callable[[Any], Any]) -> Row:
    return function, 0.0, INF


HS2_A = math.sqrt(598 / 1200)
HS2_X = 2 * HS2_A * math.cos(math.acos(1 / (400 * HS2_A**3)) / 3)

STATEMENTS = {
    2: Statement(
        valley,
        (-2, 1),
        100 * (1.5 - HS2_X**2) ** 2 + (HS2_X - 1) ** 2,  # 0.0504261879
        box=(FREE, (1.5, INF)),
        local=(4.941229318,),
        traits="nonconvex",
    ),
    3: Statement(
        lambda x: x[1] + 1e-5 * (x[1] - x[0]) ** 2,
        (10, 1),
        0.0,
        box=(FREE, POSITIVE),
        traits="badly scaled",
    ),
    4: Statement(
        lambda x: (x[0] + 1) ** 3 / 3 + x[1], (1.125, 0.125), 8 / 3, box=((1, INF), POSITIVE)
    ),
    5: Statement(
        lambda x: ca.sin(x[0] + x[1]) + (x[0] - x[1]) ** 2 - 1.5 * x[0] + 2.5 * x[1] + 1,
        (0, 0),
        -SQRT3 / 2 - math.pi / 3,  # -1.91322295
        box=((-1.5, 4), (-3, 3)),
        traits="nonconvex",
    ),
    8: Statement(
        lambda x: -1 + 0 * x[0],
        (2, 1),
        -1.0,
        rows=(equal(lambda x: x[0] ** 2 + x[1] ** 2 - 25), equal(lambda x: x[0] * x[1] - 9)),
        traits="constant objective",
    ),
    9: Statement(
        lambda x: ca.sin(math.pi * x[0] / 12) * ca.cos(math.pi * x[1] / 16),
        (0, 0),
        -0.5,
        rows=(equal(lambda x: 4 * x[0] - 3 * x[1]),),
        traits="nonconvex, periodic",
    ),
    10: Statement(
        lambda x: x[0] - x[1],
        (-10, 10),
        -1.0,
        rows=(positive(lambda x: -3 * x[0] ** 2 + 2 * x[0] * x[1] - x[1] ** 2 + 1),),
    ),
    11: Statement(
        lambda x: (x[0] - 5) ** 2 + x[1] ** 2 - 25,
        (4.9, 0.1),
        -8.498464223,
        rows=(positive(lambda x: -(x[0] ** 2) + x[1]),),
    ),
    12: Statement(
        lambda x: x[0] ** 2 / 2 + x[1] ** 2 - x[0] * x[1] - 7 * x[0] - 7 * x[1],
        (0, 0),
        -30.0,
        rows=(positive(lambda x: 25 - 4 * x[0] ** 2 - x[1] ** 2),),
    ),
    13: Statement(
        lambda x: (x[0] - 2) ** 2 + x[1] ** 2,
        (-2, -2),
        1.0,
        box=(POSITIVE, POSITIVE),
        rows=(positive(lambda x: (1 - x[0]) ** 3 - x[1]),),
        traits="no multipliers exist at the minimum",
    ),
    14: Statement(
        lambda x: (x[0] - 2) ** 2 + (x[1] - 1) ** 2,
        (2, 2),
        9 - 2.875 * SQRT7,  # 1.39346498
        rows=(
            positive(lambda x: -(x[0] ** 2) / 4 - x[1] ** 2 + 1),
            equal(lambda x: x[0] - 2 * x[1] + 1),
        ),
    ),
    15: Statement(
        valley,
        (-2, 1),
        306.5,
        box=((-INF, 0.5), FREE),
        rows=(positive(lambda x: x[0] * x[1] - 1), positive(lambda x: x[0] + x[1] ** 2)),
        local=(360.379767,),
        traits="nonconvex",
    ),
    16: Statement(
        valley,
        (-2, 1),
        0.25,
        box=((-2, 0.5), (-INF, 1)),
        rows=(positive(lambda x: x[0] + x[1] ** 2), positive(lambda x: x[0] ** 2 + x[1])),
        local=(3.98206045, 23.1446608),
        traits="nonconvex",
    ),
    17: Statement(
        valley,
        (-2, 1),
        1.0,
        box=((-0.5, 0.5), (-INF, 1)),
        rows=(positive(lambda x: x[1] ** 2 - x[0]), positive(lambda x: x[0] ** 2 - x[1])),
        traits="nonconvex, degenerate",
    ),
    18: Statement(
        lambda x: 0.01 * x[0] ** 2 + x[1] ** 2,
        (2, 2),
        5.0,
        box=((2, 50), (0, 50)),
        rows=(
            positive(lambda x: x[0] * x[1] - 25),
            positive(lambda x: x[0] ** 2 + x[1] ** 2 - 25),
        ),
    ),
    19: Statement(
        lambda x: (x[0] - 10) ** 3 + (x[1] - 20) ** 3,
        (20.1, 5.84),
        -6961.81381,
        box=((13, 100), (0, 100)),
        rows=(
            positive(lambda x: (x[0] - 5) ** 2 + (x[1] - 5) ** 2 - 100),
            positive(lambda x: -((x[1] - 5) ** 2) - (x[0] - 6) ** 2 + 82.81),
        ),
        traits="nonconvex",
    ),
    20: Statement(
        valley,
        (-2, 1),
        81.5 - 25 * SQRT3,  # 38.1987298
        box=((-0.5, 0.5), FREE),
        rows=(
            positive(lambda x: x[0] + x[1] ** 2),
            positive(lambda x: x[0] ** 2 + x[1]),
            positive(lambda x: x[0] ** 2 + x[1] ** 2 - 1),
        ),
        local=(40.1987298,),
        traits="nonconvex",
    ),
    22: Statement(
        lambda x: (x[0] - 2) ** 2 + (x[1] - 1) ** 2,
        (2, 2),
        1.0,
        rows=(positive(lambda x: -x[0] - x[1] + 2), positive(lambda x: -(x[0] ** 2) + x[1])),
    ),
    24: Statement(
        lambda x: ((x[0] - 3) ** 2 - 9) * x[1] ** 3 / (27 * SQRT3),
        (1, 0.5),
        -1.0,
        box=(POSITIVE, POSITIVE),
        rows=(
            positive(lambda x: x[0] / SQRT3 - x[1]),
            positive(lambda x: x[0] + SQRT3 * x[1]),
            positive(lambda x: -x[0] - SQRT3 * x[1] + 6),
        ),
        local=(0.0,),
        traits="nonconvex",
    ),
    26: Statement(
        lambda x: (x[0] - x[1]) ** 2 + (x[1] - x[2]) ** 4,
        (-2.6, 2, 2),
        0.0,
        rows=(equal(lambda x: (1 + x[1] ** 2) * x[0] + x[2] ** 4 - 3),),
        traits="degenerate: no second-order sufficiency",
    ),
    27: Statement(
        lambda x: 0.01 * (x[0] - 1) ** 2 + (x[1] - x[0] ** 2) ** 2,
        (2, 2, 2),
        0.04,
        rows=(equal(lambda x: x[0] + x[2] ** 2 + 1),),
        traits="nonconvex",
    ),
    29: Statement(
        lambda x: -x[0] * x[1] * x[2],
        (1, 1, 1),
        -16 * SQRT2,  # -22.6274170
        rows=(positive(lambda x: -(x[0] ** 2) - 2 * x[1] ** 2 - 4 * x[2] ** 2 + 48),),
        traits="nonconvex",
    ),
    30: Statement(
        ca.sumsqr,
        (1, 1, 1),
        1.0,
        box=((1, 10), (-10, 10), (-10, 10)),
        rows=(positive(lambda x: x[0] ** 2 + x[1] ** 2 - 1),),
        traits="degenerate: dependent active constraints",
    ),
    33: Statement(
        lambda x: (x[0] - 1) * (x[0] - 2) * (x[0] - 3) + x[2],
        (0, 0, 3),
        SQRT2 - 6,  # -4.58578644
        box=(POSITIVE, POSITIVE, (0, 5)),
        rows=(
            positive(lambda x: x[2] ** 2 - x[1] ** 2 - x[0] ** 2),
            positive(lambda x: ca.sumsqr(x) - 4),
        ),
        local=(-4.0,),
        traits="nonconvex",
    ),
    36: Statement(
        lambda x: -x[0] * x[1] * x[2],
        (10, 10, 10),
        -3300.0,
        box=((0, 20), (0, 11), (0, 42)),
        rows=(positive(lambda x: 72 - x[0] - 2 * x[1] - 2 * x[2]),),
        traits="nonconvex",
    ),
    38: Statement(
        lambda x: (
            valley(x)
            + 90 * (x[3] - x[2] ** 2) ** 2
            + (1 - x[2]) ** 2
            + 10.1 * ((x[1] - 1) ** 2 + (x[3] - 1) ** 2)
            + 19.8 * (x[1] - 1) * (x[3] - 1)
        ),
        (-3, -1, -3, -1),
        0.0,
        box=((-10, 10),) * 4,
        traits="nonconvex",
    ),
    39: Statement(
        lambda x: -x[0],
        (2, 2, 2, 2),
        -1.0,
        rows=(
            equal(lambda x: x[1] - x[0] ** 3 - x[2] ** 2),
            equal(lambda x: x[0] ** 2 - x[1] - x[3] ** 2),
        ),
        traits="nonconvex",
    ),
    40: Statement(
        lambda x: -x[0] * x[1] * x[2] * x[3],
        (0.8, 0.8, 0.8, 0.8),
        -0.25,
        rows=(
            equal(lambda x: x[0] ** 3 + x[1] ** 2 - 1),
            equal(lambda x: x[0] ** 2 * x[3] - x[2]),
            equal(lambda x: x[3] ** 2 - x[1]),
        ),
        traits="nonconvex",
    ),
    43: Statement(
        lambda x: (
            x[0] ** 2
            + x[1] ** 2
            + 2 * x[2] ** 2
            + x[3] ** 2
            - 5 * x[0]
            - 5 * x[1]
            - 21 * x[2]
            + 7 * x[3]
        ),
        (0, 0, 0, 0),
        -44.0,
        rows=(
            positive(lambda x: 8 - ca.sumsqr(x) - x[0] + x[1] - x[2] + x[3]),
            positive(
                lambda x: 10 - x[0] ** 2 - 2 * x[1] ** 2 - x[2] ** 2 - 2 * x[3] ** 2 + x[0] + x[3]
            ),
            positive(lambda x: 5 - 2 * x[0] ** 2 - x[1] ** 2 - x[2] ** 2 - 2 * x[0] + x[1] + x[3]),
        ),
        traits="Rosen and Suzuki",
    ),
    76: Statement(
        lambda x: (
            x[0] ** 2
            + x[1] ** 2 / 2
            + x[2] ** 2
            + x[3] ** 2 / 2
            - x[0] * x[2]
            + x[2] * x[3]
            - x[0]
            - 3 * x[1]
            + x[2]
            - x[3]
        ),
        (0.5, 0.5, 0.5, 0.5),
        -4.681818181,
        box=(POSITIVE,) * 4,
        rows=(
            positive(lambda x: 5 - x[0] - 2 * x[1] - x[2] - x[3]),
            positive(lambda x: 4 - 3 * x[0] - x[1] - 2 * x[2] + x[3]),
            positive(lambda x: x[1] + 4 * x[2] - 1.5),
        ),
        traits="quadratic program",
    ),
    78: Statement(
        lambda x: x[0] * x[1] * x[2] * x[3] * x[4],
        (-2, 1.5, 2, -1, -1),
        -2.91970041,
        rows=(
            equal(lambda x: ca.sumsqr(x) - 10),
            equal(lambda x: x[1] * x[2] - 5 * x[3] * x[4]),
            equal(lambda x: x[0] ** 3 + x[1] ** 3 + 1),
        ),
        traits="nonconvex",
    ),
    100: Statement(
        lambda x: (
            (x[0] - 10) ** 2
            + 5 * (x[1] - 12) ** 2
            + x[2] ** 4
            + 3 * (x[3] - 11) ** 2
            + 10 * x[4] ** 6
            + 7 * x[5] ** 2
            + x[6] ** 4
            - 4 * x[5] * x[6]
            - 10 * x[5]
            - 8 * x[6]
        ),
        (1, 2, 0, 4, 0, 1, 1),
        680.6300573,
        rows=(
            positive(
                lambda x: 127 - 2 * x[0] ** 2 - 3 * x[1] ** 4 - x[2] - 4 * x[3] ** 2 - 5 * x[4]
            ),
            positive(lambda x: 282 - 7 * x[0] - 3 * x[1] - 10 * x[2] ** 2 - x[3] + x[4]),
            positive(lambda x: 196 - 23 * x[0] - x[1] ** 2 - 6 * x[5] ** 2 + 8 * x[6]),
            positive(
                lambda x: (
                    -4 * x[0] ** 2
                    - x[1] ** 2
                    + 3 * x[0] * x[1]
                    - 2 * x[2] ** 2
                    - 5 * x[5]
                    + 11 * x[6]
                )
            ),
        ),
    ),
}

FROM_KNOWN = {1: hs_1, 6: hs_6, 7: hs_7, 21: hs_21, 35: hs_35, 71: hs_71}
NUMBERS = tuple(sorted({*STATEMENTS, *FROM_KNOWN}))


@cache
def published(number: int) -> Published:
    """The problem of a number, built once."""
    if number in FROM_KNOWN:
        case = FROM_KNOWN[number]()
        return Published(number, case.nlp, case.instance, case.objective)
    return posed(number, STATEMENTS[number])


def posed(number: int, stated: Statement) -> Published:
    """The problem of a statement."""
    case = known(
        f"HS {number}",
        stated.objective,
        (stated.start, stated.optimum),
        stated.start,
        box=tuple(zip(*stated.box, strict=True)) if stated.box else None,  # type: ignore[arg-type]
        rows={f"row{i}": row for i, row in enumerate(stated.rows)},
    )
    return Published(number, case.nlp, case.instance, stated.optimum, stated.local, stated.traits)
