"""casswarm explore."""

from __future__ import annotations

import threading
import webbrowser
from dataclasses import dataclass
from pathlib import Path

import click

from . import completion
from .common import WrongInput, load, reported_errors
from .options import ScenarioInput, argument, option, options
from .output import say


@dataclass(frozen=True)
class ExploreOptions(ScenarioInput):
    """What is explored, and where."""

    scenario: str = argument(
        default="crossfire", required=False, shell_complete=completion.scenarios
    )
    policy: str = option(
        "--policy",
        default="leader",
        metavar="NAME",
        shell_complete=completion.policies,
        help="Policy to start with; the page has a list of all.",
    )
    out: Path | None = option(
        "--out",
        type=click.Path(dir_okay=False, path_type=Path),
        help="New file that the button Save writes. [default: NAME-explored.toml]",
    )
    browser: bool = option(
        "--browser/--no-browser",
        default=True,
        show_default=False,  # said in the help, by the flag's name
        help="Open the page in a browser. [default: browser]",
    )


@click.command()
@options
def explore(exploring: ExploreOptions) -> None:
    """Explore a scenario by hand, on a page in the browser.

    Radars, members and the target are dragged, or moved by the arrow keys; parameters have
    sliders. The guide follows, then a bound on its survival, and the success of the policy. The
    page can be opened on this computer only, by the address that is printed, and loads nothing
    from other computers. SCENARIO is crossfire by default. Ctrl-C ends it.

    \b
    Examples:
      casswarm explore
      casswarm explore paper-1 --set guide.search=global
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
    try:
        browser = webbrowser.get()
    except webbrowser.Error:
        return False
    if type(browser) is webbrowser.GenericBrowser:  # it would take over the terminal
        return False
    return browser.open(address)
