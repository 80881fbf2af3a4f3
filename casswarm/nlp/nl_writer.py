"""Writing problems to .nl files, as text or binary.

Expressions are written as CasADi evaluates them: what is used several times becomes a defined
variable, so that the file is no longer than the problem. The order of variables and constraints is
kept, so that all up to the last nonlinear one are declared as nonlinear.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import casadi as ca
import numpy as np

from ..errors import ProblemError
from ..typing import Expr, FloatArray
from .nl_tokens import HEADER_LINES
from .operations import OPERATIONS, instructions, operation_name
from .program import Instances, Nlp

_LINEAR = (ca.OP_ASSIGN, ca.OP_ADD, ca.OP_SUB, ca.OP_NEG, ca.OP_TWICE)


def nl_text(nlp: Nlp, instance: Instances) -> str:
    """Text of a .nl file of an instance; its parameters are replaced by their values.

    Parameters
    ----------
    nlp : Nlp
    instance : Instances
        A single one, with finite x0.

    Raises
    ------
    ProblemError
        An expression has no counterpart in the format (the message names it), or a number that is
        not finite.
    """
    body = _Body.from_program(nlp, instance)
    expressions = ca.Function("nl", [body.x], [ca.densify(body.nonlinear)])
    defined, (objective, *rows) = _written(expressions, nlp.name)
    lines = _header(nlp, instance, body, len(defined))
    for index, expression in enumerate(defined, nlp.sizes[0]):
        lines += [f"V{index} 0 0", *expression]
    for index, expression in enumerate(rows):
        lines += [f"C{index}", *expression]
    lines += ["O0 0", *objective]
    x0 = instance.x0[0]
    lines += [f"x{len(x0)}", *(f"{i} {_number(value)}" for i, value in enumerate(x0))]
    if rows:
        lines += ["r", *_bounds(instance.lbg[0], instance.ubg[0])]
    lines += ["b", *_bounds(instance.lbx[0], instance.ubx[0])]
    lines += [*_columns(body), *body.jacobian.lines("J"), *body.gradient.lines("G")]
    return "\n".join(lines) + "\n"


def nl_bytes(nlp: Nlp, instance: Instances) -> bytes:
    """Content of a binary .nl file of an instance, in IEEE arithmetic with little end first.

    Parameters, and errors, are those of `nl_text`.
    """
    lines = nl_text(nlp, instance).splitlines()
    header, records = lines[:HEADER_LINES], lines[HEADER_LINES:]
    header[0] = header[0].replace("g", "b", 1)
    header[5] = header[5].replace("0 0 0 1", "0 0 1 1", 1)
    content, segment = ["".join(f"{line}\n" for line in header).encode()], ""
    for line in records:
        key, words = line[0], line[1:].split()
        if key.isdigit() and segment not in ("r", "b"):
            words, key = line.split(), ""  # a pair, a column's end or a number of arguments
        elif key.isalpha() and key not in "nov":
            segment = key
        content.append(key.encode())
        doubles = len(words) if key == "n" or (segment in ("r", "b") and key.isdigit()) else 0
        if not key and segment in ("x", "J", "G"):
            doubles = 1
        integers = len(words) - doubles
        content.append(struct.pack(f"<{integers}i", *map(int, words[:integers])))
        content.append(struct.pack(f"<{doubles}d", *map(float, words[integers:])))
    return b"".join(content)


@dataclass(frozen=True)
class _Terms:
    """Linear terms: for every row, its variables and their coefficients, zero if nonlinear."""

    rows: list[tuple[list[int], list[float]]]

    def count(self) -> int:
        return sum(len(columns) for columns, _ in self.rows)

    def lines(self, key: str) -> Iterator[str]:
        for row, (columns, values) in enumerate(self.rows):
            if columns:
                yield f"{key}{row} {len(columns)}"
                pairs = zip(columns, values, strict=True)
                yield from (f"{column} {_number(value)}" for column, value in pairs)


class _Body(NamedTuple):
    """Objective and constraints: nonlinear expressions and linear terms."""

    x: Expr
    nonlinear: Expr  # (1 + ng,), of f and every row of g; the constant term of linear ones
    jacobian: _Terms
    gradient: _Terms
    rows: int  # up to the last one that is nonlinear
    columns: int  # the same of the variables
    nonlinear_objective: bool

    @classmethod
    def from_program(cls, nlp: Nlp, instance: Instances) -> _Body:
        x = ca.SX.sym("x", nlp.sizes[0])
        try:
            values = ca.vertcat(*nlp.evaluate(x, ca.DM(instance.p[0])))
        except RuntimeError as error:
            reason = str(error).strip().splitlines()[-1]
            raise ProblemError(
                f"{nlp.name} cannot be written as .nl: it has an operation that is not one of "
                f"scalars ({reason})",
                problem=nlp.name,
            ) from error
        function = ca.Function("nl", [x], [ca.densify(values)])
        # that of the derivatives lacks the variables of steps, such as those of x > 1
        sparsity = function.jac_sparsity(0, 0)
        slopes = ca.Function("slopes", [x], [ca.jacobian(values, x)])(0)
        slope = np.array(ca.project(slopes, sparsity).nonzeros())
        constant = np.asarray(function(0)).ravel()
        rows, columns = (np.array(part, dtype=int) for part in sparsity.get_triplet())
        curved = np.array(_nonlinear(function)) | ~np.isfinite(constant)
        curved[rows[~np.isfinite(slope)]] = True
        terms: list[tuple[list[int], list[float]]] = [([], []) for _ in curved]
        for row, column, value in zip(rows, columns, slope, strict=True):
            terms[row][0].append(int(column))
            terms[row][1].append(0.0 if curved[row] else float(value))
        nonlinear = ca.vertcat(
            *(values[i] if curved[i] else ca.SX(constant[i]) for i in range(len(curved)))
        )
        # a linear row of the format has no constant term
        with_body = np.flatnonzero(curved[1:] | (constant[1:] != 0))
        return cls(
            x,
            nonlinear,
            _Terms(terms[1:]),
            _Terms(terms[:1]),
            rows=int(with_body.max(initial=-1)) + 1,
            columns=int(columns[curved[rows]].max(initial=-1)) + 1,
            nonlinear_objective=bool(curved[0]),
        )


def _header(nlp: Nlp, instance: Instances, body: _Body, defined: int) -> list[str]:
    variables, _, constraints = nlp.sizes
    lbg, ubg = instance.lbg[0], instance.ubg[0]
    equations = int((lbg == ubg).sum())
    ranges = int((np.isfinite(lbg) & np.isfinite(ubg)).sum()) - equations
    in_rows = body.columns if body.rows else 0
    in_objective = body.columns if body.nonlinear_objective else 0
    name = "".join(c if c.isascii() and c.isprintable() else "_" for c in nlp.name)
    return [
        f"g3 1 1 0\t# problem {name}",
        f" {variables} {constraints} 1 {ranges} {equations}"
        "\t# variables, constraints, objectives, ranges, equations",
        f" {body.rows} {int(body.nonlinear_objective)}\t# nonlinear constraints, objectives",
        " 0 0\t# network constraints: nonlinear, linear",
        f" {in_rows} {in_objective} {min(in_rows, in_objective)}"
        "\t# nonlinear variables in constraints, objectives, both",
        " 0 0 0 1\t# linear network variables; functions; arithmetic, flags",
        " 0 0 0 0 0\t# discrete variables: binary, integer, nonlinear (b, c, o)",
        f" {body.jacobian.count()} {body.gradient.count()}\t# nonzeros in Jacobian, gradients",
        " 0 0\t# maximum name lengths: constraints, variables",
        f" {defined} 0 0 0 0\t# common expressions: b, c, o, c1, o1",
    ]


def _columns(body: _Body) -> list[str]:
    """Cumulative numbers of entries in the Jacobian's columns, without the last."""
    counts = np.zeros(body.x.numel(), dtype=int)
    for columns, _ in body.jacobian.rows:
        counts[columns] += 1
    sums = np.cumsum(counts)[:-1]
    return [f"k{len(sums)}", *map(str, sums)]


