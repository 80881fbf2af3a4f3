"""casswarm animate."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import click

from .._util.text import counted
from .common import WrongInput, reported_errors
from .options import Number, SavedRunOptions, option, options, quiet_option
from .output import progress_report, say


@dataclass(frozen=True)
class AnimationOptions(SavedRunOptions):
    """Which run is animated, and how."""

    policy: str | None = option(
        "--policy",
        metavar="NAME",
        help="Policy whose run is animated. [default: the last one simulated]",
    )
    html: bool = option(
        "--html", is_flag=True, help="Write a web page with playback controls instead of a GIF."
    )
    fps: float = option(
        "--fps",
        type=Number(0.1, 50.0),
        default=4.0,
        help="Number of steps per second.",
    )
    dpi: int = option(
        "--dpi",
        type=click.IntRange(30, 300),
        default=110,
        help="Resolution of the frames, in dots per inch.",
    )
    out: Path | None = option(
        "--out",
        type=click.Path(path_type=Path),
        help="File for the animation. [default: DIR/animation-POLICY-RUN.gif]",
    )
    quiet: bool = quiet_option()


@click.command()
@options
def animate(animation: AnimationOptions) -> None:
    """Animate a saved run.

    Shows who leads, which members are lost, and how the rates change. DIR is a folder written by
    casswarm simulate. Nothing is solved or sampled again. The map on the left shows the rate that
    one more member would have at every point; the close-up on the right shows the formation, with
    that rate relative to an isolated agent's.

    \b
    Examples:
      casswarm animate results/simulate-paper-1
      casswarm animate results/simulate-paper-1 --policy constrained --run 3
      casswarm animate results/simulate-paper-1 --html --out run.html
    """
    suffix = ".html" if animation.html else ".gif"
    out = animation.out
    if out is not None and out.suffix.lower() != suffix:
        kind = "a page, --html" if animation.html else "a GIF; --html writes a page"
        raise WrongInput(f"--out {out}: the name must end in {suffix}, since this is {kind}")
    with reported_errors(), progress_report(animation.quiet) as progress:
        from ..figures import animate as make_animation
        from ..figures import player, save_gif
        from ..results.folder import ResultsFolder

        saved = ResultsFolder.open(animation.folder, animation.allow_code, ["simulate"])
        name, run = saved.trajectory(animation.policy, animation.run)
        title = f"{saved.scenario.name}, {name}, run {animation.run}"
        movie = make_animation(
            saved.scenario, run, saved.guide, title=title, steps_per_second=animation.fps
        )
        file = out or animation.folder / f"animation-{name}-{animation.run}{suffix}"
        target = ResultsFolder.create("animate", None, file.parent)
        if animation.html:
            page = player(movie, animation.dpi, title=title, page=True, progress=progress)
            target.write_file(file.name, page)
        else:
            target.write_file(
                file.name, lambda path: save_gif(movie, path, animation.dpi, progress)
            )
    if out is None:
        target.extend_record()
    click.echo(str(file))
    steps = counted(len(run.alive), "step")
    say(f"{steps}, {file.stat().st_size / 1e6:.1f} MB", animation.quiet)
