"""Problems of .nl files, and of folders of them."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from pathlib import Path

from ..errors import ProblemError
from .problem import Problem


def read_problems(
    paths: Iterable[str | Path], refused: Callable[[ProblemError], object] | None = None
) -> list[Problem]:
    """Problems of .nl files and of all .nl files of folders; their family is the folder's name.

    Parameters
    ----------
    paths : iterable of paths
    refused : callable, optional
        Called with the error of a file in a folder that cannot be read, which is then left out. By
        default the error is raised, as it always is for a file that is named itself.

    Raises
    ------
    ProblemError
        A file that cannot be read, or a folder without any that can.
    """
    problems: list[Problem] = []
    for path in map(Path, paths):
        family = (path if path.is_dir() else path.parent).resolve().name or "nl"
        if not path.is_dir():
            problems.append(Problem.from_nl(path, family=family))
            continue
        before = len(problems)
        for file in sorted(path.glob("*.nl")):
            try:
                problems.append(Problem.from_nl(file, family=family))
            except ProblemError as error:
                if refused is None:
                    raise
                refused(error)
        if len(problems) == before:
            raise ProblemError(f"{path}: no file NAME.nl in this folder can be read", file=path)
    return problems
