"""casswarm plot."""

from __future__ import annotations

from pathlib import Path

import click

from .common import reported_errors
from .options import figure_options, kept_run_options, out_option, quiet_option
from .output import Folder, say


@click.command()
@kept_run_options
@click.option(
    "--figure",
    "names",
    multiple=True,
    metavar="NAME",
    help="Only these figures, by the name of their file without its ending; repeatable. "
    "[default: all]",
)
@out_option("Folder for the figures. [default: DIR]")
@figure_options
@quiet_option
def plot(
    folder: Path,
    run: int,
    names: tuple[str, ...],
    out: Path | None,
    figures: str,
    width: str,
    dpi: int,
    quiet: bool,
) -> None:
    """Draw the figures of a results folder again, from what is saved in it.

    DIR is a folder that casswarm plan, simulate, evaluate, sweep or compare left. Nothing is solved
    or sampled again: only width, format and resolution change, and which run is shown.

    \b
    Examples:
      casswarm plot results/simulate-paper-1 --format pdf --width column
      casswarm plot results/simulate-paper-1 --run 3 --figure run-leader --figure formation-leader
      casswarm plot results/compare --width slide --out slides
    """
    with reported_errors():
        from .._util.text import did_you_mean
        from ..errors import CheckpointError
        from ..figures import theme
        from ..results.folder import Saved

        saved = Saved.of(folder)
        with theme(width):  # those of a comparison are drawn at once
            catalogue = saved.figures(run)
        for name in names:
            if name not in catalogue:
                raise CheckpointError(
                    f"{folder} has no figure {name!r}{did_you_mean(name, catalogue)}"
                )
        target = Folder("plot", None, out or folder, figures, width=width, dpi=dpi)
        target.draw(
            {name: drawn for name, drawn in catalogue.items() if name in names or not names}
        )
    if out is None:
        target.add_to_record()
    click.echo("\n".join(str(target.path / name) for name in target.files))
    say(f"{len(target.files)} figures of casswarm {saved.command}", quiet)
