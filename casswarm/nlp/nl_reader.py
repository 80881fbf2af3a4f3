"""Reading .nl files, as text: lines, header, and segments.

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
from ..errors import ProblemError
from ..typing import Expr
from .operations import OPERATORS, Operator
from .program import Instances, NamedRows, Nlp

MAX_BYTES = 2**27
"""Size up to which a file is read: some million operations."""


class Lines:
    """The lines of a file of text, of at most `MAX_BYTES`, one after the other without comments."""

    def __init__(self, path: Path) -> None:
        self.path, self.number = path, 0
        try:
            require_file(path, MAX_BYTES)
            content = path.read_bytes()
        except OSError as error:
            raise ProblemError(f"{path}: {error.strerror or error}", file=path) from error
        if content[:1] == b"b":
            raise self.refusal(
                "is in the binary format; write it as text (option g of AMPL and Pyomo)"
            )
        try:
            text = content.decode("ascii")
        except UnicodeDecodeError as error:
            raise self.refusal("is no .nl file: it has bytes that are not ASCII") from error
        self._lines = text.splitlines()

    def __len__(self) -> int:
        return len(self._lines)

    @property
    def ended(self) -> bool:
        """True if only blank lines are left."""
        while self.number < len(self._lines) and not self._lines[self.number].strip():
            self.number += 1
        return self.number == len(self._lines)

    def following(self) -> str:
        """The next line, without its comment; a ProblemError at the end of the file."""
        if self.number == len(self._lines):
            raise self.refusal("ends too early: is it truncated?")
        self.number += 1
        return self._lines[self.number - 1].partition("#")[0].strip()

    def numbers(self, *counts: int) -> list[float]:
        """Numbers of the next line, as many as one of `counts`."""
        line = self.following()
        return self.parsed(line, *counts)

    def parsed(self, text: str, *counts: int) -> list[float]:
        """Numbers in a part of this line, as many as one of `counts`; any number if none."""
        try:
            values = [float(word) for word in text.split()]
        except ValueError:
            values = []
        if not text or (counts and len(values) not in counts):
            expected = " or ".join(map(str, counts)) or "some"
            raise self.refusal(f"has {text!r} where {expected} numbers are expected")
        return values

    def integer(self, text: str, limit: int) -> int:
        """A whole number from 0 to `limit` - 1 in this line."""
        if not (text.isdigit() and len(text) < 12 and int(text) < limit):
            raise self.refusal(
                f"has {text!r} where a whole number from 0 to {limit - 1} is expected"
            )
        return int(text)

    def refusal(self, reason: str) -> ProblemError:
        """Error that names the file, the line and the reason."""
        where = f", line {self.number}" if self.number else ""
        message = f"{self.path}{where}: the file {reason}"
        return ProblemError(message, file=self.path, line=self.number or None)


_LINES, _COUNTS = 10, 6  # of a header, and how many of the numbers in a line are read


@dataclass(frozen=True)
class Header:
    """Sizes of a problem with continuous variables and at most one objective."""

    variables: int
    constraints: int
    objectives: int
    jacobian: int  # entries of the Jacobian of g
    gradient: int  # entries of the gradient of f


def read_header(lines: Lines) -> Header:
    """Read the header, and refuse what is not supported by a ProblemError that names it."""
    if not lines.following().startswith("g"):
        raise lines.refusal("is no .nl file: its first line does not begin with g")
    rows = [_counts(lines) for _ in range(_LINES - 1)]
    variables, constraints, objectives = rows[0][:3]
    _refuse_unsupported(lines, rows)
    if max(variables, constraints) > len(lines):
        raise lines.refusal(
            f"has {len(lines)} lines, too few for {variables} variables and {constraints} "
            "constraints: is it truncated?"
        )
    return Header(variables, constraints, objectives, *rows[6][:2])


def _refuse_unsupported(lines: Lines, rows: list[list[int]]) -> None:
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


def _counts(lines: Lines) -> list[int]:
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

_SOS = ("sosno", "ref", "sos", "sosref")
"""Suffixes that declare special ordered sets, which are conditions; others are hints."""


def read_nl(path: Path, name: str) -> tuple[Nlp, Instances]:
    """Read a problem, and its initial guess, from a text file in .nl format.

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
        logical constraints, imported functions, piecewise-linear terms, or the binary format.
    """
    program, instance = _Reader(Lines(path)).program(name)
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

    def __init__(self, lines: Lines) -> None:
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
            "d": lambda line: self._skip(line[1:], 2),
            "k": lambda line: self._skip(line[1:], 1),
            "K": lambda line: self._skip(line[1:], 1),
        }
        while not lines.ended:
            line = lines.following()
            if line[:1] in _UNSUPPORTED_SEGMENTS:
                raise lines.refusal(f"{_UNSUPPORTED_SEGMENTS[line[0]]}, which is not supported")
            if line[:1] not in segments:
                raise lines.refusal(f"has {line[:20]!r} where a segment should begin")
            segments[line[0]](line)
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

    def _constraint(self, line: str) -> None:
        self.rows[self.lines.integer(line[1:], self.header.constraints)] = self._expression()

    def _objective(self, line: str) -> None:
        number, sense = self._integers(line[1:], self.header.objectives, 2)
        self.maximise = sense == 1
        self.objectives[number] = self._expression()

    def _defined_variable(self, line: str) -> None:
        first, lines = self.header.variables, len(self.lines)
        index, terms, _ = self._integers(line[1:], first + lines, lines, 10**9)
        if index in self.values:
            raise self.lines.refusal(f"defines v{index} twice")
        linear = self._terms(terms)
        self.values[index] = self._expression() + linear

    def _linear_terms(self, line: str) -> None:
        key = line[0]
        rows = self.header.constraints if key == "J" else self.header.objectives
        row, count = self._integers(line[1:], rows, len(self.lines))
        self.linear[key, row] = self._terms(count)
        self.entries[key] += count

    def _guess(self, line: str) -> None:
        for _ in range(self.lines.integer(line[1:], len(self.lines))):
            index, value = self._pair()
            self.x0[index] = value

    def _bounds(self, bounds: list[tuple[float, float]], count: int) -> None:
        for _ in range(count):
            kind, *values = self.lines.numbers(1, 2, 3, 4)
            if kind == 5:
                raise self.lines.refusal("has a complementarity condition, which is not supported")
            if kind not in range(5) or len(values) != (2, 1, 1, 0, 1)[int(kind)]:
                raise self.lines.refusal("has bounds of a kind that the format does not know")
            low = values[0] if kind in (0, 2, 4) else -np.inf
            high = values[-1] if kind in (0, 1, 4) else np.inf
            bounds.append((low, high))

    def _suffix(self, line: str) -> None:
        words = line[1:].split()
        if len(words) != 3:
            raise self.lines.refusal(f"has {line!r} where a suffix with its name is expected")
        if words[2] in _SOS:
            raise self.lines.refusal(f"has special ordered sets (suffix {words[2]}); not supported")
        self._skip(words[1], 2)

    def _skip(self, count: str, numbers: int) -> None:
        for _ in range(self.lines.integer(count, len(self.lines))):
            self.lines.numbers(numbers)

    # --- parts of segments

    def _integers(self, text: str, *limits: int) -> list[int]:
        words = text.split()
        if len(words) != len(limits):
            raise self.lines.refusal(f"has {text!r} where {len(limits)} whole numbers are expected")
        return [self.lines.integer(word, limit) for word, limit in zip(words, limits, strict=True)]

    def _pair(self) -> tuple[int, float]:
        """The index of a variable and a number."""
        index, _, number = self.lines.following().partition(" ")
        return self.lines.integer(index, self.header.variables), self.lines.parsed(number, 1)[0]

    def _terms(self, count: int) -> Expr:
        pairs = [self._pair() for _ in range(count)]
        return sum((number * self.values[index] for index, number in pairs if number), ca.SX(0))

    def _expression(self) -> Expr:
        """An expression in prefix notation, without recursion: files can be deep."""
        unfinished: list[tuple[Operator, list[Expr]]] = []
        while True:
            word = self.lines.following()
            if word[:1] == "o":
                unfinished.append((self._operator(word), []))
                continue
            value = self._leaf(word)
            while unfinished:
                operator, arguments = unfinished[-1]
                arguments.append(value)
                if len(arguments) != operator.arguments:
                    break
                value = operator.function(*arguments)
                unfinished.pop()
            else:
                return value

    def _leaf(self, word: str) -> Expr:
        """A number or a variable."""
        if word[:1] == "v":
            index = self.lines.integer(word[1:], 10**9)
            if index not in self.values:
                raise self.lines.refusal(
                    f"uses {word}, which is neither a variable nor defined before"
                )
            return self.values[index]
        if word[:1] in ("n", "s", "l"):
            return ca.SX(self.lines.parsed(word[1:], 1)[0])
        if word[:1] == "f":
            raise self.lines.refusal("calls an imported function, which is not supported")
        raise self.lines.refusal(f"has {word[:20]!r} where an expression is expected")

    def _operator(self, word: str) -> Operator:
        """The operator of a word, with the number of its arguments."""
        number = self.lines.integer(word[1:], 1000)
        if number in OPERATORS:
            function, count = OPERATORS[number]
            if count is None:
                count = self.lines.integer(self.lines.following(), len(self.lines))
            if count:
                return Operator(function, count)
        what = _UNSUPPORTED.get(number, "which the format does not know")
        raise self.lines.refusal(f"has the operator o{number} ({what}), which is not supported")
