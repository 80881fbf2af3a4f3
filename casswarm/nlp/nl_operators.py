"""Operators of .nl files and of CasADi: how each is read, and how each is written."""

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

TEMPLATES: dict[int, str] = {
    ca.OP_ASSIGN: "{0}",
    ca.OP_ADD: "o0 {0} {1}",
    ca.OP_SUB: "o1 {0} {1}",
    ca.OP_MUL: "o2 {0} {1}",
    ca.OP_DIV: "o3 {0} {1}",
    ca.OP_FMOD: "o4 {0} {1}",
    ca.OP_POW: "o5 {0} {1}",
    ca.OP_CONSTPOW: "o5 {0} {1}",
    ca.OP_SQ: "o5 {0} n2",
    ca.OP_TWICE: "o2 n2 {0}",
    ca.OP_INV: "o3 n1 {0}",
    ca.OP_NEG: "o16 {0}",
    ca.OP_FMIN: "o11 2 {0} {1}",
    ca.OP_FMAX: "o12 2 {0} {1}",
    ca.OP_FLOOR: "o13 {0}",
    ca.OP_CEIL: "o14 {0}",
    ca.OP_FABS: "o15 {0}",
    # conditions are no numbers in these files, so that each is asked for or made one
    ca.OP_LT: "o35 o22 {0} {1} n1 n0",
    ca.OP_LE: "o35 o23 {0} {1} n1 n0",
    ca.OP_EQ: "o35 o24 {0} {1} n1 n0",
    ca.OP_NE: "o35 o30 {0} {1} n1 n0",
    ca.OP_OR: "o35 o20 o30 {0} n0 o30 {1} n0 n1 n0",
    ca.OP_AND: "o35 o21 o30 {0} n0 o30 {1} n0 n1 n0",
    ca.OP_NOT: "o35 o24 {0} n0 n1 n0",
    ca.OP_IF_ELSE_ZERO: "o35 o30 {0} n0 {1} n0",
    ca.OP_SIGN: "o35 o22 {0} n0 n-1 o35 o22 n0 {0} n1 n0",
    ca.OP_TANH: "o37 {0}",
    ca.OP_TAN: "o38 {0}",
    ca.OP_SQRT: "o39 {0}",
    ca.OP_HYPOT: "o39 o0 o5 {0} n2 o5 {1} n2",
    ca.OP_SINH: "o40 {0}",
    ca.OP_SIN: "o41 {0}",
    ca.OP_LOG: "o43 {0}",
    ca.OP_LOG1P: "o43 o0 n1 {0}",
    ca.OP_EXP: "o44 {0}",
    ca.OP_EXPM1: "o1 o44 {0} n1",
    ca.OP_COSH: "o45 {0}",
    ca.OP_COS: "o46 {0}",
    ca.OP_ATANH: "o47 {0}",
    ca.OP_ATAN2: "o48 {0} {1}",
    ca.OP_ATAN: "o49 {0}",
    ca.OP_ASINH: "o50 {0}",
    ca.OP_ASIN: "o51 {0}",
    ca.OP_ACOSH: "o52 {0}",
    ca.OP_ACOS: "o53 {0}",
}
"""What CasADi's operations are written as, in prefix notation; {0} and {1} are the arguments."""
