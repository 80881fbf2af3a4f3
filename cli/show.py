"""casswarm plot, casswarm animate and casswarm explore."""

from __future__ import annotations

import threading
from dataclasses import dataclass
from pathlib import Path

import click

from .._util.text import counted, did_you_mean
from ..errors import CheckpointError
from .common import WrongInput, load, reported_errors
from .options import (
    FOLDER,
    FigureOptions,
    Number,
    SavedRunOptions,
    ScenarioInput,
    option,
    options,
    policy_option,
    quiet_option,
    scenario_argument,
)
from .output import open_folder, progress_report, say


@dataclass(frozen=True)
class PlotOptions(SavedRunOptions):
    """Figures to draw, and their folder."""

    names: tuple[str, ...] = option(
        "Draw only this figure, named by its file without the suffix. Repeatable. [default: all]",
        "--figure",
        metavar="NAME",
    )
    out: Path | None = option("Folder for the figures. [default: DIR]", type=FOLDER)
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


@dataclass(frozen=True)
class AnimationOptions(SavedRunOptions):
    """Run to animate, and options of the animation."""

    policy: str | None = option(
        "Policy whose run is animated. [default: the last one simulated]", metavar="NAME"
    )
    html: bool = option("Write a web page with playback controls instead of a GIF.")
    fps: float = option("Number of steps per second.", type=Number(0.1, 50.0), default=4.0)
    dpi: int = option(
        "Resolution of the frames, in dots per inch.", type=click.IntRange(30, 300), default=110
    )
    out: Path | None = option("File for the animation. [default: DIR/animation-POLICY-RUN.gif]")
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
      casswarm animate results/simulate-paper-1 --out run.html
    """
    out = animation.out
    html = animation.html or (out is not None and out.suffix.lower() == ".html")
    suffix = ".html" if html else ".gif"
    if out is not None and out.suffix.lower() != suffix:
        expected = ".html, since --html writes a page" if html else ".gif, or .html for a page"
        raise WrongInput(f"--out {out}: the name must end in {expected}")
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
        if html:
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


@dataclass(frozen=True)
class ExploreOptions(ScenarioInput):
    """Scenario to explore, and options of its page."""

    scenario: str = scenario_argument(default="crossfire", required=False)
    policy: str = policy_option(
        "Policy to start with; the page has a list of all.", default="leader"
    )
    out: Path | None = option(
        "New file that the button Save writes. [default: NAME-explored.toml]",
        type=click.Path(dir_okay=False, path_type=Path),
    )
    browser: bool = option(
        "Open the page in a browser. [default: browser]",
        "--browser/--no-browser",
        default=True,
        show_default=False,  # said in the help, by the flag's name
    )


@click.command()
@options
def explore(exploring: ExploreOptions) -> None:
    """Explore a scenario by hand, on a page in the browser.

    Radars, members and the target are dragged, or moved by the arrow keys; parameters have
    sliders. The guide follows, then a bound on its survival, and the success of the policy. If the
    hazard is not known (hazard.case), a mixture of guides follows, with a slider from the prior to
    the worst case. The page can be opened on this computer only, by the address that is printed,
    and loads nothing from other computers. SCENARIO is crossfire by default. Ctrl-C ends it.

    \b
    Examples:
      casswarm explore
      casswarm explore paper-1 --set guide.search=global
      casswarm explore two-gaps
      casswarm explore mine.toml --out changed.toml --no-browser
    """
    with reported_errors():
        from ..exploration.frontends import page_server
        from ..exploration.session import Session

        out = exploring.out
        if out is not None and out.exists():
            raise WrongInput(f"{out} exists; choose another name")
        session = Session(load(exploring), exploring.policy, out)
        with page_server(session) as address:
            click.echo(address)
            if exploring.browser and not _opened(address):
                say("no browser could be opened: open this address in one")
            say("Ctrl-C ends it")
            try:
                threading.Event().wait()
            except KeyboardInterrupt:
                say("ended")


def _opened(address: str) -> bool:
    """Open a page in a browser with windows; False if there is none."""
    import webbrowser

    try:
        browser = webbrowser.get()
    except webbrowser.Error:
        return False
    if type(browser) is webbrowser.GenericBrowser:  # it would take over the terminal
        return False
    return browser.open(address)
