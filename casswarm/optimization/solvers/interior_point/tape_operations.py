"""Scalar operations of tapes, and the compiled loop over them: generated from one table."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import casadi as ca

from ...._util.jit import generated_module
from ...._util.threads import locked_cache
from .lane_kernels import LANES

_RESULTS = {
    "ASSIGN": "x", "ADD": "x + y", "SUB": "x - y", "MUL": "x * y", "DIV": "x / y",
    "NEG": "-x", "INV": "1.0 / x", "SQ": "x * x", "TWICE": "2.0 * x", "SQRT": "math.sqrt(x)",
    "EXP": "math.exp(x)", "LOG": "math.log(x)", "POW": "x ** y", "CONSTPOW": "x ** y",
    "SIN": "math.sin(x)", "COS": "math.cos(x)", "TAN": "math.tan(x)", "ASIN": "math.asin(x)",
    "ACOS": "math.acos(x)", "ATAN": "math.atan(x)", "SINH": "math.sinh(x)",
    "COSH": "math.cosh(x)", "TANH": "math.tanh(x)", "ASINH": "math.asinh(x)",
    "ACOSH": "math.acosh(x)", "ATANH": "math.atanh(x)", "ATAN2": "math.atan2(x, y)",
    "FLOOR": "np.floor(x)", "CEIL": "np.ceil(x)", "FABS": "abs(x)", "SIGN": "np.sign(x)",
    "FMIN": "np.fmin(x, y)", "FMAX": "np.fmax(x, y)", "LT": "1.0 if x < y else 0.0",
    "LE": "1.0 if x <= y else 0.0", "EQ": "1.0 if x == y else 0.0",
    "NE": "1.0 if x != y else 0.0", "NOT": "1.0 if x == 0.0 else 0.0",
    "AND": "1.0 if x != 0.0 and y != 0.0 else 0.0", "OR": "1.0 if x != 0.0 or y != 0.0 else 0.0",
    "IF_ELSE_ZERO": "y if x != 0.0 else 0.0", "ERF": "math.erf(x)", "LOG1P": "math.log1p(x)",
    "EXPM1": "math.expm1(x)", "HYPOT": "math.hypot(x, y)", "COPYSIGN": "math.copysign(x, y)",
}  # fmt: skip
"""Result of an operation of arguments x and y, by the end of CasADi's name."""

_NAMES = ("INPUT", "OUTPUT", "CONST", *_RESULTS)

OPERATIONS = {getattr(ca, f"OP_{name}"): number for number, name in enumerate(_NAMES)}
"""Number of an operation on a tape, by CasADi's code."""

_CASE = """\
                elif code == {number}:  # {name}
                    for lane in range({lanes}):
                        x, y = one[lane], two[lane]
                        out[lane] = {result}
"""

_SOURCE = """\
@kernel
def evaluate(operations, constants, inputs, places, results):
    batch = results.shape[1]
    for first in range(0, batch, {lanes}):
        number = min({lanes}, batch - first)
        for k in range(len(operations)):
            code, target, left, right = operations[k]
            if code == 0:
                values = inputs[left]
                for lane in range(number):
                    places[target, lane] = values[right, first + lane]
            elif code == 1:
                for lane in range(number):
                    results[right, first + lane] = places[left, lane]
            else:
                out, one, two = places[target], places[left], places[right]
                if code == 2:
                    for lane in range({lanes}):
                        out[lane] = constants[k]
{cases}"""


@locked_cache(maxsize=1)
def evaluation() -> Callable[..., Any]:
    """Compiled ``evaluate(operations, constants, inputs, places, results)``.

    It writes the stacked outputs (n, b) of a tape at a tuple of inputs (m, b); `places` are
    (size, LANES), `operations` and `constants` those of `Tape`.
    """
    cases = [
        _CASE.format(number=number, name=name, lanes=LANES, result=result)
        for number, (name, result) in enumerate(_RESULTS.items(), start=3)
    ]
    source = _SOURCE.format(lanes=LANES, cases="".join(cases))
    function: Callable[..., Any] = generated_module(source).evaluate
    return function
