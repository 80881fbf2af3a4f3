"""Command line: commands parse options, call the library, and write and print results.

Command modules use the library's public names, which are imported when they are first used, and
import its other modules inside their functions, so that ``--help`` is quick.
"""

from __future__ import annotations

from typing import Any

import click

from .common import ARGUMENTS
from .compare import compare
from .evaluate import evaluate
from .explain import explain
from .lists import scenarios, solvers
from .merge import merge
from .output import show_log
from .plan import plan, plan_swarm
from .reproduce import reproduce
from .show import animate, explore, plot
from .simulate import simulate
from .sweep import sweep


class _Commands(click.Group):
    """The commands, which can see the words of their command line."""

    def resolve_command(self, ctx: click.Context, args: list[str]) -> Any:
        """Note the words before the command takes them."""
        ctx.meta[ARGUMENTS] = list(args)
        return super().resolve_command(ctx, args)


@click.group(
    cls=_Commands,
    commands=[
        plan,
        plan_swarm,
        simulate,
        evaluate,
        sweep,
        compare,
        merge,
        explain,
        reproduce,
        plot,
        animate,
        explore,
        scenarios,
        solvers,
    ],
    context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 100},
)
@click.version_option(package_name="casswarm", prog_name="casswarm")
def main() -> None:
    """Guide a swarm of agents through a field of hazards to a target.

    \b
    Examples:
      casswarm scenarios list                     list the built-in scenarios
      casswarm plan paper-1                       path of least risk for a single agent
      casswarm plan-swarm paper-1                 paths of all members, planned jointly
      casswarm simulate paper-1                   success of every policy by Monte Carlo
      casswarm evaluate paper-1                   success of every policy, computed exactly
      casswarm sweep paper-1 --set n=2,3,4,5      success over parameter values
      casswarm compare --family quick             speed and reliability of the solvers
      casswarm merge parts/*                      one study from its parts
      casswarm explain model.nl                   why a program is infeasible
      casswarm plot results/simulate-paper-1      figures from saved results
      casswarm animate results/simulate-paper-1   animation of a saved run
      casswarm explore paper-1                    a page to drag radars and see what follows
      casswarm reproduce                          tables and figures of the paper

    SCENARIO is the name of a built-in scenario or the path of a TOML file.

    Results go to standard output and into a folder under results/; progress and warnings go to
    standard error. Exit codes: 0 done, 1 ran but failed, 2 wrong input.
    """
    show_log()
