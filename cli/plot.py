"""casswarm plot."""

from __future__ import annotations

from pathlib import Path

import click

from .common import figure_options, reported_errors
from .output import Folder, say


@click.command()
@click.argument("folder", type=click.Path(path_type=Path), metavar="DIR")
@click.option(
    "--run",
    type=click.IntRange(0),
    default=0,
    show_default=True,
    help="Which of the runs that casswarm simulate kept.",
)
@click.option(
    "--figure",
    "names",
    multiple=True,
    metavar="NAME",
    help="Only these figures, by the name of their file without its ending; repeatable. "
    "[default: all]",
)
@click.option(
    "--out",
    type=click.Path(file_okay=False, path_type=Path),
    help="Folder for the figures. [default: DIR]",
)
@click.option(
    "--format",
    "figures",
    type=click.Choice(["png", "pdf", "svg"]),
    default="png",
    show_default=True,
    help="Of the figures.",
)
@figure_options
@click.option("--quiet", is_flag=True, help="No progress.")
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
        from ..errors import StoreError, among
        from ..figures import look
        from ..saved import Saved

        saved = Saved.of(folder)
        with look(width):  # those of a comparison are drawn at once
            gallery = saved.gallery(run)
        for name in names:
            if name not in gallery:
                raise StoreError(f"{folder} has no figure {name!r}{among(name, gallery)}")
        target = Folder("plot", None, out or folder, figures, width=width, dpi=dpi)
        target.draw({name: drawn for name, drawn in gallery.items() if name in names or not names})
    if out is None:
        target.add_to_record()
    click.echo("\n".join(str(target.path / name) for name in target.files))
    say(f"{len(target.files)} figures of casswarm {saved.command}", quiet)
