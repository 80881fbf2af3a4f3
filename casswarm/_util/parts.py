"""Parts of a study that are computed by themselves, on one machine or on many.

A part saves its share of the study's jobs in a folder of its own; the study is resumed where the
records of all parts are joined (`casswarm._util.checkpoint.joined`).
"""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

MAX_PARTS = 100_000
"""Largest number of parts of a study."""


class Part(NamedTuple):
    """Part `number` of `parts` of a study, by default all of it."""

    number: int = 1
    parts: int = 1

    def __str__(self) -> str:
        return f"part {self.number} of {self.parts}"

    def owns(self, index: int) -> bool:
        """Return True for every job of the part: they are dealt out in turn."""
        return index % self.parts == self.number - 1

    def window(self, total: int) -> tuple[int, int]:
        """First of the part's consecutive items, of so many in all, and the last one plus one."""
        return total * (self.number - 1) // self.parts, total * self.number // self.parts


class PartFolder(NamedTuple):
    """A study's folder of which it computes and saves a part, and then raises `PartSaved`."""

    path: Path
    part: Part


class PartSaved(Exception):  # noqa: N818  (no error)
    """A part of a study is saved, so there is no result yet; its argument is the part."""


def part_of(folder: str | Path | PartFolder | None) -> Part:
    """The part of a study that is computed with this folder."""
    return folder.part if isinstance(folder, PartFolder) else Part()
