"""The command line. Commands parse, call the library and write; they compute nothing themselves.

Command modules import the library inside their functions, so that ``casswarm --help`` is quick.
"""

from __future__ import annotations

import logging

import click

from .. import __version__
from .animate import animate
from .compare import compare
from .evaluate import evaluate
from .plan import plan
from .plot import plot
from .reproduce import reproduce
from .scenarios import scenarios
from .simulate import simulate
from .solvers import solvers
from .sweep import sweep


@click.group(context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 100})
@click.version_option(__version__, prog_name="casswarm")
def main() -> None:
    """Guide a swarm of agents through a field of hazards to a target.

    \b
    Begin with:
      casswarm scenarios list            what is built in
      casswarm plan paper-1              the least risky way of a lone agent
      casswarm simulate paper-1          how often the swarm arrives, policy by policy
      casswarm evaluate paper-1          the same without sampling, exactly
      casswarm compare --family quick    which solver solves what, and how fast
      casswarm sweep paper-1 --set n=2,3,4,5     the same over parameters
      casswarm plot results/simulate-paper-1 --format pdf --width column    figures again
      casswarm animate results/simulate-paper-1     a run that moves
      casswarm reproduce                 the paper's tables and figures, made again

    SCENARIO is always the name of a built-in scenario or the path of a TOML file.

    Results go to standard output and into a folder under results/; progress and warnings go to
    standard error. Exit codes: 0 done, 1 ran but failed, 2 wrong input.
    """
    log = logging.getLogger("casswarm")
    log.setLevel(logging.INFO)
    if not log.handlers:
        log.addHandler(logging.StreamHandler())  # standard error


for command in (
    plan,
    simulate,
    evaluate,
    sweep,
    compare,
    reproduce,
    plot,
    animate,
    scenarios,
    solvers,
):
    main.add_command(command)
