"""Scalar operations of CasADi: the instructions of a function, and how each operation is written.

Compiled loops, functions of arrays and files are generated from them.
"""

from __future__ import annotations

import csv
import operator
from collections.abc import Callable, Iterator
from functools import reduce
from pathlib import Path
from typing import NamedTuple

import casadi as ca

from ..typing import Expr


class Operation(NamedTuple):
    """Texts of an operation with arguments {x} and {y}, empty where a language does not have it.

    Numbers in Python (compiled loops), NumPy, and the prefix notation of .nl files.
    """

    scalar: str
    array: str
    nl: str


class Operator(NamedTuple):
    """Function of an operator of .nl files, and its arguments' number, None if a file states it."""

    function: Callable[..., Expr]
    arguments: int | None


_TABLE = list(csv.DictReader(Path(__file__).with_suffix(".csv").read_text("utf-8").splitlines()))

OPERATIONS = {
    getattr(ca, f"OP_{row['casadi']}"): Operation(row["scalar"], row["array"], row["nl"])
    for row in _TABLE
    if row["casadi"]
}
"""Operations by CasADi's code. In .nl files conditions are no numbers, so that each is asked for or
made one."""

_FUNCTIONS: dict[str, Callable[..., Expr]] = {
    "log10": lambda a: ca.log(a) / ca.log(10),
    "positive_difference": lambda a, b: ca.fmax(a - b, 0),
    "integer_quotient": lambda a, b: ca.sign(a / b) * ca.floor(ca.fabs(a / b)),
}


def _operator(nl: str, name: str) -> tuple[int, Operator]:
    """Number of an operator, and its function by a name here, in `operator` or in CasADi."""
    code, *items = nl.split()
    function = _FUNCTIONS.get(name) or getattr(operator, name, None) or getattr(ca, name)
    if items[0] == "2":
        return int(code[1:]), Operator(lambda *terms: reduce(function, terms), None)
    return int(code[1:]), Operator(function, len(items))


OPERATORS = dict(_operator(row["nl"], row["read"]) for row in _TABLE if row["read"])
"""Operators of .nl files by number, as they are read."""


class Instruction(NamedTuple):
    """A scalar operation: CasADi's code, indices of what it reads and writes, and its constant.

    Of ``OP_INPUT`` and ``OP_OUTPUT``, the indices are the argument or result and its entry.
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
