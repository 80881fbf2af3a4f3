"""CasADi's scalar operations: functions that lead to each, and inputs that it is defined for."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import casadi as ca

Limits = tuple[float, float]

UNARY: dict[int, tuple[Callable[[Any], Any], Limits]] = {
    ca.OP_NEG: (lambda x: -x, (-9, 9)),
    ca.OP_SQ: (lambda x: x**2, (-9, 9)),
    ca.OP_TWICE: (lambda x: x + x, (-9, 9)),
    ca.OP_INV: (lambda x: 1 / x, (0.01, 9)),
    ca.OP_NOT: (ca.logic_not, (-1, 1)),
    ca.OP_SQRT: (ca.sqrt, (0, 9)),
    ca.OP_EXP: (ca.exp, (-9, 9)),
    ca.OP_LOG: (ca.log, (0.01, 9)),
    ca.OP_EXPM1: (ca.expm1, (-9, 9)),
    ca.OP_LOG1P: (ca.log1p, (-0.99, 9)),
    ca.OP_FABS: (ca.fabs, (-9, 9)),
    ca.OP_SIGN: (ca.sign, (-9, 9)),
    ca.OP_FLOOR: (ca.floor, (-9, 9)),
    ca.OP_CEIL: (ca.ceil, (-9, 9)),
    ca.OP_SIN: (ca.sin, (-9, 9)),
    ca.OP_COS: (ca.cos, (-9, 9)),
    ca.OP_TAN: (ca.tan, (-1.5, 1.5)),
    ca.OP_ATAN: (ca.atan, (-9, 9)),
    ca.OP_SINH: (ca.sinh, (-9, 9)),
    ca.OP_COSH: (ca.cosh, (-9, 9)),
    ca.OP_TANH: (ca.tanh, (-9, 9)),
    ca.OP_CONSTPOW: (lambda x: x**2.7, (0, 9)),
}
BINARY: dict[int, tuple[Callable[[Any, Any], Any], Limits]] = {
    ca.OP_ADD: (lambda x, y: x + y, (-9, 9)),
    ca.OP_SUB: (lambda x, y: x - y, (-9, 9)),
    ca.OP_MUL: (lambda x, y: x * y, (-9, 9)),
    ca.OP_DIV: (lambda x, y: x / y, (0.01, 9)),
    ca.OP_POW: (lambda x, y: x**y, (0.01, 9)),
    ca.OP_LT: (lambda x, y: x < y, (-2, 2)),
    ca.OP_LE: (lambda x, y: x <= y, (-2, 2)),
    ca.OP_EQ: (lambda x, y: x == y, (-2, 2)),
    ca.OP_NE: (lambda x, y: x != y, (-2, 2)),
    ca.OP_AND: (ca.logic_and, (-1, 1)),
    ca.OP_OR: (ca.logic_or, (-1, 1)),
    ca.OP_FMIN: (ca.fmin, (-9, 9)),
    ca.OP_FMAX: (ca.fmax, (-9, 9)),
    ca.OP_ATAN2: (ca.atan2, (-9, 9)),
    ca.OP_HYPOT: (ca.hypot, (-9, 9)),
    ca.OP_IF_ELSE_ZERO: (lambda x, y: ca.if_else(x, y, 0), (-1, 1)),
}
