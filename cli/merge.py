"""casswarm merge: the parts of a study, computed one by one, become the study."""

from __future__ import annotations

import shlex
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import click

from .._util.files import DAMAGED, read_json
from .._util.parts import MAX_PARTS
from .._util.text import shortened
from .common import PART_FILE, Failure, WrongInput, reported_errors
from .options import FOLDER, argument, option, options
from .output import say

COMMANDS = ("simulate", "sweep", "compare")
_LISTED = 20  # missing parts that a message names


@dataclass(frozen=True)
class MergeOptions:
    """The parts, and where the study is written."""

    parts: tuple[Path, ...] = argument(metavar="DIR...", nargs=-1, required=True, type=FOLDER)
    out: Path = option("Folder for the results.", required=True, type=FOLDER)
    allow_code: bool = option(
        "Run the command even if it names code: by --allow-code, or policies and solvers that "
        "are module:name. Only for folders that you trust."
    )


@click.command()
@options
def merge(selection: MergeOptions) -> None:
    """Merge the parts of a simulation, a sweep or a comparison.

    Each DIR is the folder of a command that was run with --part. The records of all parts are
    copied into one folder, where the command then runs without --part: nothing is left to compute,
    so it writes the tables, figures and run.json as if one machine had done all, and the tables of
    simulate and sweep are equal to the last byte. Run it in the folder where the parts were run.
    Every part has to be there; those that are missing are listed.

    \b
    Examples:
      casswarm sweep paper-1 --set n=2,3,4 --part 1/2 --out parts/1
      casswarm sweep paper-1 --set n=2,3,4 --part 2/2 --out parts/2
      casswarm merge parts/1 parts/2 --out results/sweep-paper-1
    """
    from .._util.checkpoint import joined

    with reported_errors():
        command, *arguments = _common_arguments(selection.parts)
        if _names_code(arguments) and not selection.allow_code:
            raise WrongInput(
                f"the parts' command names code: casswarm {command} {shlex.join(arguments)}; add "
                "--allow-code if you trust it"
            )
        joined(selection.parts, selection.out)
    arguments = [command, *arguments, "--out", str(selection.out)]
    if command != "compare":  # which always resumes
        arguments.append("--resume")
    say(f"casswarm {shlex.join(arguments)}")
    click.get_current_context().find_root().command.main(
        arguments, prog_name="casswarm", standalone_mode=False
    )


def _common_arguments(folders: Sequence[Path]) -> list[str]:
    """The command of all parts and its arguments, after checking that every part is there."""
    records = [_record(folder) for folder in folders]
    first = records[0]
    for folder, record in zip(folders, records, strict=True):
        for key in ("parts", "arguments"):
            if record[key] != first[key]:
                raise WrongInput(
                    f"{folder} is a part of another study than {folders[0]}: "
                    f"{_shown(record)}, not {_shown(first)}"
                )
    missing = sorted(set(range(1, first["parts"] + 1)) - {record["part"] for record in records})
    if missing:
        listed = ", ".join(map(str, missing[:_LISTED]))
        more = f" and {len(missing) - _LISTED} more" if len(missing) > _LISTED else ""
        raise Failure(
            f"of {first['parts']} parts, these are not there: {listed}{more}; run each of them as "
            f"casswarm {shlex.join(first['arguments'])} --part {missing[0]}/{first['parts']} --out "
            "DIR, with --resume if it was interrupted"
        )
    return list(first["arguments"])


def _names_code(arguments: Sequence[str]) -> bool:
    """Whether a command line has consents to run code, which are not those of who merges."""
    words = [part for word in arguments for part in word.split("=", 1)]
    values = zip(words, [*words[1:], ""], strict=True)
    return any(
        name == "--allow-code" or (name in ("--policy", "--solver") and ":" in value)
        for name, value in values
    )


def _shown(record: dict[str, Any]) -> str:
    return shortened(f"{shlex.join(record['arguments'])} in {record['parts']} parts")


def _record(folder: Path) -> dict[str, Any]:
    """What the command of a part wrote when it was finished."""
    try:
        record = read_json(folder / PART_FILE)
    except DAMAGED:
        record = None
    if not _is_record(record):
        raise Failure(
            f"{folder} holds no finished part of a study: run its command again, with --resume"
        )
    return dict(record)


def _is_record(record: Any) -> bool:
    """Whether a part's file says what `merge` needs."""
    if not isinstance(record, dict):
        return False
    part, parts, arguments = (record.get(key) for key in ("part", "parts", "arguments"))
    return (
        type(part) is type(parts) is int
        and 1 <= part <= parts <= MAX_PARTS
        and isinstance(arguments, list)
        and all(isinstance(word, str) for word in arguments)
        and arguments[:1] in [[name] for name in COMMANDS]
    )