def _bounds(lower: FloatArray, upper: FloatArray) -> Iterator[str]:
    for low, high in zip(lower, upper, strict=True):
        if low == high:
            yield f"4 {_number(low)}"
        elif np.isfinite(low) and np.isfinite(high):
            yield f"0 {_number(low)} {_number(high)}"
        elif np.isfinite(high):
            yield f"1 {_number(high)}"
        else:
            yield f"2 {_number(low)}" if np.isfinite(low) else "3"


def _number(value: float) -> str:
    """The shortest text that reads as the same number."""
    return repr(float(value)).removesuffix(".0")


# --- expressions


def _nonlinear(function: Expr) -> list[bool]:
    """Test each result of a function of SX for nonlinearity, by its operations.

    Derivatives would not tell: those of a step, such as x > 1, are zero.
    """
    degrees: dict[int, int] = {}  # 0 of constants, 1 of linear terms, 2 of all others
    results = [0] * function.numel_out(0)
    for operation, read, written, _ in instructions(function):
        if operation == ca.OP_OUTPUT:
            results[written[1]] = degrees[read[0]]
            continue
        if operation in (ca.OP_CONST, ca.OP_INPUT):
            degree = int(operation == ca.OP_INPUT)
        else:
            of = [degrees[i] for i in read]
            kept = operation in _LINEAR or (operation == ca.OP_MUL and min(of) == 0)
            kept = kept or (operation == ca.OP_DIV and of[1] == 0)
            degree = max(of) if kept or max(of) == 0 else 2
        degrees[written[0]] = degree
    return [degree == 2 for degree in results]


