"""Problems of Hock and Schittkowski, as `hock_schittkowski.toml` states them, in several forms."""

from __future__ import annotations

import math
import re
import tomllib
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np
from known_problems import INF, Known, active_box, known

import casswarm as csw

STATED = tomllib.loads(Path(__file__).with_suffix(".toml").read_text(encoding="utf-8"))
MORE: tuple[int, ...] = tuple(STATED.pop("more"))
NUMBERS = tuple(number for number in map(int, STATED) if number not in MORE)
"""Those that every solver solves in the tests; `MORE` are posed in every form and in batches."""

FUNCTIONS = {name: getattr(ca, name) for name in ("cos", "exp", "log", "sin", "sqrt", "sumsqr")}
NAMES = FUNCTIONS | {"pi": math.pi, "vertsplit": ca.vertsplit}
ROW = re.compile(r"(?:(\S+) <= )?(.*) (=|<=|>=) (\S+)")


def expression(text: str) -> Callable[[Any], Any]:
    """The function of x of a text in x1, x2 and so on, or in x."""

    def function(x: Any) -> Any:
        parts = {f"x{i + 1}": x[i] for i in range(x.numel())}
        return eval(f"({text})", {**NAMES, **parts, "x": x})

    return function


def row(text: str) -> tuple[Callable[[Any], Any], float, float]:
    """The function and bounds of a constraint."""
    low, body, relation, bound = ROW.fullmatch(text).groups()  # type: ignore[union-attr]
    least = float(low) if low else -INF if relation == "<=" else float(bound)
    return expression(body), least, INF if relation == ">=" else float(bound)


def bounds(number: int) -> list[list[float]]:
    """Lower and upper bounds of the variables."""
    stated = STATED[str(number)]
    size = len(stated["x0"])
    given = (stated.get("lower", -INF), stated.get("upper", INF))
    return [each if isinstance(each, list) else [each] * size for each in given]


def rows(number: int) -> dict[str, tuple[Callable[[Any], Any], float, float]]:
    """Functions and bounds of the constraints by name."""
    stated = STATED[str(number)].get("rows", {})
    named = stated if isinstance(stated, dict) else {f"row{i}": row for i, row in enumerate(stated)}
    return {name: row(text) for name, text in named.items()}


def values(stated: Any) -> list[float]:
    """Numbers, and texts of numbers."""
    return [eval(value, NAMES) if isinstance(value, str) else value for value in stated]


@cache
def published(number: int) -> Known:
    """The problem of a number, built once."""
    stated = STATED[str(number)]
    optimum, *local = values([stated["optimum"], *stated.get("local", ())])
    return known(
        f"HS {number}",
        expression(stated["f"]),
        (stated.get("x", [math.nan] * len(stated["x0"])), float(optimum)),
        stated["x0"],
        box=bounds(number),
        rows=rows(number),
        bound_multipliers=stated.get("bound_multipliers", ()),
        row_multipliers=stated.get("row_multipliers", ()),
        local=tuple(local),
        traits=stated.get("traits", ""),
    )


KNOWN = (active_box(), *map(published, (1, 6, 7, 21, 35, 71)))
"""Problems with known multipliers."""


def dictionary(number: int) -> csw.Problem:
    """A problem as a dictionary of expressions."""
    stated = STATED[str(number)]
    x = ca.SX.sym("x", len(stated["x0"]))
    lbx, ubx = bounds(number)
    nlp, arguments = {"x": x, "f": expression(stated["f"])(x)}, {"lbx": lbx, "ubx": ubx}
    if constraints := rows(number):
        functions, lower, upper = zip(*constraints.values(), strict=True)
        nlp["g"] = ca.vertcat(*(function(x) for function in functions))
        arguments |= {"lbg": lower, "ubg": upper}
    return csw.Problem.from_casadi(nlp, f"hs-{number}", x0=stated["x0"], **arguments)


def stack(number: int) -> csw.Problem:
    """A problem as an Opti stack, with bounds as rows."""
    stated, opti = STATED[str(number)], ca.Opti()
    x = opti.variable(len(stated["x0"]))
    opti.minimize(expression(stated["f"])(x))
    for function, low, high in rows(number).values():
        opti.subject_to(opti.bounded(low, function(x), high))
    for i, (low, high) in enumerate(zip(*bounds(number), strict=True)):
        if (low, high) != (-INF, INF):
            opti.subject_to(opti.bounded(low, x[i], high))
    opti.set_initial(x, np.array(stated["x0"]))
    return csw.Problem.from_opti(opti, f"hs-{number}")
