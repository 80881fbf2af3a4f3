"""Reading .nl files: header and segments, as text or binary.

CasADi has a reader too (`casadi.NlpBuilder.import_nl`), but it does not notice that a file is
truncated: it waits for ever, or leaves out bounds and linear terms.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import casadi as ca
import numpy as np

from .._util.files import require_file
from .._util.text import counted, printable
from ..typing import Expr
from .nl_tokens import HEADER_LINES, MAX_BYTES, Text, open_nl
from .operations import OPERATORS, Operator
from .program import Instances, NamedRows, Nlp

_COUNTS = 6  # numbers that are read in a line of a header


@dataclass(frozen=True)
class Header:
    """Sizes of a problem with continuous variables and at most one objective."""

    variables: int
    constraints: int
    objectives: int
    jacobian: int  # entries of the Jacobian of g
    gradient: int  # entries of the gradient of f


def read_header(lines: Text) -> Header:
    """Read the header, and refuse what is not supported by a ProblemError that names it."""
    if not lines.following().startswith(("g", "b")):
        raise lines.refusal("is no .nl file: its first line does not begin with g or b")
    rows = [_counts(lines) for _ in range(HEADER_LINES - 1)]
    lines.begin(arithmetic=rows[4][2])
    variables, constraints, objectives = rows[0][:3]
    _refuse_unsupported(lines, rows)
    if max(variables, constraints) > len(lines):
        raise lines.refusal(
            f"has {len(lines)} {lines.unit}, too few for {variables} variables and {constraints} "
            "constraints: is it truncated?"
        )
    return Header(variables, constraints, objectives, *rows[6][:2])


def _refuse_unsupported(lines: Text, rows: list[list[int]]) -> None:
    """Raise for parts of the format that cannot be read; `rows` are the lines after the first."""
    objectives, logical, conditions = rows[0][2], rows[0][5], sum(rows[1][2:4])
    discrete, functions = counted(sum(rows[5]), "integer variable"), counted(rows[4][1], "function")
    refusals = (
        (sum(rows[5]), f"has {discrete}; only continuous ones are supported"),
        (objectives > 1, f"has {objectives} objectives; only one is supported"),
        (logical, f"has {logical} logical constraints, which are not supported"),
        (conditions, f"has {conditions} complementarity conditions, which are not supported"),
        (rows[4][1], f"imports {functions} of a library, which is not supported"),
    )
    for refused, reason in refusals:
        if refused:
            raise lines.refusal(reason)


def _counts(lines: Text) -> list[int]:
    """Numbers of the next line; those that are missing are zero."""
    numbers = [lines.integer(word, 10**9) for word in lines.following().split()]
    return numbers + [0] * _COUNTS


_UNSUPPORTED = {
    56: "rounding (precision)",
    57: "rounding (round)",
    58: "rounding (trunc)",
    64: "a piecewise-linear term",
    65: "a conditional string",
    79: "a call of an imported function",
    **dict.fromkeys((59, 60, 61, 62, 63, 66, 67, 68, 69, 72, 73, 74, 75), "a logical constraint"),
}
"""Operators that no smooth problem has, or that CasADi has no counterpart of."""

_UNSUPPORTED_SEGMENTS = {"F": "imports a function of a library", "L": "has a logical constraint"}

_BOUNDS = {"0": 2, "1": 1, "2": 1, "3": 0, "4": 1}
"""Count of numbers of every kind of bounds."""

_REAL = 4  # bit of a suffix's kind: its values are real numbers

_SOS = ("sosno", "ref", "sos", "sosref")
"""Suffixes that declare special ordered sets, which are conditions; others are hints."""


def read_nl(path: Path, name: str) -> tuple[Nlp, Instances]:
    """Read a problem, and its initial guess, from a file in .nl format, text or binary.

    A maximum becomes the minimum of the negative objective, and without an objective it is zero.
    Names of constraints and variables are those of the files .row and .col beside it, where they
    fit, or c0, c1, ... and x0, x1, ...

    Parameters
    ----------
    path : Path
    name : str
        Name of the program.

    Raises
    ------
    ProblemError
        The file cannot be read, is damaged or truncated, or uses a part of the format that is not
        supported: integer variables, several objectives, complementarity, special ordered sets,
        logical constraints, imported functions, or piecewise-linear terms.
    """
    program, instance = _Reader(open_nl(path)).program(name)
    variables, _, rows = program.sizes
    named = (
        _names(path.with_suffix(".row"), rows, "c"),
        _names(path.with_suffix(".col"), variables, "x"),
    )
    return program.with_attachments(NamedRows(named[0], (1,) * rows, named[1])), instance


def _names(path: Path, count: int, letter: str) -> tuple[str, ...]:
    """Names in a file, of which it may have more than needed; numbered ones without such a file."""
    try:
        require_file(path, MAX_BYTES)
        names = path.read_text("utf-8").split()
    except (OSError, UnicodeDecodeError):
        names = []
    if len(names) < count:
        return tuple(f"{letter}{i}" for i in range(count))
    return tuple(map(printable, names[:count]))


class _Reader:
    """The segments of a file, read into the parts of a problem."""

    def __init__(self, lines: Text) -> None:
        self.lines, self.header = lines, read_header(lines)
        variables, constraints = self.header.variables, self.header.constraints
        self.x = ca.SX.sym("x", variables)
        self.values = dict(enumerate(ca.vertsplit(self.x)))  # of variables, and defined ones
        self.objectives: dict[int, Expr] = {}
        self.maximise = False
        self.rows: dict[int, Expr] = {}
        self.entries = {"J": 0, "G": 0}
        self.x0 = np.zeros(variables)
        self.x_bounds: list[tuple[float, float]] = []
        self.g_bounds: list[tuple[float, float]] = []
        self.linear: dict[tuple[str, int], Expr] = {}
        segments: dict[str, Callable[[str], None]] = {
            "J": self._linear_terms,
            "G": self._linear_terms,
            "C": self._constraint,
            "O": self._objective,
            "V": self._defined_variable,
            "S": self._suffix,
            "x": self._guess,
            "r": lambda _: self._bounds(self.g_bounds, constraints),
            "b": lambda _: self._bounds(self.x_bounds, variables),
            "d": lambda _: self._skip("id"),
            "k": lambda _: self._skip("i"),
            "K": lambda _: self._skip("i"),
        }
        while not lines.ended:
            key = lines.key()
            if key in _UNSUPPORTED_SEGMENTS:
                raise lines.refusal(f"{_UNSUPPORTED_SEGMENTS[key]}, which is not supported")
            if key not in segments:
                raise lines.refusal(f"has {lines.shown!r} where a segment should begin")
            segments[key](key)
        self._require_complete()

    def program(self, name: str) -> tuple[Nlp, Instances]:
        """The problem and its instance."""
        rows = [self.rows[i] + self.linear.get(("J", i), 0) for i in range(self.header.constraints)]
        objective = self.objectives.get(0, ca.SX(0)) + self.linear.get(("G", 0), 0)
        objective = -objective if self.maximise else objective
        nlp = Nlp.from_expressions(name, self.x, ca.SX(0, 1), objective, ca.vertcat(*rows))
        lbx, ubx = np.array(self.x_bounds).reshape(-1, 2).T
        lbg, ubg = np.array(self.g_bounds).reshape(-1, 2).T
        bounds = lbx[None], ubx[None], lbg[None], ubg[None]
        return nlp, Instances(self.x0[None], np.empty((1, 0)), *bounds)

    def _require_complete(self) -> None:
        header = self.header
        counts = {
            "constraints": (header.constraints, len(self.rows)),
            "objectives": (header.objectives, len(self.objectives)),
            "bounds of variables": (header.variables, len(self.x_bounds)),
            "bounds of constraints": (header.constraints, len(self.g_bounds)),
            "entries of the Jacobian": (header.jacobian, self.entries["J"]),
            "entries of the gradient": (header.gradient, self.entries["G"]),
        }
        for what, (announced, found) in counts.items():
            if announced != found:
                reason = f"announces {announced} {what} and has {found}: is it truncated?"
                raise self.lines.refusal(reason)

    # --- segments

    def _constraint(self, _: str) -> None:
        (row,) = self.lines.integers(self.header.constraints)
        self.rows[row] = self._expression()

    def _objective(self, _: str) -> None:
        number, sense = self.lines.integers(self.header.objectives, 2)
        self.maximise = sense == 1
        self.objectives[number] = self._expression()

    def _defined_variable(self, _: str) -> None:
        first, size = self.header.variables, len(self.lines)
        index, terms, _place = self.lines.integers(first + size, size, 10**9)
        if index in self.values:
            raise self.lines.refusal(f"defines v{index} twice")
        linear = self._terms(terms)
        self.values[index] = self._expression() + linear

    def _linear_terms(self, key: str) -> None:
        rows = self.header.constraints if key == "J" else self.header.objectives
        row, count = self.lines.integers(rows, len(self.lines))
        self.linear[key, row] = self._terms(count)
        self.entries[key] += count

    def _guess(self, _: str) -> None:
        (count,) = self.lines.integers(len(self.lines))
        for _place in range(count):
            index, value = self.lines.pair(self.header.variables)
            self.x0[index] = value

    def _bounds(self, bounds: list[tuple[float, float]], count: int) -> None:
        for _ in range(count):
            kind = self.lines.key()
            if kind == "5":
                raise self.lines.refusal("has a complementarity condition, which is not supported")
            if kind not in _BOUNDS:
                raise self.lines.refusal("has bounds of a kind that the format does not know")
            values = self.lines.numbers(_BOUNDS[kind])
            low = values[0] if kind in "024" else -np.inf
            high = values[-1] if kind in "014" else np.inf
            bounds.append((low, high))

    def _suffix(self, _: str) -> None:
        kind, count, name = self.lines.suffix()
        if name in _SOS:
            raise self.lines.refusal(f"has special ordered sets (suffix {name}); not supported")
        for _place in range(count):
            self.lines.skip("id" if kind & _REAL else "ii")

    def _skip(self, kinds: str) -> None:
        (count,) = self.lines.integers(len(self.lines))
        for _ in range(count):
            self.lines.skip(kinds)

    # --- parts of segments

    def _terms(self, count: int) -> Expr:
        pairs = [self.lines.pair(self.header.variables) for _ in range(count)]
        return sum((number * self.values[index] for index, number in pairs if number), ca.SX(0))

    def _expression(self) -> Expr:
        """An expression in prefix notation, without recursion: files can be deep."""
        unfinished: list[tuple[Operator, list[Expr]]] = []
        while True:
            key = self.lines.key()
            if key == "o":
                unfinished.append((self._operator(), []))
                continue
            value = self._leaf(key)
            while unfinished:
                operator, arguments = unfinished[-1]
                arguments.append(value)
                if len(arguments) != operator.arguments:
                    break
                value = operator.function(*arguments)
                unfinished.pop()
            else:
                return value

    def _leaf(self, key: str) -> Expr:
        """A number or a variable."""
        if key == "v":
            (index,) = self.lines.integers(10**9)
            if index not in self.values:
                raise self.lines.refusal(
                    f"uses v{index}, which is neither a variable nor defined before"
                )
            return self.values[index]
        if key and key in "nsl":
            return ca.SX(self.lines.constant(key))
        if key == "f":
            raise self.lines.refusal("calls an imported function, which is not supported")
        raise self.lines.refusal(f"has {self.lines.shown!r} where an expression is expected")

    def _operator(self) -> Operator:
        """The next operator, with the number of its arguments."""
        (number,) = self.lines.integers(1000)
        if number in OPERATORS:
            function, count = OPERATORS[number]
            if count is None:
                (count,) = self.lines.integers(len(self.lines))
            if count:
                return Operator(function, count)
        what = _UNSUPPORTED.get(number, "which the format does not know")
        raise self.lines.refusal(f"has the operator o{number} ({what}), which is not supported")
