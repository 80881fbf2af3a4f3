"""More problems of Hock and Schittkowski, and the forms in which a problem can be posed.

Those of `hock_schittkowski` are solved by every solver in the tests; these are posed in every form,
and in batches. Numbers, starts and optima are the book's; the optimum of 112 is a later one, since
that of the book is not the least.
"""

from __future__ import annotations

import math
from functools import cache

import casadi as ca
import numpy as np
from hock_schittkowski import (
    FREE,
    POSITIVE,
    SQRT2,
    STATEMENTS,
    Published,
    Row,
    Statement,
    equal,
    posed,
    positive,
)

import casswarm as csw


def fifth(x):
    """The objective of problems 46 and 49."""
    return (x[0] - x[1]) ** 2 + (x[2] - 1) ** 2 + (x[3] - 1) ** 4 + (x[4] - 1) ** 6


def chain(x, first):
    """The objective of problems 51 to 53."""
    return (first * x[0] - x[1]) ** 2 + (x[1] + x[2] - 2) ** 2 + (x[3] - 1) ** 2 + (x[4] - 1) ** 2


def volumes(x):
    """Two terms that the objective and a row of problem 93 share."""
    return x[0] * x[3] * (x[0] + x[1] + x[2]), x[1] * x[2] * (x[0] + 1.57 * x[1] + x[3])


def reactor(x):
    """The objective of problem 104, which has bounds."""
    return 0.4 * ((x[0] / x[6]) ** 0.67 + (x[1] / x[7]) ** 0.67) + 10 - x[0] - x[1]


def energy(x):
    """The objective of problem 112."""
    c = (-6.089, -17.164, -34.054, -5.914, -24.721, -14.986, -24.1, -10.708, -26.662, -22.179)
    total = sum(x[i] for i in range(10))
    return sum(x[i] * (c[i] + ca.log(x[i] / total)) for i in range(10))


def product(x):
    """The product of five variables."""
    return x[0] * x[1] * x[2] * x[3] * x[4]


FIFTY_TWO = (
    equal(lambda x: x[0] + 3 * x[1]),
    equal(lambda x: x[2] + x[3] - 2 * x[4]),
    equal(lambda x: x[1] - x[4]),
)
EIGHTY = (
    equal(lambda x: sum(x[i] ** 2 for i in range(5)) - 10),
    equal(lambda x: x[1] * x[2] - 5 * x[3] * x[4]),
    equal(lambda x: x[0] ** 3 + x[1] ** 3 + 1),
)
EXPONENTIALS = (
    positive(lambda x: x[1] - ca.exp(x[0])),
    positive(lambda x: x[2] - ca.exp(x[1])),
)
A, B = math.asin(math.sqrt(1 / 4.2)), math.asin(math.sqrt(5 / 7.2))


def sine(x, i):
    """A part of the rows of problem 56."""
    return ca.sin(x[i]) ** 2


