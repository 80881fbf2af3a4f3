"""Scalar operations of tapes, by CasADi's codes."""

from __future__ import annotations

import casadi as ca

_NAMES = (
    "INPUT", "OUTPUT", "CONST", "ASSIGN",
    "ADD", "SUB", "MUL", "DIV", "NEG", "INV", "SQ", "TWICE", "SQRT", "EXP", "LOG", "POW",
    "CONSTPOW", "SIN", "COS", "TAN", "ASIN", "ACOS", "ATAN", "SINH", "COSH", "TANH", "ASINH",
    "ACOSH", "ATANH", "ATAN2", "FLOOR", "CEIL", "FABS", "SIGN", "FMIN", "FMAX", "LT", "LE", "EQ",
    "NE", "NOT", "AND", "OR", "IF_ELSE_ZERO", "ERF", "LOG1P", "EXPM1", "HYPOT", "COPYSIGN",
)  # fmt: skip

OPERATIONS = {getattr(ca, f"OP_{name}"): number for number, name in enumerate(_NAMES)}
"""Number of an operation in `tape_kernels`, by CasADi's code."""
