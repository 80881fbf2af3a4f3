"""casswarm animate."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path

import click

from .common import WrongInput, reported_errors
from .options import kept_run_options, quiet_option
from .output import Folder, progress_bar, say


@click.command()
@kept_run_options
@click.option("--policy", metavar="NAME", help="Whose run. [default: the last one simulated]")
@click.option(
    "--html", is_flag=True, help="A page that plays the run, step by step if you like, not a GIF."
)
@click.option(
    "--fps",
    type=click.FloatRange(0.1, 50.0),
    default=4.0,
    show_default=True,
    help="Steps a second.",
)
@click.option(
    "--dpi", type=click.IntRange(30, 300), default=110, show_default=True, help="Of the frames."
)
@click.option(
    "--out", type=click.Path(path_type=Path), help="File. [default: DIR/animation-POLICY-RUN.gif]"
)
@quiet_option
def animate(
    folder: Path,
    policy: str | None,
    run: int,
    html: bool,
    fps: float,
    dpi: int,
    out: Path | None,
    quiet: bool,
) -> None:
    """Animate a run that casswarm simulate kept: who leads, who is lost, and how the rates change.

    DIR is a folder that casswarm simulate left. Nothing is solved or sampled again. The map on the
    left shows the rate that one more member would have, given where the others are; the close-up
    on the right shows the formation, and that rate as a share of a lone member's.

    \b
    Examples:
      casswarm animate results/simulate-paper-1
      casswarm animate results/simulate-paper-1 --policy constrained --run 3
      casswarm animate results/simulate-paper-1 --html --out run.html
    """
    ending = ".html" if html else ".gif"
    if out is not None and out.suffix.lower() != ending:
        wanted = "a page, --html" if html else "a GIF; --html makes a page"
        raise WrongInput(f"--out {out}: its name must end in {ending}, for this is {wanted}")
    with reported_errors(), ExitStack() as stack:
        from ..figures import animate as animated
        from ..figures import player, save_gif
        from ..results.folder import Saved

        saved = Saved.of(folder)
        name, trace = saved.trace(policy, run)
        title = f"{saved.scenario.name}, {name}, run {run}"
        moving = animated(saved.scenario, trace, saved.guide, title=title, frames_per_second=fps)
        file = out or folder / f"animation-{name}-{run}{ending}"
        target = Folder("animate", None, file.parent)
        progress = None if quiet else _progress(stack)
        if html:
            target.text(file.name, player(moving, dpi, title=title, page=True, progress=progress))
        else:
            target.file(file.name, lambda path: save_gif(moving, path, dpi, progress))
    if out is None:
        target.add_to_record()
    click.echo(str(file))
    say(f"{len(trace.alive)} frames, {file.stat().st_size / 1e6:.1f} MB", quiet)


def _progress(stack: ExitStack) -> Callable[[int, int | None], None]:
    """Frames are told by their number from 0 on."""
    tell = progress_bar(stack, "drawing", "frame")
    return lambda frame, total: tell(frame + 1, total)
