"""CasADi functions as lists of scalar operations, evaluated over batches by a compiled loop."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from ..._util.threads import locked_cache
from ...compiled.kernels import generated_module, specialised
from ...nlp.operations import OPERATIONS, instructions, operation_name
from ...typing import Expr, FloatArray, IntArray
from .iterate_kernels import LANES
from .tape_kernels import evaluate

_RESULTS = {code: text for code, (text, *_) in OPERATIONS.items() if text}

NUMBERS = {
    code: number for number, code in enumerate((ca.OP_INPUT, ca.OP_OUTPUT, ca.OP_CONST, *_RESULTS))
}
"""Number of an operation on a tape, by CasADi's code."""

_ARGUMENTS = (0, 1, 0, *(2 for _ in _RESULTS))
"""Number of places that an operation reads, by its number on a tape."""

_CASE = """
    if code == {number}:
        for lane in range(LANES):
            x, y = places[one, lane], places[two, lane]
            places[out, lane] = {result}"""


@locked_cache(maxsize=1)
def evaluation() -> Callable[..., Any]:
    """`tape_kernels.evaluate` with the operations of the table."""
    cases = (
        _CASE.format(number=NUMBERS[code], result=text.format(x="x", y="y"))
        for code, text in _RESULTS.items()
    )
    operate = f"LANES = {LANES}\n\n\ndef operate(code, one, two, out, places):{''.join(cases)}"
    function: Callable[..., Any] = generated_module(specialised(operate, evaluate)).evaluate
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
        function = ca.Function("tape", arguments, merged, {"live_variables": False})
        if function.n_instructions() > MAX_OPERATIONS:
            raise NotImplementedError(f"{function.n_instructions()} operations")
        first_out = np.cumsum([0, *map(function.nnz_out, range(function.n_out()))])
        operations = np.zeros((function.n_instructions(), 4), np.int64)
        constants = np.zeros(len(operations))
        for k, (code, places, results, constant) in enumerate(instructions(function)):
            if code not in NUMBERS:
                raise NotImplementedError(f"operation {operation_name(code)} of CasADi")
            row: tuple[int, ...]
            if code == ca.OP_CONST:
                constants[k] = constant
                row = results[0], 0, 0
            elif code == ca.OP_INPUT:
                row = results[0], *places
            elif code == ca.OP_OUTPUT:
                row = 0, places[0], first_out[results[0]] + results[1]
            else:
                row = results[0], places[0], places[-1]
            operations[k] = NUMBERS[code], *row
        return cls(operations, constants, _shared_places(operations), _patterns(function))

    def __call__(self, *arguments: FloatArray) -> list[FloatArray]:
        """Entries of the outputs, each (k, b), at arguments of shapes (size, b)."""
        ends = np.cumsum([pattern.shape[1] for pattern in self.patterns])
        results, places = np.empty((ends[-1], arguments[0].shape[1])), np.zeros((self.size, LANES))
        missing = (np.empty((0, 0)),) * (MAX_ARGUMENTS - len(arguments))
        inputs = tuple(map(np.ascontiguousarray, arguments)) + missing  # one type is compiled
        evaluation()(self.operations, self.constants, inputs, places, results)
        return np.split(results, ends[:-1])


@dataclass(frozen=True, eq=False)
class Calls:
    """A CasADi function of stacked arguments that is called for every instance, like a `Tape`."""

    function: Expr
    patterns: tuple[IntArray, ...]

    @classmethod
    def of(cls, arguments: list[Expr], outputs: list[Expr]) -> Calls:
        """Function of dense symbols."""
        function = ca.Function("calls", arguments, outputs)
        return cls(function, _patterns(function))

    def __call__(self, *arguments: FloatArray) -> list[FloatArray]:
        """Entries of the outputs, each (k, b), at arguments of shapes (size, b)."""
        columns = zip(*(argument.T for argument in arguments), strict=True)
        results = [self.function.call(list(each)) for each in columns]
        entries = [[result[k].nonzeros() for result in results] for k in range(len(self.patterns))]
        return [
            np.ascontiguousarray(np.reshape(each, (len(results), pattern.shape[1])).T, float)
            for each, pattern in zip(entries, self.patterns, strict=True)
        ]


def _patterns(function: Expr) -> tuple[IntArray, ...]:
    """Rows and columns (2, k) of the entries of every output."""
    outputs = map(function.sparsity_out, range(function.n_out()))
    return tuple(np.array(output.get_triplet(), np.int64) for output in outputs)


def _shared_places(operations: IntArray) -> int:
    """Change places, one for each result, so that they are used again; their number.

    No result replaces an argument of its operation: compilers make vector operations of loops only
    where the arrays do not overlap.
    """
    last: dict[int, int] = {}  # operation that uses a place last
    for k, (code, _, *places) in enumerate(operations.tolist()):
        last |= dict.fromkeys(places[: _ARGUMENTS[code]], k)
    new: dict[int, int] = {}
    free: list[int] = []
    number = 0
    for k, (code, target, *places) in enumerate(operations.tolist()):
        used = places[: _ARGUMENTS[code]]
        operations[k, 2 : 2 + len(used)] = [new[place] for place in used]
        if code != NUMBERS[ca.OP_OUTPUT]:
            if not free:
                free.append(number)
                number += 1
            new[target] = operations[k, 1] = free.pop()
        free += dict.fromkeys(new[place] for place in used if last[place] == k)
    return number
