"""Command lines with odd options."""

from __future__ import annotations

from pathlib import Path
from random import Random

import click
from oddities import odd_argument

from casswarm.cli import main

_FREE = ("--help", "--quiet", "--allow-code", "--dask", "--map")
"""Options that are left out: they print little, need a network, or ask for a minute of work."""

_COSTLY = ("--runs", "--save-trajectories", "--max-states", "--count")
_COSTLY += ("--half-width", "--workers", "--time-limit")
"""Options whose large valid values ask for much work: they get small and invalid ones only."""

_KEYS = ("swarm.v_max", "n", "spacing", "formation.rho", "time.t_f", "name", "hazard.kind", "guide")
_VALUES = ("1:2:2", "1:2:2:log", "0:1:-1", "nan:1:2", "[1,2]", "{a=1}", "1,nan", "2030-01-01", "'")


def odd_command_line(rng: Random, folder: Path, made: Path) -> list[str]:
    """A command on the small scenario or its results, with one or two odd options or arguments."""
    scenario, saved = str(made / "small.toml"), str(made / "results" / "sweep")
    commands = (
        ["scenarios", "check", scenario],
        ["scenarios", "show", scenario],
        ["scenarios", "new", str(folder / "new.toml"), "--from", scenario],
        ["plan", scenario, "--time-limit", "1", "--dpi", "30"],
        ["plan-swarm", scenario, "--dpi", "30"],
        ["simulate", scenario, "--runs", "2", "--policy", "naive", "--dpi", "30"],
        ["evaluate", scenario, "--policy", "naive", "--dpi", "30"],
        ["sweep", scenario, "--runs", "2", "--policy", "naive", "--set", "n=1", "--dpi", "30"],
        ["plot", saved, "--dpi", "30", "--out", str(folder / "drawn")],
        ["compare", "--family", "quick", "--solver", "nothing"],
        ["reproduce", "--only", "nothing"],
        ["solvers"],
    )
    line = list(rng.choice(commands))
    for _ in range(rng.choice((1, 1, 2))):
        if rng.random() < 0.15:
            line[rng.randrange(1, len(line)) if len(line) > 1 else 0] = odd_argument(rng)
        else:
            line += _odd_option(_command(line), rng)
    return line


def _command(line: list[str]) -> click.Command | None:
    """Command that a line names."""
    command: click.Command | None = main
    for word in line[:2]:
        if isinstance(command, click.Group):
            command = command.commands.get(word)
    return command


def _odd_option(command: click.Command | None, rng: Random) -> list[str]:
    """An option of a command with an odd value."""
    declared = [] if command is None else command.params
    known = [p for p in declared if isinstance(p, click.Option) and p.opts[0] not in _FREE]
    if not known or rng.random() < 0.05:
        return [rng.choice(("--no-such-option", "--runs=", "-x")), odd_argument(rng)]
    chosen = rng.choice(known)
    if chosen.is_flag:
        return [chosen.opts[0]]
    return [chosen.opts[0], _value(chosen.opts[0], rng)]


def _value(name: str, rng: Random) -> str:
    if name == "--set":
        value = rng.choice((odd_argument(rng), rng.choice(_VALUES)))
        return f"{rng.choice(_KEYS)}={value}" if rng.random() < 0.9 else value
    if name == "--seed":
        return rng.choice((odd_argument(rng), str(2**64 - 1), str(2**64)))
    if name in _COSTLY:
        return rng.choice(("1", "0", "-1", "nan", "-inf", "1e-9", "", "x", "１", "0.4"))
    return odd_argument(rng)