MORE = {
    23: Statement(
        lambda x: x[0] ** 2 + x[1] ** 2,
        (3, 1),
        2.0,
        box=((-50, 50),) * 2,
        rows=(
            positive(lambda x: x[0] + x[1] - 1),
            positive(lambda x: x[0] ** 2 + x[1] ** 2 - 1),
            positive(lambda x: 9 * x[0] ** 2 + x[1] ** 2 - 9),
            positive(lambda x: x[0] ** 2 - x[1]),
            positive(lambda x: x[1] ** 2 - x[0]),
        ),
    ),
    28: Statement(
        lambda x: (x[0] + x[1]) ** 2 + (x[1] + x[2]) ** 2,
        (-4, 1, 1),
        0.0,
        rows=(equal(lambda x: x[0] + 2 * x[1] + 3 * x[2] - 1),),
    ),
    31: Statement(
        lambda x: 9 * x[0] ** 2 + x[1] ** 2 + 9 * x[2] ** 2,
        (1, 1, 1),
        6.0,
        box=((-10, 10), (1, 10), (-10, 1)),
        rows=(positive(lambda x: x[0] * x[1] - 1),),
    ),
    32: Statement(
        lambda x: (x[0] + 3 * x[1] + x[2]) ** 2 + 4 * (x[0] - x[1]) ** 2,
        (0.1, 0.7, 0.2),
        1.0,
        box=(POSITIVE,) * 3,
        rows=(
            positive(lambda x: 6 * x[1] + 4 * x[2] - x[0] ** 3 - 3),
            equal(lambda x: 1 - x[0] - x[1] - x[2]),
        ),
    ),
    34: Statement(
        lambda x: -x[0],
        (0, 1.05, 2.9),
        -math.log(math.log(10)),
        box=((0, 100), (0, 100), (0, 10)),
        rows=EXPONENTIALS,
    ),
    37: Statement(
        lambda x: -x[0] * x[1] * x[2],
        (10, 10, 10),
        -3456.0,
        box=((0, 42),) * 3,
        rows=(
            positive(lambda x: 72 - x[0] - 2 * x[1] - 2 * x[2]),
            positive(lambda x: x[0] + 2 * x[1] + 2 * x[2]),
        ),
    ),
    41: Statement(
        lambda x: 2 - x[0] * x[1] * x[2],
        (2, 2, 2, 2),
        52 / 27,
        box=((0, 1), (0, 1), (0, 1), (0, 2)),
        rows=(equal(lambda x: x[0] + 2 * x[1] + 2 * x[2] - x[3]),),
    ),
    42: Statement(
        lambda x: sum((x[i] - i - 1) ** 2 for i in range(4)),
        (1, 1, 1, 1),
        28 - 10 * SQRT2,
        rows=(equal(lambda x: x[0] - 2), equal(lambda x: x[2] ** 2 + x[3] ** 2 - 2)),
    ),
    44: Statement(
        lambda x: x[0] - x[1] - x[2] - x[0] * x[2] + x[0] * x[3] + x[1] * x[2] - x[1] * x[3],
        (0, 0, 0, 0),
        -15.0,
        box=(POSITIVE,) * 4,
        rows=(
            positive(lambda x: 8 - x[0] - 2 * x[1]),
            positive(lambda x: 12 - 4 * x[0] - x[1]),
            positive(lambda x: 12 - 3 * x[0] - 4 * x[1]),
            positive(lambda x: 8 - 2 * x[2] - x[3]),
            positive(lambda x: 8 - x[2] - 2 * x[3]),
            positive(lambda x: 5 - x[2] - x[3]),
        ),
        local=(-13.0,),
    ),
    45: Statement(
        lambda x: 2 - product(x) / 120,
        (2, 2, 2, 2, 2),
        1.0,
        box=tuple((0, i) for i in range(1, 6)),
    ),
    46: Statement(
        fifth,
        (SQRT2 / 2, 1.75, 0.5, 2, 2),
        0.0,
        rows=(
            equal(lambda x: x[0] ** 2 * x[3] + ca.sin(x[3] - x[4]) - 1),
            equal(lambda x: x[1] + x[2] ** 4 * x[3] ** 2 - 2),
        ),
    ),
    48: Statement(
        lambda x: (x[0] - 1) ** 2 + (x[1] - x[2]) ** 2 + (x[3] - x[4]) ** 2,
        (3, 5, -3, 2, -2),
        0.0,
        rows=(
            equal(lambda x: x[0] + x[1] + x[2] + x[3] + x[4] - 5),
            equal(lambda x: x[2] - 2 * (x[3] + x[4]) + 3),
        ),
    ),
    49: Statement(
        fifth,
        (10, 7, 2, -3, 0.8),
        0.0,
        rows=(
            equal(lambda x: x[0] + x[1] + x[2] + 4 * x[3] - 7),
            equal(lambda x: x[2] + 5 * x[4] - 6),
        ),
    ),
    50: Statement(
        lambda x: (x[0] - x[1]) ** 2 + (x[1] - x[2]) ** 2 + (x[2] - x[3]) ** 4 + (x[3] - x[4]) ** 2,
        (35, -31, 11, 5, -5),
        0.0,
        rows=tuple(equal(lambda x, i=i: x[i] + 2 * x[i + 1] + 3 * x[i + 2] - 6) for i in range(3)),
    ),
    51: Statement(
        lambda x: chain(x, 1),
        (2.5, 0.5, 2, -1, 0.5),
        0.0,
        rows=(equal(lambda x: x[0] + 3 * x[1] - 4), *FIFTY_TWO[1:]),
    ),
    52: Statement(lambda x: chain(x, 4), (2, 2, 2, 2, 2), 1859 / 349, rows=FIFTY_TWO),
    53: Statement(
        lambda x: chain(x, 1), (2, 2, 2, 2, 2), 176 / 43, box=((-10, 10),) * 5, rows=FIFTY_TWO
    ),
    55: Statement(
        lambda x: x[0] + 2 * x[1] + 4 * x[4] + ca.exp(x[0] * x[3]),
        (1, 2, 0, 0, 0, 2),
        19 / 3,
        box=((0, 1), POSITIVE, POSITIVE, (0, 1), POSITIVE, POSITIVE),
        rows=(
            equal(lambda x: x[0] + 2 * x[1] + 5 * x[4] - 6),
            equal(lambda x: x[0] + x[1] + x[2] - 3),
            equal(lambda x: x[3] + x[4] + x[5] - 2),
            equal(lambda x: x[0] + x[3] - 1),
            equal(lambda x: x[1] + x[4] - 2),
            equal(lambda x: x[2] + x[5] - 2),
        ),
        local=(20 / 3,),
        traits="dependent rows",
    ),
    56: Statement(
        lambda x: -x[0] * x[1] * x[2],
        (1, 1, 1, A, A, A, B),
        -3.456,
        rows=(
            *(equal(lambda x, i=i: x[i] - 4.2 * sine(x, i + 3)) for i in range(3)),
            equal(lambda x: x[0] + 2 * x[1] + 2 * x[2] - 7.2 * sine(x, 6)),
        ),
    ),
    60: Statement(
        lambda x: (x[0] - 1) ** 2 + (x[0] - x[1]) ** 2 + (x[1] - x[2]) ** 4,
        (2, 2, 2),
        0.03256820025,
        box=((-10, 10),) * 3,
        rows=(equal(lambda x: x[0] * (1 + x[1] ** 2) + x[2] ** 4 - 4 - 3 * SQRT2),),
    ),
    61: Statement(
        lambda x: 4 * x[0] ** 2 + 2 * x[1] ** 2 + 2 * x[2] ** 2 - 33 * x[0] + 16 * x[1] - 24 * x[2],
        (0, 0, 0),
        -143.6461422,
        rows=(
            equal(lambda x: 3 * x[0] - 2 * x[1] ** 2 - 7),
            equal(lambda x: 4 * x[0] - x[2] ** 2 - 11),
        ),
    ),
    62: Statement(
        lambda x: (
            -32.174
            * (
                255 * ca.log((x[0] + x[1] + x[2] + 0.03) / (0.09 * x[0] + x[1] + x[2] + 0.03))
                + 280 * ca.log((x[1] + x[2] + 0.03) / (0.07 * x[1] + x[2] + 0.03))
                + 290 * ca.log((x[2] + 0.03) / (0.13 * x[2] + 0.03))
            )
        ),
        (0.7, 0.2, 0.1),
        -26272.51448,
        box=((0, 1),) * 3,
        rows=(equal(lambda x: x[0] + x[1] + x[2] - 1),),
    ),
    63: Statement(
        lambda x: 1000 - x[0] ** 2 - 2 * x[1] ** 2 - x[2] ** 2 - x[0] * x[1] - x[0] * x[2],
        (2, 2, 2),
        961.7151721,
        box=(POSITIVE,) * 3,
        rows=(
            equal(lambda x: 8 * x[0] + 14 * x[1] + 7 * x[2] - 56),
            equal(lambda x: x[0] ** 2 + x[1] ** 2 + x[2] ** 2 - 25),
        ),
    ),
    64: Statement(
        lambda x: 5 * x[0] + 50000 / x[0] + 20 * x[1] + 72000 / x[1] + 10 * x[2] + 144000 / x[2],
        (1, 1, 1),
        6299.842428,
        box=((1e-5, math.inf),) * 3,
        rows=(positive(lambda x: 1 - 4 / x[0] - 32 / x[1] - 120 / x[2]),),
        traits="badly scaled",
    ),
    65: Statement(
        lambda x: (x[0] - x[1]) ** 2 + (x[0] + x[1] - 10) ** 2 / 9 + (x[2] - 5) ** 2,
        (-5, 5, 0),
        0.9535288567,
        box=((-4.5, 4.5), (-4.5, 4.5), (-5, 5)),
        rows=(positive(lambda x: 48 - x[0] ** 2 - x[1] ** 2 - x[2] ** 2),),
    ),
    66: Statement(
        lambda x: 0.2 * x[2] - 0.8 * x[0],
        (0, 1.05, 2.9),
        0.5181632741,
        box=((0, 100), (0, 100), (0, 10)),
        rows=EXPONENTIALS,
    ),
    77: Statement(
        lambda x: (
            (x[0] - 1) ** 2
            + (x[0] - x[1]) ** 2
            + (x[2] - 1) ** 2
            + (x[3] - 1) ** 4
            + (x[4] - 1) ** 6
        ),
        (2, 2, 2, 2, 2),
        0.24150513,
        rows=(
            equal(lambda x: x[0] ** 2 * x[3] + ca.sin(x[3] - x[4]) - 2 * SQRT2),
            equal(lambda x: x[1] + x[2] ** 4 * x[3] ** 2 - 8 - SQRT2),
        ),
    ),
    79: Statement(
        lambda x: (
            (x[0] - 1) ** 2
            + (x[0] - x[1]) ** 2
            + (x[1] - x[2]) ** 2
            + (x[2] - x[3]) ** 4
            + (x[3] - x[4]) ** 4
        ),
        (2, 2, 2, 2, 2),
        0.0787768209,
        rows=(
            equal(lambda x: x[0] + x[1] ** 2 + x[2] ** 3 - 2 - 3 * SQRT2),
            equal(lambda x: x[1] - x[2] ** 2 + x[3] + 2 - 2 * SQRT2),
            equal(lambda x: x[0] * x[4] - 2),
        ),
    ),
    80: Statement(
        lambda x: ca.exp(product(x)),
        (-2, 2, 2, -1, -1),
        0.0539498478,
        box=((-2.3, 2.3),) * 2 + ((-3.2, 3.2),) * 3,
        rows=EIGHTY,
    ),
    81: Statement(
        lambda x: ca.exp(product(x)) - 0.5 * (x[0] ** 3 + x[1] ** 3 + 1) ** 2,
        (-2, 2, 2, -1, -1),
        0.0539498478,
        box=((-2.3, 2.3),) * 2 + ((-3.2, 3.2),) * 3,
        rows=EIGHTY,
    ),
    93: Statement(
        lambda x: (
            0.0204 * volumes(x)[0]
            + 0.0187 * volumes(x)[1]
            + 0.0607 * volumes(x)[0] * x[4] ** 2
            + 0.0437 * volumes(x)[1] * x[5] ** 2
        ),
        (5.54, 4.4, 12.02, 11.82, 0.702, 0.852),
        135.075961,
        box=(POSITIVE,) * 6,
        rows=(
            positive(lambda x: 0.001 * product(x) * x[5] - 2.07),
            positive(
                lambda x: (
                    1 - 0.00062 * volumes(x)[0] * x[4] ** 2 - 0.00058 * volumes(x)[1] * x[5] ** 2
                )
            ),
        ),
    ),
    104: Statement(
        reactor,
        (6, 3, 0.4, 0.2, 6, 6, 1, 0.5),
        3.9511634396,
        box=((0.1, 10),) * 8,
        rows=(
            positive(lambda x: 1 - 0.0588 * x[4] * x[6] - 0.1 * x[0]),
            positive(lambda x: 1 - 0.0588 * x[5] * x[7] - 0.1 * x[0] - 0.1 * x[1]),
            *(
                positive(
                    lambda x, i=i: (
                        1
                        - (4 * x[i] + 2 * x[i] ** -0.71) / x[i + 2]
                        - 0.0588 * x[i + 4] * x[i] ** -1.3
                    )
                )
                for i in (2, 3)
            ),
            (reactor, 1.0, 4.2),
        ),
    ),
    110: Statement(
        lambda x: (
            sum(ca.log(x[i] - 2) ** 2 + ca.log(10 - x[i]) ** 2 for i in range(10))
            - (product(x) * product([x[i] for i in range(5, 10)])) ** 0.2
        ),
        (9,) * 10,
        -45.77846971,
        box=((2.001, 9.999),) * 10,
    ),
    112: Statement(
        energy,
        (0.1,) * 10,
        -47.76109026,
        box=((1e-6, math.inf),) * 10,
        rows=(
            equal(lambda x: x[0] + 2 * x[1] + 2 * x[2] + x[5] + x[9] - 2),
            equal(lambda x: x[3] + 2 * x[4] + x[5] + x[6] - 1),
            equal(lambda x: x[2] + x[6] + x[7] + 2 * x[8] + x[9] - 1),
        ),
    ),
    113: Statement(
        lambda x: (
            x[0] ** 2
            + x[1] ** 2
            + x[0] * x[1]
            - 14 * x[0]
            - 16 * x[1]
            + (x[2] - 10) ** 2
            + 4 * (x[3] - 5) ** 2
            + (x[4] - 3) ** 2
            + 2 * (x[5] - 1) ** 2
            + 5 * x[6] ** 2
            + 7 * (x[7] - 11) ** 2
            + 2 * (x[8] - 10) ** 2
            + (x[9] - 7) ** 2
            + 45
        ),
        (2, 3, 5, 5, 1, 2, 7, 3, 6, 10),
        24.3062091,
        rows=(
            positive(lambda x: 105 - 4 * x[0] - 5 * x[1] + 3 * x[6] - 9 * x[7]),
            positive(lambda x: -10 * x[0] + 8 * x[1] + 17 * x[6] - 2 * x[7]),
            positive(lambda x: 8 * x[0] - 2 * x[1] - 5 * x[8] + 2 * x[9] + 12),
            positive(
                lambda x: 120 - 3 * (x[0] - 2) ** 2 - 4 * (x[1] - 3) ** 2 - 2 * x[2] ** 2 + 7 * x[3]
            ),
            positive(lambda x: 40 - 5 * x[0] ** 2 - 8 * x[1] - (x[2] - 6) ** 2 + 2 * x[3]),
            positive(
                lambda x: 30 - (x[0] - 8) ** 2 / 2 - 2 * (x[1] - 4) ** 2 - 3 * x[4] ** 2 + x[5]
            ),
            positive(
                lambda x: 2 * x[0] * x[1] - x[0] ** 2 - 2 * (x[1] - 2) ** 2 - 14 * x[4] + 6 * x[5]
            ),
            positive(lambda x: 3 * x[0] - 6 * x[1] - 12 * (x[8] - 8) ** 2 + 7 * x[9]),
        ),
    ),
}

