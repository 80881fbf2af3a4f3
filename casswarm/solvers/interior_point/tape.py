"""CasADi functions as lists of scalar operations, evaluated over batches by a compiled loop."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from ..._util.threads import locked_cache
from ...compiled.kernels import generated_module
from ...typing import Expr, FloatArray, IntArray
from .iterate_kernels import LANES

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


MAX_OPERATIONS = 200_000
"""Number of operations above which lists of them take too much memory and time."""

MAX_ARGUMENTS = 3


def scalar(function: Expr) -> Expr:
    """A CasADi function of scalar operations.

    Raises
    ------
    NotImplementedError
        It calls something that is not an expression.
    """
    try:
        return function if function.is_a("SXFunction") else function.expand()
    except RuntimeError as error:
        raise NotImplementedError(str(error)) from error


@dataclass(frozen=True, eq=False)
class Tape:
    """A function of stacked arguments as a list of scalar operations.

    Parameters
    ----------
    operations : (m, 4) int
        Operation, place of its result, places of its two arguments. The arguments of an input are
        the number of the array and the entry there; the second one of an output is its entry in
        the stacked outputs.
    constants : (m,)
        Of operations that have one.
    size : int
        Number of places.
    patterns : tuple of (2, k) int
        Rows and columns of the entries of each output.
    """

    operations: IntArray
    constants: FloatArray
    size: int
    patterns: tuple[IntArray, ...]

    @classmethod
    def of(cls, arguments: list[Expr], outputs: list[Expr]) -> Tape:
        """Tape of scalar expressions of dense symbols.

        Raises
        ------
        NotImplementedError
            There is an operation that no tape has, or there are more than `MAX_OPERATIONS`.
        """
        merged: Any = ca.cse(outputs)
        function = ca.Function("tape", arguments, merged)
        if function.n_instructions() > MAX_OPERATIONS:
            raise NotImplementedError(f"{function.n_instructions()} operations")
        first_out = np.cumsum([0, *map(function.nnz_out, range(function.n_out()))])
        operations = np.zeros((function.n_instructions(), 4), np.int64)
        constants = np.zeros(len(operations))
        for k in range(len(operations)):
            code = function.instruction_id(k)
            if code not in OPERATIONS:
                raise NotImplementedError(f"operation {code} of CasADi")
            places, results = function.instruction_input(k), function.instruction_output(k)
            row: tuple[int, ...]
            if code == ca.OP_CONST:
                constants[k] = function.instruction_constant(k)
                row = results[0], 0, 0
            elif code == ca.OP_INPUT:
                row = results[0], *places
            elif code == ca.OP_OUTPUT:
                row = 0, places[0], first_out[results[0]] + results[1]
            else:
                row = results[0], places[0], places[-1]
            operations[k] = OPERATIONS[code], *row
        patterns = tuple(
            np.array(function.sparsity_out(k).get_triplet(), np.int64)
            for k in range(function.n_out())
        )
        return cls(operations, constants, _separate_results(operations), patterns)

    def __call__(self, *arguments: FloatArray) -> list[FloatArray]:
        """Entries of the outputs, each (k, b), at arguments of shapes (size, b)."""
        ends = np.cumsum([pattern.shape[1] for pattern in self.patterns])
        results, places = np.empty((ends[-1], arguments[0].shape[1])), np.zeros((self.size, LANES))
        missing = (np.empty((0, 0)),) * (MAX_ARGUMENTS - len(arguments))
        inputs = tuple(map(np.ascontiguousarray, arguments)) + missing  # one type is compiled
        evaluation()(self.operations, self.constants, inputs, places, results)
        return np.split(results, ends[:-1])


def _separate_results(operations: IntArray) -> int:
    """Change places so that no result replaces an argument of its operation; their number.

    Compilers make vector operations of loops only where the arrays do not overlap.
    """
    no_arguments = OPERATIONS[ca.OP_INPUT], OPERATIONS[ca.OP_CONST]
    output = OPERATIONS[ca.OP_OUTPUT]
    last: dict[int, int] = {}  # operation that uses a place last, before it is written again
    ends = np.zeros((len(operations), 2), bool)
    for k in range(len(operations) - 1, -1, -1):
        code, target, one, two = operations[k].tolist()
        if code != output:
            last.pop(target, None)
        if code not in no_arguments:
            used = (one,) if code == output else (one, two)
            for column, place in enumerate(used):
                ends[k, column] = place not in last
            for place in used:
                last.setdefault(place, k)
    new: dict[int, int] = {}
    free: list[int] = []
    number = 0
    for k in range(len(operations)):
        code, target, one, two = operations[k].tolist()
        left = []
        if code not in no_arguments:
            used = (one,) if code == output else (one, two)
            operations[k, 2 : 2 + len(used)] = [new[place] for place in used]
            left = [new[place] for place, end in zip(used, ends[k], strict=False) if end]
        if code != output:
            if not free:
                free.append(number)
                number += 1
            new[target] = operations[k, 1] = free.pop()
        free += dict.fromkeys(left)
    return number
