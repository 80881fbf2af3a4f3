"""Suggestions in error messages."""

from __future__ import annotations

from collections.abc import Iterable
from difflib import get_close_matches


def closest(word: str, known: Iterable[str]) -> str | None:
    """The known word that an unknown one most resembles, or None."""
    return next(iter(get_close_matches(word, list(known), 1)), None)


def did_you_mean(word: str, known: Iterable[str]) -> str:
    """End of a message about an unknown word: the closest known word, and all known words."""
    words = list(known)
    close = closest(word, words)
    hint = f"; did you mean {close!r}?" if close else ""
    return f"{hint} (known: {', '.join(words)})"
