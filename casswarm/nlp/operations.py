"""Instructions of a scalar CasADi function, in order: what code and files are generated from."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import casadi as ca

from ..typing import Expr


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
