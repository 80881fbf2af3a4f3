"""Progress bars, in terminals and notebooks."""

from __future__ import annotations

import sys
import warnings
from functools import cache
from typing import TYPE_CHECKING, Any

from .text import shown

if TYPE_CHECKING:
    from ..typing import Progress


def reporter(progress: Progress | bool | None) -> Progress | None:
    """The function that reports progress: bars if `progress` is True, nothing if it is False.

    Raises
    ------
    TypeError
        It is neither a bool nor can it be called.
    """
    if progress is None or progress is False:
        return None
    if progress is True:
        return Bars()
    if not callable(progress):
        raise TypeError(
            f"progress = {shown(progress)}; allowed: True for progress bars, or a function of "
            "(task, done, total)"
        )
    return progress


class Bars:
    """Reports progress by tqdm: a bar for every task of known size, a line for any other.

    In notebooks the bars are widgets, where ipywidgets is installed.
    """

    def __init__(self) -> None:
        self._bars: dict[str, Any] = {}  # closed ones, too: a task may be reported again

    def __call__(self, task: str, done: float, total: float | None) -> None:
        """Report that `done` of `total` of a task is done; see `casswarm.Progress`."""
        bar_class = _bar_class()
        if total is None:
            if not done:
                bar_class.write(task, file=sys.stderr)
            return
        if task not in self._bars:
            self._bars[task] = bar_class(bar_format=_FORMAT)
        bar = self._bars[task]
        bar.total = total
        counts = f" {done:g} of {total:g}" if total > 1 else ""
        bar.set_description_str(f"{task}{counts}", refresh=False)
        bar.update(done - bar.n)
        if done >= total:
            bar.close()

    def close(self) -> None:
        """Leave the bars as they are."""
        for bar in self._bars.values():
            bar.close()


_FORMAT = "{desc}: {percentage:3.0f}%|{bar}| {elapsed}<{remaining}"


@cache
def _bar_class() -> Any:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # that a notebook has no ipywidgets: bars are text then
        from tqdm.auto import tqdm
    return tqdm
