"""Files of figures, drawn in this process and another one at the same time."""

from __future__ import annotations

import os
import pickle
from collections import deque
from collections.abc import Callable, Iterator
from functools import partial
from queue import SimpleQueue
from typing import TYPE_CHECKING, NamedTuple

from .._util.child import Channel, Child, packed
from .._util.user_code import USER_ERRORS
from ..typing import Progress, ThemeName

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from .catalogue import FigureCatalogue

_READY, _FAILED = b"ready", b"failed"


class FigureFormat(NamedTuple):
    """File format of figures: suffix, width in the theme's words, dots per inch."""

    suffix: str = "png"
    width: ThemeName = "page"
    dpi: int = 200

    def file_content(self, draw: Callable[[], Figure]) -> bytes:
        """Content of the file of a figure, drawn in the theme of this width."""
        from ..figures import theme
        from ..figures.image_files import file_content

        with theme(self.width):
            return file_content(draw(), self.suffix, self.dpi)


class FigureProcess:
    """Another process that draws figures, in the order in which it is given them.

    Its imports take as long as several figures, so it is started while there is other work. It ends
    with this process, however that ends.
    """

    def __init__(self) -> None:
        self._child = Child(_draw_requested)
        self._answers: SimpleQueue[bytes] = SimpleQueue()
        self._child.listen(self._answers.put)
        self._ready = self._lost = False
        self._names: deque[str] = deque()  # of figures that it has not drawn yet
        self._files: dict[str, bytes] = {}

    @classmethod
    def if_useful(cls) -> FigureProcess | None:
        """A process, if there is a core for it."""
        affinity = getattr(os, "sched_getaffinity", None)  # not on macOS and Windows
        cores = len(affinity(0)) if affinity else os.cpu_count() or 1
        return cls() if cores > 1 else None

    @property
    def waiting(self) -> int:
        """Number of figures that it has not drawn yet."""
        while not self._answers.empty():
            self._note(self._answers.get())
        return len(self._names)

    @property
    def is_free(self) -> bool:
        """True if it can begin another figure; never again after one that it could not draw."""
        return self.waiting < 2 and self._ready and not self._lost

    def begin(self, name: str, draw: Callable[[], Figure], figure_format: FigureFormat) -> None:
        """Begin a figure."""
        self._names.append(name)
        try:
            self._child.send(packed(partial(figure_format.file_content, draw)))
        except USER_ERRORS:  # any that a user's class raises
            self._lost = True

    def file_content(self, name: str) -> bytes | None:
        """Content of the file of a figure, as soon as it is drawn; None if it cannot be."""
        while not self._lost and name in self._names:
            self._note(self._answers.get())
        return self._files.get(name)

    def close(self) -> None:
        """End the process, whatever it does."""
        self._child.end()

    def _note(self, answer: bytes) -> None:
        if answer == _READY:
            self._ready = True
        elif answer in (_FAILED, b""):
            self._lost = True
        else:
            self._files[self._names.popleft()] = answer


def drawn_files(
    catalogue: FigureCatalogue,
    figure_format: FigureFormat,
    helper: FigureProcess | None = None,
    progress: Progress | None = None,
) -> Iterator[tuple[str, bytes]]:
    """Yield the name of every figure, in the catalogue's order, and the content of its file.

    The helper draws from the last one backwards. What it cannot draw is drawn here, so errors are
    those without it. `progress` is told how many are drawn.
    """
    report = progress or (lambda *_: None)
    left, theirs, number = deque(catalogue), deque[str](), len(catalogue)
    while left:
        waiting = helper.waiting if helper else 0
        report("drawing figures", number - len(left) - waiting, number)
        if helper is not None and len(left) > 1 and helper.is_free:
            theirs.appendleft(left.pop())
            helper.begin(theirs[0], catalogue[theirs[0]], figure_format)
        else:
            name = left.popleft()
            yield name, figure_format.file_content(catalogue[name])
    for name in theirs:
        assert helper is not None
        report("drawing figures", number - helper.waiting, number)
        yield name, helper.file_content(name) or figure_format.file_content(catalogue[name])
    report("drawing figures", number, number)


def _draw_requested(channel: Channel) -> None:
    """Draw figures, in the other process, until a failure."""
    from . import catalogue  # noqa: F401  (what takes long before the first figure)

    channel.send(_READY)
    for request in channel.requests():
        try:
            channel.send(pickle.loads(request)())
        except USER_ERRORS:
            channel.send(_FAILED)
            return
