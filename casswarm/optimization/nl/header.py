"""Header of .nl files: the sizes of a problem, and which parts of the format it uses."""

from __future__ import annotations

from dataclasses import dataclass

from ..._util.text import counted
from .lines import Lines

_LINES = 10  # of a header


@dataclass(frozen=True)
class Header:
    """Sizes of a problem with continuous variables and at most one objective.

    Parameters
    ----------
    variables, constraints, objectives : int
    jacobian, gradient : int
        Numbers of entries of the Jacobian of g and of the gradient of f.
    """

    variables: int
    constraints: int
    objectives: int
    jacobian: int
    gradient: int


def read_header(lines: Lines) -> Header:
    """Read the header, and refuse what is not supported by a ProblemError that names it."""
    if not lines.following().startswith("g"):
        raise lines.refusal("is no .nl file: its first line does not begin with g")
    rows = [_counts(lines) for _ in range(_LINES - 1)]
    variables, constraints, objectives = _first(rows[0], 3)
    _refuse_unsupported(lines, rows)
    if max(variables, constraints) > len(lines):
        raise lines.refusal(
            f"has {len(lines)} lines, too few for {variables} variables and {constraints} "
            "constraints: is it truncated?"
        )
    return Header(variables, constraints, objectives, *_first(rows[6], 2))


def _refuse_unsupported(lines: Lines, rows: list[list[int]]) -> None:
    """Raise for parts of the format that cannot be read; `rows` are the lines after the first."""
    discrete = sum(rows[5])
    if discrete:
        integers = counted(discrete, "integer variable")
        raise lines.refusal(f"has {integers}; only continuous ones are supported")
    if _first(rows[0], 3)[2] > 1:
        raise lines.refusal(f"has {rows[0][2]} objectives; only one is supported")
    if any(rows[0][5:6]):
        raise lines.refusal(f"has {rows[0][5]} logical constraints, which are not supported")
    if any(rows[1][2:4]):
        raise lines.refusal(
            f"has {sum(rows[1][2:4])} complementarity conditions, which are not supported"
        )
    if any(rows[4][1:2]):
        functions = counted(rows[4][1], "function")
        raise lines.refusal(f"imports {functions} of a library, which is not supported")


def _counts(lines: Lines) -> list[int]:
    words = lines.following().split()
    return [lines.integer(word, 10**9) for word in words]


def _first(row: list[int], count: int) -> list[int]:
    """The first entries; those that are missing are zero."""
    return (row + [0] * count)[:count]
