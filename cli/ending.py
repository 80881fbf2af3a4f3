"""The end of a command: what is computed after its work, its figures, and its printed result."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, TypeVar

from .common import Failure
from .options import OutputOptions
from .output import print_result

if TYPE_CHECKING:
    from ..results.catalogue import FigureCatalogue
    from ..results.folder import ResultsFolder
    from .output import ProgressReport

T = TypeVar("T")


class Ending:
    """The end of a command whose tables are written: what fails from here on costs no results.

    Parameters
    ----------
    folder : ResultsFolder
    output : OutputOptions
    progress : ProgressReport, optional
    """

    def __init__(
        self, folder: ResultsFolder, output: OutputOptions, progress: ProgressReport | None
    ) -> None:
        self._folder, self._output, self._progress = folder, output, progress
        self._failures: list[str] = []
        self._interrupted, self._undrawn = False, True

    def attempt(self, what: str, compute: Callable[[], T]) -> T | None:
        """Result of a computation; None if it fails, and after Ctrl-C, which `finish` reports."""
        if self._interrupted:
            return None
        if self._progress is not None:
            self._progress.watch(what)
        try:
            return compute()
        except KeyboardInterrupt:
            self._interrupted = True
            self._failures.append(f"interrupted during {what}")
        except Exception as error:
            reason = " ".join(str(error).split())
            kind = type(error).__name__
            self._failures.append(f"{what} failed ({f'{kind}: {reason}' if reason else kind})")
        return None

    def draw(self, catalogue: Callable[[], FigureCatalogue] | None = None) -> None:
        """Draw the figures, after the record is written, and add their files to it.

        Does nothing with --no-figures.
        """
        if getattr(self._output, "no_figures", False):
            return
        drawn = self.attempt("drawing", lambda: self._draw(catalogue))
        self._undrawn = drawn is None
        self._folder.extend_record()

    def _draw(self, catalogue: Callable[[], FigureCatalogue] | None) -> bool:
        self._folder.write_figures(None if catalogue is None else catalogue(), self._progress)
        return True

    def finish(self, text: str) -> None:
        """Print the result, and raise a Failure if something failed after the work."""
        print_result(self._folder, self._folder.record, text, self._output)
        if self._failures:
            advice = f"; casswarm plot {self._folder.path} draws the figures"
            raise Failure(
                f"{'; '.join(self._failures)}: the tables and run.json in {self._folder.path} are "
                f"complete{advice if self._undrawn else ''}"
            )
