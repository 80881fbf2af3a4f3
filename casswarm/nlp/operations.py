"""Scalar operations of CasADi: the instructions of a function, and how each operation is written.

Compiled loops, functions of arrays and files are generated from them.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import casadi as ca

from ..typing import Expr


class Operation(NamedTuple):
    """An operation in other languages; {x} and {y} are its arguments, None where there is no text.

    Parameters
    ----------
    scalar : str, optional
        Python of numbers, as compiled loops have it.
    array : str, optional
        NumPy, for arrays and numbers.
    nl : str, optional
        Prefix notation of .nl files, with a space between items.
    """

    scalar: str | None
    array: str | None
    nl: str | None


OPERATIONS = {
    ca.OP_ASSIGN: Operation("{x}", "{x}", "{x}"),
    ca.OP_ADD: Operation("{x} + {y}", "{x} + {y}", "o0 {x} {y}"),
    ca.OP_SUB: Operation("{x} - {y}", "{x} - {y}", "o1 {x} {y}"),
    ca.OP_MUL: Operation("{x} * {y}", "{x} * {y}", "o2 {x} {y}"),
    ca.OP_DIV: Operation("{x} / {y}", "{x} / {y}", "o3 {x} {y}"),
    ca.OP_NEG: Operation("-{x}", "-{x}", "o16 {x}"),
    ca.OP_INV: Operation("1.0 / {x}", "1.0 / {x}", "o3 n1 {x}"),
    ca.OP_SQ: Operation("{x} * {x}", "{x} * {x}", "o5 {x} n2"),
    ca.OP_TWICE: Operation("2.0 * {x}", "2.0 * {x}", "o2 n2 {x}"),
    ca.OP_SQRT: Operation("math.sqrt({x})", "np.sqrt({x})", "o39 {x}"),
    ca.OP_EXP: Operation("math.exp({x})", "np.exp({x})", "o44 {x}"),
    ca.OP_LOG: Operation("math.log({x})", "np.log({x})", "o43 {x}"),
    ca.OP_POW: Operation("{x} ** {y}", "{x} ** {y}", "o5 {x} {y}"),
    ca.OP_CONSTPOW: Operation("{x} ** {y}", "{x} ** {y}", "o5 {x} {y}"),
    ca.OP_SIN: Operation("math.sin({x})", "np.sin({x})", "o41 {x}"),
    ca.OP_COS: Operation("math.cos({x})", "np.cos({x})", "o46 {x}"),
    ca.OP_TAN: Operation("math.tan({x})", "np.tan({x})", "o38 {x}"),
    ca.OP_ASIN: Operation("math.asin({x})", None, "o51 {x}"),
    ca.OP_ACOS: Operation("math.acos({x})", None, "o53 {x}"),
    ca.OP_ATAN: Operation("math.atan({x})", "np.arctan({x})", "o49 {x}"),
    ca.OP_SINH: Operation("math.sinh({x})", "np.sinh({x})", "o40 {x}"),
    ca.OP_COSH: Operation("math.cosh({x})", "np.cosh({x})", "o45 {x}"),
    ca.OP_TANH: Operation("math.tanh({x})", "np.tanh({x})", "o37 {x}"),
    ca.OP_ASINH: Operation("math.asinh({x})", None, "o50 {x}"),
    ca.OP_ACOSH: Operation("math.acosh({x})", None, "o52 {x}"),
    ca.OP_ATANH: Operation("math.atanh({x})", None, "o47 {x}"),
    ca.OP_ATAN2: Operation("math.atan2({x}, {y})", "np.arctan2({x}, {y})", "o48 {x} {y}"),
    ca.OP_FLOOR: Operation("np.floor({x})", "np.floor({x})", "o13 {x}"),
    ca.OP_CEIL: Operation("np.ceil({x})", "np.ceil({x})", "o14 {x}"),
    ca.OP_FABS: Operation("abs({x})", "np.fabs({x})", "o15 {x}"),
    ca.OP_SIGN: Operation(
        "np.sign({x})", "np.sign({x})", "o35 o22 {x} n0 n-1 o35 o22 n0 {x} n1 n0"
    ),
    ca.OP_FMIN: Operation("np.fmin({x}, {y})", "np.fmin({x}, {y})", "o11 2 {x} {y}"),
    ca.OP_FMAX: Operation("np.fmax({x}, {y})", "np.fmax({x}, {y})", "o12 2 {x} {y}"),
    ca.OP_LT: Operation(
        "1.0 if {x} < {y} else 0.0", "np.less({x}, {y}) * 1.0", "o35 o22 {x} {y} n1 n0"
    ),
    ca.OP_LE: Operation(
        "1.0 if {x} <= {y} else 0.0", "np.less_equal({x}, {y}) * 1.0", "o35 o23 {x} {y} n1 n0"
    ),
    ca.OP_EQ: Operation(
        "1.0 if {x} == {y} else 0.0", "np.equal({x}, {y}) * 1.0", "o35 o24 {x} {y} n1 n0"
    ),
    ca.OP_NE: Operation(
        "1.0 if {x} != {y} else 0.0", "np.not_equal({x}, {y}) * 1.0", "o35 o30 {x} {y} n1 n0"
    ),
    ca.OP_NOT: Operation(
        "1.0 if {x} == 0.0 else 0.0", "np.equal({x}, 0.0) * 1.0", "o35 o24 {x} n0 n1 n0"
    ),
    ca.OP_AND: Operation(
        "1.0 if {x} != 0.0 and {y} != 0.0 else 0.0",
        "np.logical_and({x}, {y}) * 1.0",
        "o35 o21 o30 {x} n0 o30 {y} n0 n1 n0",
    ),
    ca.OP_OR: Operation(
        "1.0 if {x} != 0.0 or {y} != 0.0 else 0.0",
        "np.logical_or({x}, {y}) * 1.0",
        "o35 o20 o30 {x} n0 o30 {y} n0 n1 n0",
    ),
    ca.OP_IF_ELSE_ZERO: Operation(
        "{y} if {x} != 0.0 else 0.0",
        "np.where(np.equal({x}, 0.0), 0.0, {y})",
        "o35 o30 {x} n0 {y} n0",
    ),
    ca.OP_ERF: Operation("math.erf({x})", None, None),
    ca.OP_LOG1P: Operation("math.log1p({x})", "np.log1p({x})", "o43 o0 n1 {x}"),
    ca.OP_EXPM1: Operation("math.expm1({x})", "np.expm1({x})", "o1 o44 {x} n1"),
    ca.OP_HYPOT: Operation(
        "math.hypot({x}, {y})", "np.hypot({x}, {y})", "o39 o0 o5 {x} n2 o5 {y} n2"
    ),
    ca.OP_COPYSIGN: Operation("math.copysign({x}, {y})", None, None),
    ca.OP_FMOD: Operation(None, None, "o4 {x} {y}"),
}
"""Operations by CasADi's code. In .nl files conditions are no numbers, so that each is asked for or
made one."""


class Instruction(NamedTuple):
    """One scalar operation.

    Parameters
    ----------
    operation : int
        CasADi's code, such as ``casadi.OP_ADD``.
    inputs : list of int
        Indices of the values that it reads; of ``OP_INPUT``, the argument and its entry.
    outputs : list of int
        Index of the value that it writes; of ``OP_OUTPUT``, the result and its entry.
    constant : float
        Value of ``OP_CONST``, else zero.
    """

    operation: int
    inputs: list[int]
    outputs: list[int]
    constant: float


def instructions(function: Expr) -> Iterator[Instruction]:
    """Instructions of a CasADi Function of SX. An index can be written to several times."""
    for k in range(function.n_instructions()):
        operation = function.instruction_id(k)
        constant = operation == ca.OP_CONST
        yield Instruction(
            operation,
            function.instruction_input(k),
            function.instruction_output(k),
            float(function.instruction_constant(k)) if constant else 0.0,
        )


def operation_name(operation: int) -> str:
    """CasADi's name of an operation, such as OP_ADD."""
    names = (name for name in dir(ca) if name.startswith("OP_"))
    return next((name for name in names if getattr(ca, name) == operation), str(operation))