@dataclass(eq=False)
class _Node:
    """A value: words in prefix notation and other values, and how often it is used."""

    words: Sequence[str | _Node]
    uses: int = 0
    symbol: str = ""  # of the defined variable

    def lines(self) -> Iterator[str]:
        """The words, with those of values that are not defined variables in their places."""
        stack = list(reversed(self.words))
        while stack:
            word = stack.pop()
            if isinstance(word, str):
                yield word
            elif word.symbol:
                yield word.symbol
            else:
                stack += reversed(word.words)


def _written(function: Expr, name: str) -> tuple[list[list[str]], list[list[str]]]:
    """Lines of every defined variable, and of every result, of a function of SX."""
    values: dict[int, _Node] = {}
    shared: list[_Node] = []
    results = [_Node(["n0"]) for _ in range(function.numel_out(0))]
    for operation, read, written, constant in instructions(function):
        if operation == ca.OP_OUTPUT:
            results[written[1]] = values[read[0]]
            values[read[0]].uses += 1
            continue
        if operation == ca.OP_CONST:
            if not np.isfinite(constant):
                message = f"{name} cannot be written as .nl: it has the number {constant}"
                raise ProblemError(message, problem=name, value=constant)
            node = _Node([f"n{_number(constant)}"])
        elif operation == ca.OP_INPUT:
            node = _Node([f"v{read[1]}"])
        elif operation in OPERATIONS and (text := OPERATIONS[operation].nl):
            node = _applied(text, [values[i] for i in read])
            shared.append(node)
        else:
            raise ProblemError(
                f"{name} cannot be written as .nl: it has CasADi's {operation_name(operation)}, "
                "which the format does not have",
                problem=name,
                key=operation_name(operation),
            )
        values[written[0]] = node
    shared = [node for node in shared if node.uses > 1]
    defined = []
    for index, node in enumerate(shared, function.numel_in(0)):
        defined.append(list(node.lines()))
        node.symbol = f"v{index}"
    return defined, [[node.symbol] if node.symbol else list(node.lines()) for node in results]


def _applied(template: str, arguments: Sequence[_Node]) -> _Node:
    """The value of an operation on others, whose uses are counted."""
    places = dict(zip(("{x}", "{y}"), arguments, strict=False))
    node = _Node([places.get(word, word) for word in template.split()])
    for word in node.words:
        if isinstance(word, _Node):
            word.uses += 1
    return node
