"""Tokens of .nl files: the same fields as words in lines of text, or as binary numbers.

See D. M. Gay, Writing .nl files, Sandia National Laboratories, 2005. After a header of text, the
fields of a binary file have 1 byte (keys), 2 (short constants), 4 (integers) or 8 (doubles).
"""

from __future__ import annotations

import struct
from pathlib import Path
from typing import Any

from typing_extensions import override

from .._util.files import require_file
from .._util.text import quoted
from ..errors import ProblemError

MAX_BYTES = 2**27
"""Size up to which a file is read: some million operations."""

HEADER_LINES = 10


def open_nl(path: Path) -> Text:
    """Tokens of a file of at most `MAX_BYTES`; a ProblemError if it cannot be read."""
    try:
        require_file(path, MAX_BYTES)
        content = path.read_bytes()
    except OSError as error:
        raise ProblemError(f"{path}: {error.strerror or error}", file=path) from error
    return Binary(path, content) if content[:1] == b"b" else Text(path, content)


class Text:
    """Fields of a text file, one record a line, without comments."""

    unit = "lines"

    def __init__(self, path: Path, content: bytes) -> None:
        self.path, self.number, self._line = path, 0, ""
        self._rest: str | None = None  # of a record whose key was read
        try:
            self._lines = content.decode("ascii").splitlines()
        except UnicodeDecodeError as error:
            raise self.refusal("is no .nl file: it has bytes that are not ASCII") from error

    def __len__(self) -> int:
        return len(self._lines)

    def begin(self, arithmetic: int) -> None:
        """Begin the segments; `arithmetic` is the kind of numbers that the header announces."""

    @property
    def ended(self) -> bool:
        """True if only blank lines are left."""
        while self.number < len(self._lines) and not self._lines[self.number].strip():
            self.number += 1
        return self.number == len(self._lines)

    @property
    def shown(self) -> str:
        """The beginning of the record, for messages."""
        return self._line[:20]

    def following(self) -> str:
        """The next line, without its comment; a ProblemError at the end of the file."""
        if self.number == len(self._lines):
            raise self.refusal("ends too early: is it truncated?")
        self.number += 1
        return self._lines[self.number - 1].partition("#")[0].strip()

    def key(self) -> str:
        """The first character of the next record; its other fields are read next."""
        self._line = self.following()
        self._rest = self._line[1:]
        return self._line[:1]

    def integers(self, *limits: int) -> list[int]:
        """Whole numbers from 0 to each of `limits` - 1, all other fields of a record."""
        text = self._fields()
        words = text.split()
        if len(words) != len(limits):
            raise self.refusal(f"has {quoted(text)} where {len(limits)} whole numbers are expected")
        return [self.integer(word, limit) for word, limit in zip(words, limits, strict=True)]

    def numbers(self, count: int) -> list[float]:
        """Numbers, all other fields of a record."""
        return self._parsed(self._fields(), count)

    def pair(self, limit: int) -> tuple[int, float]:
        """A whole number from 0 to `limit` - 1 and a number, a record."""
        index, _, number = self._fields().partition(" ")
        return self.integer(index, limit), self._parsed(number, 1)[0]

    def constant(self, kind: str) -> float:  # noqa: ARG002  (text has a single form)
        """A constant of the kind n (double), s (short) or l (long)."""
        return self.numbers(1)[0]

    def suffix(self) -> tuple[int, int, str]:
        """Kind, number of values and name of a suffix."""
        words = self._fields().split()
        if len(words) != 3:
            raise self.refusal(f"has {quoted(self._line)} where a suffix with its name is expected")
        return self.integer(words[0], 256), self.integer(words[1], len(self)), words[2]

    def skip(self, kinds: str) -> None:
        """Skip a record of integers (i) and doubles (d)."""
        self.numbers(len(kinds))

    def integer(self, text: str, limit: int) -> int:
        """A whole number from 0 to `limit` - 1 in this text."""
        if not (text.isdigit() and len(text) < 12 and int(text) < limit):
            raise self.refusal(
                f"has {quoted(text)} where a whole number from 0 to {limit - 1} is expected"
            )
        return int(text)

    def refusal(self, reason: str) -> ProblemError:
        """Error that names the file, the line and the reason."""
        where = f", line {self.number}" if self.number else ""
        message = f"{self.path}{where}: the file {reason}"
        return ProblemError(message, file=self.path, line=self.number or None)

    def _fields(self) -> str:
        """What follows the key of a record, or else a line."""
        text, self._rest = self._rest, None
        return self.following() if text is None else text

    def _parsed(self, text: str, count: int) -> list[float]:
        try:
            values = [float(word) for word in text.split()]
        except ValueError:
            values = []
        if len(values) != count:
            raise self.refusal(f"has {quoted(text)} where {count} numbers are expected")
        return values


_ORDERS = {0: "<", 1: "<", 2: ">"}
"""Order of bytes by the header's kind of arithmetic: IEEE, little or big end first."""

_CONSTANTS = {"n": "d", "s": "h", "l": "i"}


class Binary(Text):
    """Fields of a binary file, after the lines of its header."""

    unit = "bytes"

    def __init__(self, path: Path, content: bytes) -> None:
        lines = content.split(b"\n", HEADER_LINES)
        self._content, self._place = content, 0
        super().__init__(path, b"\n".join(lines[:HEADER_LINES]))
        self._start = len(content) - len(lines[-1]) if len(lines) > HEADER_LINES else len(content)

    @override
    def __len__(self) -> int:
        return len(self._content)

    @override
    def begin(self, arithmetic: int) -> None:
        if arithmetic not in _ORDERS:
            raise self.refusal(f"has numbers of the kind {arithmetic}; only IEEE is supported")
        self._order, self._place = _ORDERS[arithmetic], self._start

    @property
    @override
    def ended(self) -> bool:
        return self._place == len(self._content)

    @property
    @override
    def shown(self) -> str:
        return self._line

    @override
    def key(self) -> str:
        self._line = self._string(1)
        return self._line

    @override
    def integers(self, *limits: int) -> list[int]:
        values = self._unpacked("i" * len(limits))
        return [self.integer(str(int(v)), limit) for v, limit in zip(values, limits, strict=True)]

    @override
    def numbers(self, count: int) -> list[float]:
        return list(self._unpacked("d" * count))

    @override
    def pair(self, limit: int) -> tuple[int, float]:
        return self.integers(limit)[0], self.numbers(1)[0]

    @override
    def constant(self, kind: str) -> float:
        return float(self._unpacked(_CONSTANTS[kind])[0])

    @override
    def suffix(self) -> tuple[int, int, str]:
        kind, count, length = self.integers(256, len(self), len(self))
        return kind, count, self._string(length)

    @override
    def skip(self, kinds: str) -> None:
        self._unpacked(kinds)

    @override
    def refusal(self, reason: str) -> ProblemError:
        if not self._place:
            return super().refusal(reason)
        message = f"{self.path}, byte {self._place}: the file {reason}"
        return ProblemError(message, file=self.path)

    def _string(self, length: int) -> str:
        text: bytes = self._unpacked(f"{length}s")[0]
        return text.decode("latin-1")

    def _unpacked(self, kinds: str) -> tuple[Any, ...]:
        """The next numbers of these kinds of `struct`."""
        layout = self._order + kinds
        end = self._place + struct.calcsize(layout)
        if end > len(self._content):
            raise self.refusal("ends too early: is it truncated?")
        values = struct.unpack_from(layout, self._content, self._place)
        self._place = end
        return values
