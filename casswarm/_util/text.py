"""Texts of messages: suggestions, and characters that a terminal would obey."""

from __future__ import annotations

from collections.abc import Iterable
from difflib import get_close_matches
from typing import Any


def closest(word: str, known: Iterable[str]) -> str | None:
    """The known word that an unknown one most resembles, or None."""
    return next(iter(get_close_matches(word, list(known), 1)), None)


def suggestion(word: str, known: Iterable[str]) -> str:
    """End of a message about an unknown word: the closest known word, if any."""
    close = closest(word, known)
    return f"; did you mean {close!r}?" if close else ""


def did_you_mean(word: str, known: Iterable[str]) -> str:
    """End of a message about an unknown word: the closest known word, and all known words."""
    words = list(known)
    return f"{suggestion(word, words)} (known: {', '.join(words)})"


def counted(count: float, noun: str, plural: str = "") -> str:
    """Number and noun, in the plural unless the number is one; four digits of a fraction."""
    number = f"{count:.4g}" if isinstance(count, float) else f"{count}"
    return f"{number} {noun if count == 1 else plural or f'{noun}s'}"


def shown(value: Any) -> str:
    """`repr` of a value that a user gave; a NumPy scalar or 0-d array as the number it holds."""
    scalar = getattr(value, "shape", None) == () and hasattr(value, "item")
    return repr(value.item() if scalar else value)


def printable(text: str) -> str:
    """Text in which control and bidirectional characters are written as escapes, but line breaks.

    Messages name files and values of somebody else, which could otherwise move the cursor, hide
    what was printed, or turn around the order of what is read.
    """
    return "".join(c if c.isprintable() or c == "\n" else repr(c)[1:-1] for c in text)


def shortened(text: str, length: int = 60) -> str:
    """Text of somebody else, cut to a length at which a message remains readable."""
    return text if len(text) <= length else f"{text[: length - 3]}..."


def quoted(value: object, length: int = 60) -> str:
    """Representation of a value of somebody else, cut to a length."""
    return shortened(repr(value), length)