ALL = STATEMENTS | MORE


@cache
def published_more(number: int) -> Published:
    """The problem of a number in `MORE`, built once."""
    return posed(number, MORE[number])


def dictionary(number: int) -> csw.Problem:
    """A problem as a dictionary of expressions."""
    stated = ALL[number]
    x = ca.SX.sym("x", len(stated.start))
    nlp = {"x": x, "f": stated.objective(x)}
    lbx, ubx = zip(*stated.box, strict=True) if stated.box else (-np.inf, np.inf)
    arguments = {"x0": stated.start, "lbx": lbx, "ubx": ubx}
    if stated.rows:
        functions, lower, upper = zip(*stated.rows, strict=True)
        nlp["g"] = ca.vertcat(*(row(x) for row in functions))
        arguments |= {"lbg": lower, "ubg": upper}
    return csw.Problem.from_casadi(nlp, f"hs-{number}", **arguments)


def stack(number: int) -> csw.Problem:
    """A problem as an Opti stack, with bounds as rows."""
    stated, opti = ALL[number], ca.Opti()
    x = opti.variable(len(stated.start))
    opti.minimize(stated.objective(x))
    bounds: list[Row] = [(lambda x, i=i: x[i], *pair) for i, pair in enumerate(stated.box)]
    for function, low, high in (*stated.rows, *(row for row in bounds if row[1:] != FREE)):
        opti.subject_to(opti.bounded(low, function(x), high))
    opti.set_initial(x, stated.start)
    return csw.Problem.from_opti(opti, f"hs-{number}")
