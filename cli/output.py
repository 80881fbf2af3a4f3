"""What a command leaves: a folder with tables, figures, and how they were made."""

from __future__ import annotations

import json
import math
import os
import platform
import sys
import time
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import ExitStack, contextmanager, suppress
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from .. import __version__
from .common import Failure
from .options import FigureOptions, OutputOptions

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure

    from ..results.catalogue import FigureCatalogue
    from ..scenario import Scenario
    from ..typing import Progress

_LIBRARIES = ("casadi", "numpy", "scipy", "pandas", "matplotlib")


class Folder:
    """A results folder; every file is written beside its place and then moved into it.

    Where that fails, `remedy` ends the message.
    """

    def __init__(
        self,
        command: str,
        scenario: Scenario | None,
        out: Path | None,
        figures: str = "png",
        remedy: str = "",
        width: str = "page",
        dpi: int = 200,
    ) -> None:
        name = command if scenario is None else f"{command}-{scenario.name}"
        self.path = out or Path("results") / name
        self.command, self.scenario, self.ending = command, scenario, figures
        self.remedy, self.width, self.dpi = remedy, width, dpi
        self.files: list[str] = []
        self._started = time.perf_counter()
        self._require_writable()

    def _require_writable(self) -> None:
        """Fail before the work rather than after it."""
        there = next(p for p in (self.path, *self.path.absolute().parents) if p.exists())
        if not (there.is_dir() and os.access(there, os.W_OK | os.X_OK)):
            raise Failure(f"cannot write {self.path}: {there} is no folder that can be written to")

    def table(self, name: str, table: pd.DataFrame) -> None:
        """Write a table as NAME.csv."""
        self._write(f"{name}.csv", lambda path: table.to_csv(path, index=False))

    def figure(self, name: str, figure: Figure) -> None:
        """Write a figure as NAME.png, or of another format."""
        from ..figures import save

        self._write(f"{name}.{self.ending}", lambda path: save(figure, path, self.dpi))

    def draw(self, catalogue: FigureCatalogue) -> None:
        """Draw figures one by one, at the width that was asked for, and write them."""
        from ..figures import theme

        with theme(self.width):
            for name, drawn in catalogue.items():
                self.figure(name, drawn())

    def arrays(self, name: str, arrays: Mapping[str, Any]) -> None:
        """Write arrays as NAME.npz."""
        import numpy as np

        self._write(
            f"{name}.npz", lambda path: np.savez_compressed(path, allow_pickle=False, **arrays)
        )

    def file(self, name: str, write: Callable[[Path], object]) -> None:
        """Write a file of this name by a function of a path."""
        self._write(name, write)

    def text(self, name: str, text: str) -> None:
        """Write a text file."""
        self._write(name, lambda path: path.write_text(text, encoding="utf-8"))

    def record(self, result: dict[str, Any], inputs: dict[str, Any]) -> dict[str, Any]:
        """Write run.json: the result, and all that made it; return its content.

        Files of an earlier run of the command that this one did not write are removed.
        """
        for name in self._earlier() - set(self.files):
            (self.path / name).unlink(missing_ok=True)
        content = {
            "command": self.command,
            "inputs": inputs,
            "result": result,
            **({} if self.scenario is None else {"scenario": self.scenario.to_toml()}),
            "versions": {
                "casswarm": __version__,
                "python": platform.python_version(),
                **{name: version(name) for name in _LIBRARIES},
            },
            "platform": platform.platform(),
            "arguments": sys.argv[1:],
            "files": sorted({*self.files, "run.json"}),
            "finished": time.strftime("%Y-%m-%dT%H:%M:%SZ", time.gmtime()),
            "seconds": time.perf_counter() - self._started,
        }
        self.text("run.json", json_text(content) + "\n")
        return content

    def add_to_record(self) -> None:
        """Let run.json, which another command wrote, know of these files: it may remove them."""
        content = json.loads((self.path / "run.json").read_text(encoding="utf-8"))
        new, self.files = self.files, []
        content["files"] = sorted({*content.get("files", ()), *new})
        self.text("run.json", json_text(content) + "\n")
        self.files = new

    def _earlier(self) -> set[str]:
        """Names of the files that an earlier run left here, by its own record."""
        try:
            names = json.loads((self.path / "run.json").read_text(encoding="utf-8"))["files"]
        except (OSError, ValueError, KeyError):
            return set()
        return {name for name in names if Path(name).name == name}

    def _write(self, name: str, write: Callable[[Path], object]) -> None:
        part = self.path / f".{os.getpid()}-{name}"  # the ending stays: it names the format
        try:
            self.path.mkdir(parents=True, exist_ok=True)
            write(part)
            part.replace(self.path / name)
        except OSError as error:
            with suppress(OSError):
                part.unlink(missing_ok=True)
            raise Failure(
                f"cannot write {self.path / name}: {error.strerror or error}{self.remedy}"
            ) from error
        self.files.append(name)

    def closing(self) -> str:
        """A line that says what was written where."""
        return f"wrote {self.path}: {', '.join(self.files)}"


def json_text(content: Any) -> str:
    """JSON text; numbers that JSON does not know (infinity, NaN) become null."""
    return json.dumps(_plain(content), indent=2, allow_nan=False)


def _plain(value: Any) -> Any:
    if isinstance(value, dict):
        return {str(key): _plain(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [_plain(item) for item in value]
    if hasattr(value, "tolist"):
        return _plain(value.tolist())
    if isinstance(value, float) and not math.isfinite(value):
        return None
    if value is None or isinstance(value, (bool, int, float, str)):
        return value
    return str(value)


def aligned(rows: Iterable[tuple[str, ...]]) -> str:
    """Rows as columns of text, the first to the left and the others to the right."""
    table = list(rows)
    widths = [max(map(len, column)) for column in zip(*table, strict=True)]
    return "\n".join(
        "  ".join(
            cell.ljust(width) if column == 0 else cell.rjust(width)
            for column, (cell, width) in enumerate(zip(row, widths, strict=True))
        ).rstrip()
        for row in table
    )


def success_text(row: Mapping[Any, Any]) -> str:
    """Estimate of a success probability; where no run succeeds, also its upper bound."""
    return f"{row['success']:.4f}" if row["successes"] else f"0 (<= {row['success_high']:.3f})"


@contextmanager
def progress_report(quiet: bool) -> Iterator[Progress | None]:
    """Report progress on standard error: with a bar where a total is known, else with a line.

    Yields None where nothing should be reported. Bars are drawn on terminals only.
    """
    if quiet:
        yield None
        return
    from tqdm import tqdm

    bars: dict[str, Any] = {}
    with ExitStack() as stack:

        def report(task: str, done: float, total: float | None) -> None:
            if total is None and not done:
                say(task)
                return
            if task not in bars:
                bars[task] = stack.enter_context(tqdm(desc=task, disable=None))
            bars[task].total = total
            bars[task].update(done - bars[task].n)

        yield report


def say(text: str, quiet: bool = False) -> None:
    """Print a line on standard error."""
    if not quiet:
        click.echo(text, err=True)


def open_folder(
    command: str,
    scenario: Scenario | None,
    output: OutputOptions,
    figures: FigureOptions,
    remedy: str = "",
) -> Folder:
    """Results folder of a command as its options ask for it."""
    return Folder(command, scenario, output.out, figures.format, remedy, figures.width, figures.dpi)


def print_result(
    folder: Folder, content: Mapping[str, Any], text: str, output: OutputOptions
) -> None:
    """Print the result, as text or as JSON, and which files were written."""
    click.echo(json_text(content) if output.as_json else text)
    say(folder.closing(), output.quiet)
