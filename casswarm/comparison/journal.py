"""The folder of a comparison: what it was asked, and every cell as it is finished."""

from __future__ import annotations

import json
import os
import platform
from collections.abc import Mapping
from importlib.metadata import version
from pathlib import Path
from typing import Any

from ..errors import ComparisonError

INPUTS = "inputs.json"
CELLS = "cells.jsonl"

_LIBRARIES = ("casswarm", "casadi", "numpy", "scipy", "numba")
_SHOWN = 4  # differences that a message names


class Journal:
    """Finished cells, in memory or in a folder: a JSON text a line, on disk before the next begins.

    Parameters
    ----------
    folder : Path or None
        Made if it is not there; None keeps cells in memory alone.
    inputs : mapping
        Plain values: all that made the cells, machine and versions among them.

    Raises
    ------
    ComparisonError
        The folder holds cells of other inputs, or is damaged; the message names the difference.
    """

    def __init__(self, folder: Path | None, inputs: Mapping[str, Any]) -> None:
        self.folder = folder
        self.rows: list[dict[str, Any]] = []
        if folder is not None:
            self._open(folder, json.loads(json.dumps(inputs)))

    def add(self, row: dict[str, Any]) -> None:
        """Keep a cell."""
        self.rows.append(row)
        if self.folder is not None:
            with (self.folder / CELLS).open("ab") as file:
                file.write(
                    json.dumps(row).encode() + b"\n"
                )  # NaN and Infinity as Python reads them
                file.flush()
                os.fsync(file.fileno())

    def _open(self, folder: Path, inputs: dict[str, Any]) -> None:
        path = folder / INPUTS
        try:
            folder.mkdir(parents=True, exist_ok=True)
            if path.exists():
                _require_same(folder, json.loads(path.read_text(encoding="utf-8")), inputs)
                self.rows = _read(folder / CELLS)
            elif (folder / CELLS).exists():
                raise ComparisonError(f"{folder} holds {CELLS} without {INPUTS}: {_ADVICE}")
            else:
                part = folder / f".{os.getpid()}-{INPUTS}"
                part.write_text(json.dumps(inputs, indent=2) + "\n", encoding="utf-8")
                part.replace(path)
        except (OSError, ValueError) as error:
            if isinstance(error, ComparisonError):
                raise
            raise ComparisonError(f"cannot use the folder {folder}: {error}") from error


_ADVICE = "choose another folder, or remove this one"


def _require_same(folder: Path, there: dict[str, Any], here: dict[str, Any]) -> None:
    found = list(_differences(there, here))
    if found:
        more = f"; and {len(found) - _SHOWN} more" if len(found) > _SHOWN else ""
        told = "; ".join(found[:_SHOWN])
        raise ComparisonError(f"{folder} holds another comparison: {told}{more}. {_ADVICE}")


def _differences(there: Any, here: Any, key: str = "") -> list[str]:
    """What differs, each with its key; names before the values of what both have."""
    if not (isinstance(there, dict) and isinstance(here, dict)):
        return [] if there == here else [f"{key}: {there!r} there, {here!r} here"]
    prefix = f"{key}." if key else ""
    lines = [f"{prefix}{name} is not there" for name in here if name not in there]
    lines += [f"{prefix}{name} is there alone" for name in there if name not in here]
    for name in there:
        if name in here:
            lines += _differences(there[name], here[name], f"{prefix}{name}")
    return lines


def _read(path: Path) -> list[dict[str, Any]]:
    """Rows of a file; a last line that was cut off is taken away from it."""
    if not path.exists():
        return []
    content = path.read_bytes()
    whole = content.rfind(b"\n") + 1
    if whole < len(content):
        with path.open("r+b") as file:
            file.truncate(whole)
    rows: dict[tuple[str, ...], dict[str, Any]] = {}
    for number, line in enumerate(content[:whole].splitlines(), 1):
        try:
            row = json.loads(line)
            rows.setdefault((row["problem"], row["start"], row["solver"]), row)
        except (ValueError, KeyError, TypeError) as error:
            raise ComparisonError(
                f"{path} is damaged at line {number} ({error}): {_ADVICE}"
            ) from error
    return list(rows.values())


def surroundings() -> dict[str, Any]:
    """Machine and versions, plain values: times of different ones do not belong in one table."""
    return {
        "machine": {
            "processor": _processor(),
            "cores": os.cpu_count(),
            "system": platform.platform(),
            "python": platform.python_version(),
        },
        "versions": {name: version(name) for name in _LIBRARIES},
    }


def _processor() -> str:
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:
        lines = []
    named = (line.partition(":")[2].strip() for line in lines if line.startswith("model name"))
    return next(named, "") or platform.processor() or platform.machine()
