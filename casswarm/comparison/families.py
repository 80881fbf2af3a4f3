"""Families of benchmark problems by name, which other rooms register.

A family is registered by the name of its record and imported when it is first used, so that this
room knows none.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING

from .._util.numbers import require_seed
from .._util.registry import Registry
from .._util.text import did_you_mean
from ..errors import ComparisonError

if TYPE_CHECKING:
    from ..nlp.program import Instances, Nlp
    from ..typing import Progress
    from .problem import Problem


@dataclass(frozen=True)
class Family:
    """Family of problems: their generator, their description and their sampling units.

    Parameters
    ----------
    generate : callable
        A count and a seed to problems; the same seed gives the same problems.
    count : int
        Default count.
    description, note : str
        What the problems are, in reports, and a paragraph on how they are made.
    unit : callable, optional
        A problem's name to that of what is drawn when it is, for problems that are not independent.
    kind : callable, optional
        A unit to its kind, where a sample has a fixed number of every kind.
    warm_up : callable, optional
        Makes a small program and its instance, which every process of a solver solves first,
        untimed, where problems have a form that special solvers exploit.
    """

    generate: Callable[[int, int], Iterator[Problem]]
    count: int
    description: str = ""
    note: str = ""
    unit: Callable[[str], str] | None = None
    kind: Callable[[str], str] | None = None
    warm_up: Callable[[], tuple[Nlp, Instances]] | None = None


FAMILIES: Registry[Family] = Registry("family", lambda message, _: ComparisonError(message))
"""Every family by the name that `make_problems` and the command line take."""


def register_problems(name: str, target: str) -> None:
    """Add a family to `FAMILIES`.

    Parameters
    ----------
    name : str
    target : str
        ``"module:name"`` of a `Family`, which is imported when the family is first used.

    Raises
    ------
    ComparisonError
        Another family has this name.
    """
    FAMILIES.add(name, target)


def make_problems(
    family: str,
    count: int | None = None,
    seed: int = 0,
    progress: Progress | None = None,
) -> list[Problem]:
    """Problems of a family; the same seed gives the same problems.

    Parameters
    ----------
    family : str
        One of `FAMILIES`, such as guides, formations and quick.
    count : int, optional
        Problems of every kind; by default that of the family.
    seed : int
        From 0 to 2^64 - 1.
    progress : Progress, optional

    Raises
    ------
    ComparisonError
        An unknown family, or a count below one.
    ValueError
        A seed out of range.
    """
    if family not in FAMILIES:
        raise ComparisonError(
            f"family {family!r} is unknown{did_you_mean(family, FAMILIES)}", family=family
        )
    seed, record = require_seed(seed), FAMILIES[family]
    count = record.count if count is None else count
    require_count(count)
    made: list[Problem] = []
    for problem in record.generate(count, seed):
        if progress is not None:
            progress("making problems", len(made), None)
        made.append(problem)
    return made


def require_count(count: int) -> None:
    """Raise ComparisonError for a number of problems below one."""
    if count < 1:
        message = f"count = {count}; allowed: whole numbers from 1"
        raise ComparisonError(message, key="count", value=count)
