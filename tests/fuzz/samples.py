"""What is mutated: scenario files, results folders, and unfinished studies with their tables."""

from __future__ import annotations

import gc
import tomllib
from functools import cache
from importlib.resources import files
from pathlib import Path
from random import Random
from typing import Any

from sweep_cases import SMALL

import casswarm as csw
from casswarm.cli import main

RESULTS = {
    "sweep": ("--runs", "2", "--policy", "naive", "--set", "formation.rho=0.05,0.1"),
    "simulate": ("--runs", "4", "--policy", "naive", "--policy", "leader"),
    "plan": ("--time-limit", "1"),
    "evaluate": ("--policy", "leader"),
    "plan-swarm": (),
}
"""Commands whose results folders are mutated, with options for little work."""

STUDIES = ("simulate", "sweep")
GRID: dict[str, Any] = {"hazard.alpha_1": [5.0, 20.0], "n": [1, 2, 3]}
POLICIES = ("naive", "leader")


@cache
def scenario_texts() -> list[str]:
    """Texts of the small scenario and of the built-in ones."""
    folder = files("casswarm.scenario.builtin")
    texts = [entry.read_text() for entry in folder.iterdir() if entry.name.endswith(".toml")]
    return [SMALL.to_toml(), *sorted(texts)]


def scenario_text(rng: Random) -> str:
    """Text of a scenario, of the small one in half of the cases."""
    texts = scenario_texts()
    return texts[0] if rng.random() < 0.5 else rng.choice(texts[1:])


def scenario_data(rng: Random) -> dict[str, Any]:
    """Tables of a scenario."""
    return tomllib.loads(scenario_text(rng))


def call(*arguments: object) -> int:
    """Exit code of a command, run in this process."""
    try:
        main([str(argument) for argument in arguments], prog_name="casswarm")
    except SystemExit as end:
        return int(end.code or 0)
    return 0


@cache
def guide() -> csw.Guide:
    """Guide of the small scenario."""
    return csw.plan(SMALL, certify=False)


def study(command: str, folder: Path | None, if_exists: str = "resume") -> str:
    """Tables of a study, as text; with a folder, its work is saved there."""
    saved: dict[str, Any] = {"checkpoint": folder, "if_exists": if_exists}
    if command == "simulate":
        done = csw.simulate(SMALL, list(POLICIES), 30, guide=guide(), **saved)
        return str(done.runs.to_csv() + done.summary.to_csv() + done.paired.to_csv())
    return str(csw.sweep(SMALL, GRID, ["naive"], runs=5, **saved).table.to_csv())


def make_results(folder: Path, command: str) -> int:
    """Write the results folder of a command on the small scenario."""
    csw.save_scenario(SMALL, folder / "small.toml")
    options = (*RESULTS[command], "--dpi", "30", "--quiet", "--out", folder / "results" / command)
    return call(command, folder / "small.toml", *options)


def make_study(folder: Path, command: str) -> int:
    """Write an unfinished study, and the tables that it has to end with."""
    from casswarm.studies import simulation as batches

    batches.BATCH = 5  # for several records; changes no result
    target = folder / "studies" / command
    tables = study(command, target)
    records = sorted((target / "checkpoint").glob("*.npz"))
    for path in (records[1], records[-1], target / "checkpoint" / "finished"):
        path.unlink()
    (folder / f"{command}.expected").write_text(tables, encoding="utf-8")
    return 0


def warm_up() -> None:
    """Import and compile, once for all cases, what they would otherwise each do again."""
    import casswarm.figures
    import casswarm.results.catalogue
    import casswarm.results.folder  # noqa: F401

    csw.simulate(SMALL, ["leader", "constrained"], 2, guide=guide())
    collisions = {"kind": "saturation+collision", "beta_1": 0.2, "beta_2": 6.0}
    colliding = SMALL.replace(hazard=collisions)
    csw.simulate(colliding, ["constrained"], 2, guide=csw.plan(colliding, certify=False))
    gc.freeze()  # what cases share is not copied when one of them collects garbage
