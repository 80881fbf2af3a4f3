"""Lines of a text file in .nl format, and the message for what is wrong with one of them."""

from __future__ import annotations

from pathlib import Path

from ..._util.files import require_file
from ...errors import ProblemError

MAX_BYTES = 2**27
"""Size up to which a file is read: some million operations."""


class Lines:
    """The lines of a file, one after the other, without comments.

    Parameters
    ----------
    path : Path

    Raises
    ------
    ProblemError
        The file cannot be read, is larger than `MAX_BYTES`, or is not text.
    """

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
        """Whether only blank lines are left."""
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
        return ProblemError(f"{self.path}{where}: the file {reason}", file=self.path)
