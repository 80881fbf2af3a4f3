"""What is called with a mutation, and how it may end."""

from __future__ import annotations

import os
import shutil
import sys
from collections.abc import Callable
from pathlib import Path
from random import Random

import arguments
import samples
import tomli_w
from file_mutations import forge_record, mutate_file, mutate_records
from mutations import mutated_bytes, mutated_scenario
from sandbox import Outcome

import casswarm as csw
from casswarm.errors import CasswarmError

ACCEPTED, FAILED, REFUSED = 0, 1, 2
"""How a case may end: as the exit codes of commands."""

_SMALL = (40, 6, 12)  # steps, members and radars up to which a valid scenario is simulated


def scenario(rng: Random, folder: Path, made: Path) -> int:  # noqa: ARG001
    """A scenario with odd values: an error in plain words, or a scenario that works."""
    path = folder / "mutated.toml"
    try:
        text = tomli_w.dumps(mutated_scenario(samples.scenario_data(rng), rng))
    except ValueError:  # Python refuses to print integers of thousands of digits
        text = "x = 1" + "0" * 5_000
    path.write_text(text, encoding="utf-8")
    return _loaded(path, rng)


def text(rng: Random, folder: Path, made: Path) -> int:  # noqa: ARG001
    """A scenario file that is damaged."""
    path = folder / "mutated.toml"
    path.write_bytes(mutated_bytes(samples.scenario_text(rng).encode(), rng))
    return _loaded(path, rng)


def _loaded(path: Path, rng: Random) -> int:
    if rng.random() < 0.2:
        return samples.call("scenarios", rng.choice(("check", "show")), path)
    try:
        loaded = csw.load_scenario(path)
    except csw.ScenarioError as error:
        print(ascii(str(error)))
        return REFUSED
    loaded.to_toml(comments=True)
    csw.save_scenario(loaded, path.with_name("saved.toml"))
    if csw.load_scenario(path.with_name("saved.toml")) != loaded:
        raise AssertionError("the saved scenario differs")
    radars = max(len(case.scenario.hazard.radar_positions) for case in loaded.cases)
    size = loaded.n_steps, loaded.n, radars
    small = all(value <= limit for value, limit in zip(size, _SMALL, strict=True))
    return _simulated(loaded, rng) if small and rng.random() < 0.2 else ACCEPTED


def _simulated(loaded: csw.Scenario, rng: Random) -> int:
    """Plan and simulate a valid scenario, by a policy and a few runs."""
    policy = rng.choice(("naive", "leader", "constrained"))
    try:
        guide = csw.plan(loaded, search="local", time_limit=1.0)
        study = csw.simulate(loaded, [policy], 2, guide=guide)
    except CasswarmError as error:
        print(ascii(str(error)))
        return FAILED
    if not study.summary["success"].between(0, 1).all():
        raise AssertionError(f"success is {study.summary['success'].tolist()}")
    return ACCEPTED


def option(rng: Random, folder: Path, made: Path) -> int:
    """A command with odd options."""
    line = arguments.odd_command_line(rng, folder, made)
    print("casswarm", *map(ascii, line), file=sys.stderr)
    return samples.call(*line)


def results(rng: Random, folder: Path, made: Path) -> int:
    """A results folder with a mutated file: drawn, or refused."""
    command = rng.choice(sorted(path.name for path in (made / "results").iterdir()))
    saved = Path(shutil.copytree(made / "results" / command, folder / "saved"))
    mutable = [path for path in saved.iterdir() if path.suffix in (".json", ".csv", ".npz")]
    mutate_file(rng.choice(sorted(mutable)), rng)
    if command == "simulate" and rng.random() < 0.15:
        return samples.call("animate", saved, "--dpi", "30", "--quiet")
    return samples.call("plot", saved, "--dpi", "30", "--quiet", "--out", folder / "drawn")


def record(rng: Random, folder: Path, made: Path) -> int:
    """A study with damaged records: resumed to the tables of an undisturbed one, or refused."""
    return _resumed(rng, folder, made, lambda records: mutate_records(records, rng), equal=True)


def cell(rng: Random, folder: Path, made: Path) -> int:
    """A study with a forged record, of odd arrays under their valid hash: no exception but ours."""

    def forge(records: Path) -> None:
        forge_record(rng.choice(sorted(records.glob("*.npz"))), rng)

    return _resumed(rng, folder, made, forge, equal=False)


def _resumed(
    rng: Random, folder: Path, made: Path, change: Callable[[Path], None], equal: bool
) -> int:
    """Change the records of a study and resume it: to equal tables, or how it was refused."""
    command = rng.choice(samples.STUDIES)
    saved = Path(shutil.copytree(made / "studies" / command, folder / "study"))
    change(saved / "checkpoint")
    try:
        tables = samples.study(command, saved)
    except CasswarmError as error:
        print(ascii(str(error)))
        return REFUSED
    except OSError as error:  # which the command line reports in a line
        if error.filename is None and error.errno is None:
            raise
        print(ascii(str(error)))
        return FAILED
    if equal and tables != (made / f"{command}.expected").read_text(encoding="utf-8"):
        raise AssertionError("the tables differ from those of an undisturbed study")
    return ACCEPTED


Target = Callable[[Random, Path, Path], int]
KINDS: dict[str, tuple[Target, float]] = {
    "scenario": (scenario, 0.52),
    "text": (text, 0.30),
    "option": (option, 0.06),
    "results": (results, 0.06),
    "record": (record, 0.04),
    "cell": (cell, 0.02),
}
"""Kinds of mutations, with their shares."""


def run(kind: str, number: int, seed: int, folder: Path, made: Path) -> int:
    """Run a case, which its kind, number and seed determine."""
    os.environ["COLUMNS"] = "100"
    return KINDS[kind][0](Random(f"{seed}:{kind}:{number}"), folder, made)


def fault(kind: str, outcome: Outcome) -> str:
    """What is wrong with how a case ended; empty if nothing is."""
    if outcome.stopped:
        return outcome.stopped
    if outcome.code not in (ACCEPTED, FAILED, REFUSED):
        return f"ended with {outcome.code}"
    if "Traceback (most recent call last)" in outcome.output:
        return "prints a traceback"
    # click repeats arguments as they were typed
    if kind != "option" and any(not (c.isprintable() or c in "\n\r\t") for c in outcome.output):
        return "prints a character that a terminal obeys"
    return ""
