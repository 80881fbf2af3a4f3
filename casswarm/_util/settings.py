"""Settings of accuracy and execution: keyword arguments that the main functions share."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from typing_extensions import TypedDict

from .text import shown

if TYPE_CHECKING:
    from ..typing import Progress
    from .checkpoint import IfExists
    from .child import Workers
    from .parts import PartFolder


@dataclass(frozen=True, kw_only=True)
class Accuracy:
    """Settings of how exact an answer is; for values that are not given, a function has its own.

    Each of them can also be given to a function as a plain keyword.

    Parameters
    ----------
    tolerance : float, optional
        Width of proven bounds: the probability mass of unlikely states that may be left out.
    max_states : int, optional
        Maximum number of distinct states to solve; if that is too few for `tolerance`, the bounds
        are wider.
    aggregation_tol : float, optional
        Spacing of the lattice of positions, in units of length: see `evaluate`.
    memory : float, optional
        Megabytes that states may take, at least 1; the least probable beyond it are left out, and
        the bounds are wider. By default 537.

    Examples
    --------
    >>> import casswarm as csw
    >>> rough = csw.Accuracy(tolerance=0.1, max_states=1000)
    >>> csw.evaluate(csw.load_scenario("paper-1"), "naive", accuracy=rough).tolerance
    0.1
    """

    tolerance: float | None = None
    max_states: int | None = None
    aggregation_tol: float | None = None
    memory: float | None = None


@dataclass(frozen=True, kw_only=True)
class Execution:
    """Settings of how an answer is computed: they change no number but by a time limit.

    Each of these can also be given to a function as a plain keyword.

    Parameters
    ----------
    workers : int or executor, optional
        Number of processes; 1 stays in this process. In a script, more than one needs the guard
        ``if __name__ == "__main__":``, since workers import the script again. Or an executor in
        the style of `concurrent.futures`, such as Dask's ``client.get_executor()``. If a process
        dies, its work is done again.
    progress : Progress or bool, optional
        True for progress bars, or a function: see `Progress`.
    checkpoint : path, optional
        Folder in which results are saved as they are computed.
    if_exists : {"error", "resume", "overwrite"}, optional
        If that folder holds unfinished work: refuse it, as is the default, continue it (the inputs
        must be equal; results are those of uninterrupted work), or start over.
    time_limit : float, optional
        Seconds.
    """

    workers: Workers | None = None
    progress: Progress | bool | None = None
    checkpoint: str | Path | PartFolder | None = None
    if_exists: IfExists | None = None
    time_limit: float | None = None


class SavedKeywords(TypedDict, total=False):
    """Plain keywords of functions with `Execution`; each takes those that its docstring lists."""

    progress: Progress | bool | None
    checkpoint: str | Path | PartFolder | None
    if_exists: IfExists
    time_limit: float | None


class EvaluationKeywords(SavedKeywords, total=False):
    """Plain keywords of functions that take `Accuracy` and have an argument `tolerance`."""

    max_states: int | None
    aggregation_tol: float | None
    memory: float | None


class Keywords(EvaluationKeywords, total=False):
    """Plain keywords of functions that have no arguments `tolerance` and `workers`."""

    tolerance: float
    workers: Workers


EXACT = {"tolerance": 1e-3, "max_states": None, "aggregation_tol": None}
ENUMERATED = EXACT | {"memory": None}
SAVED = {"progress": None, "checkpoint": None, "if_exists": "error"}
"""Defaults of functions of the chain, of those of its law, and of those that save results."""


def given_values(
    function: str, *groups: Accuracy | Execution | None, plain: Mapping[str, Any], **defaults: Any
) -> Any:
    """Values of the names in `defaults`, in their order, as given in a group or plainly.

    Raises
    ------
    TypeError
        A value that the function does not take, or one that is given twice.
    """
    grouped = {k: v for group in groups if group for k, v in vars(group).items() if v is not None}
    for name in grouped.keys() | plain.keys():
        if name not in defaults:
            raise TypeError(f"{function} takes no {shown(name)}; allowed: {', '.join(defaults)}")
    given = {k: v for k, v in plain.items() if v is not None or defaults[k] is not None}
    for name in grouped.keys() & given.keys():
        group = "accuracy" if hasattr(Accuracy, name) else "execution"
        raise TypeError(f"{function}: {name} is given twice, plainly and in {group}=")
    return (defaults | grouped | given).values()
