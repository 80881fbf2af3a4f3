"""Operators of .nl files: how each is read. How they are written is in `operations`."""

from __future__ import annotations

from collections.abc import Callable
from functools import reduce

import casadi as ca

from ..typing import Expr

Operator = Callable[..., Expr]

UNARY: dict[int, Operator] = {
    13: ca.floor,
    14: ca.ceil,
    15: ca.fabs,
    16: lambda a: -a,
    34: ca.logic_not,
    37: ca.tanh,
    38: ca.tan,
    39: ca.sqrt,
    40: ca.sinh,
    41: ca.sin,
    42: lambda a: ca.log(a) / ca.log(10),
    43: ca.log,
    44: ca.exp,
    45: ca.cosh,
    46: ca.cos,
    47: ca.atanh,
    49: ca.atan,
    50: ca.asinh,
    51: ca.asin,
    52: ca.acosh,
    53: ca.acos,
}
"""Functions of one argument, by the number of the operator in the file."""

BINARY: dict[int, Operator] = {
    0: lambda a, b: a + b,
    1: lambda a, b: a - b,
    2: lambda a, b: a * b,
    3: lambda a, b: a / b,
    4: ca.fmod,
    5: lambda a, b: a**b,
    6: lambda a, b: ca.fmax(a - b, 0),
    20: ca.logic_or,
    21: ca.logic_and,
    22: lambda a, b: a < b,
    23: lambda a, b: a <= b,
    24: lambda a, b: a == b,
    28: lambda a, b: a >= b,
    29: lambda a, b: a > b,
    30: lambda a, b: a != b,
    48: ca.atan2,
    55: lambda a, b: ca.sign(a / b) * ca.floor(ca.fabs(a / b)),
}
"""Functions of two arguments."""

CONDITIONAL = 35
"""The operator of three arguments: condition, value, and value otherwise."""

LISTS: dict[int, Operator] = {
    11: lambda *terms: reduce(ca.fmin, terms),
    12: lambda *terms: reduce(ca.fmax, terms),
    54: lambda *terms: sum(terms),
    70: lambda *terms: reduce(ca.logic_and, terms),
    71: lambda *terms: reduce(ca.logic_or, terms),
}
"""Functions of any number of arguments, which the file states after the operator."""

UNSUPPORTED: dict[int, str] = {
    56: "rounding (precision)",
    57: "rounding (round)",
    58: "rounding (trunc)",
    64: "a piecewise-linear term",
    65: "a conditional string",
    79: "a call of an imported function",
    **dict.fromkeys((59, 60, 61, 62, 63, 66, 67, 68, 69, 72, 73, 74, 75), "a logical constraint"),
}
"""Operators that no smooth problem has, or that CasADi has no counterpart of."""
