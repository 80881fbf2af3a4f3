"""casswarm plot."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import click

from .._util.text import counted, did_you_mean
from ..errors import CheckpointError
from .common import reported_errors
from .options import FigureOptions, SavedRunOptions, option, options, out_option, quiet_option
from .output import open_folder, progress_report, say


@dataclass(frozen=True)
class PlotOptions(SavedRunOptions):
    """Which figures are drawn, and where."""

    names: tuple[str, ...] = option(
        "--figure",
        multiple=True,
        metavar="NAME",
        help="Draw only this figure, named by its file without the suffix. Repeatable. "
        "[default: all]",
    )
    out: Path | None = out_option("Folder for the figures. [default: DIR]")
    quiet: bool = quiet_option()


@click.command()
@options
def plot(selection: PlotOptions, figures: FigureOptions) -> None:
    """Draw the figures of a results folder again.

    DIR is a folder written by casswarm plan, plan-swarm, simulate, evaluate, sweep or compare.
    Nothing is solved or sampled again: only width, format and resolution change, and which run is
    shown.

    \b
    Examples:
      casswarm plot results/simulate-paper-1 --format pdf --width column
      casswarm plot results/simulate-paper-1 --run 3 --figure run-leader --figure formation-leader
      casswarm plot results/compare --width slide --out slides
    """
    with reported_errors(), progress_report(selection.quiet) as progress:
        from ..results.folder import ResultsFolder

        folder = selection.folder
        saved = ResultsFolder.open(folder, selection.allow_code)
        catalogue = saved.figures(selection.run)
        for name in selection.names:
            if name not in catalogue:
                raise CheckpointError(
                    f"{folder} has no figure {name!r}{did_you_mean(name, catalogue)}",
                    folder=folder,
                    figure=name,
                )
        target = open_folder("plot", None, selection.out or folder, figures)
        names = selection.names or tuple(catalogue)
        drawn = {name: draw for name, draw in catalogue.items() if name in names}
        target.write_figures(drawn, progress)
    if selection.out is None:
        target.extend_record()
    click.echo("\n".join(str(target.path / name) for name in target.files))
    say(f"{counted(len(target.files), 'figure')} of casswarm {saved.command}", selection.quiet)
