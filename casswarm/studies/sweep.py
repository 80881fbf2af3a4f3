"""Sweeps: policies over a grid of scenario parameters, exact or sampled, as one tidy table."""

from __future__ import annotations

import json
import tomllib
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field
from importlib.metadata import version
from itertools import product
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd

from .._util.parallel import Workers, checked_workers, done_jobs, require_sendable
from ..errors import ScenarioError
from ..scenario.variations import DERIVED
from .checkpoint import Checkpoint, IfExists
from .simulation import PAPER_POLICIES, distinct_policies
from .sweep_points import Options, SweepPoint

if TYPE_CHECKING:
    from ..scenario import Scenario

Progress = Callable[[int, int], None]


@dataclass(frozen=True, eq=False)
class Sweep:
    """What a sweep gave.

    Parameters
    ----------
    scenario : Scenario
        What the parameters were changed in.
    keys : tuple of str
        The parameters.
    table : DataFrame
        A row a cell, in the order of the grid: a column a parameter, policy, method ("exact" or
        "sampled"), the numbers of `MEASURES`, runs and successes or states, status ("ok" or
        "failed") and reason.
    effort : DataFrame
        Seconds of every cell. Not reproducible.
    """

    scenario: Scenario = field(repr=False)
    keys: tuple[str, ...]
    table: pd.DataFrame
    effort: pd.DataFrame = field(repr=False)

    @property
    def failures(self) -> int:
        """Cells that failed."""
        return int((self.table["status"] != "ok").sum())

    def __str__(self) -> str:
        return (
            f"{self.scenario.name}: {len(self.table)} cells, {self.failures} failed\n{self.table}"
        )


def sweep(
    scenario: Scenario,
    settings: Mapping[str, Sequence[Any]],
    policies: Sequence[Any] = PAPER_POLICIES,
    *,
    runs: int | None = None,
    seed: int = 0,
    tolerance: float = 1e-3,
    max_states: int | None = None,
    aggregation_tol: float = 0.0,
    solver: str = "auto",
    workers: Workers = 1,
    checkpoint: Path | None = None,
    if_exists: IfExists = "error",
    progress: Progress | None = None,
) -> Sweep:
    """Policies on every combination of parameter values.

    A cell that fails (no guide, wrong values) is a row with its reason; the others go on.

    Parameters
    ----------
    scenario : Scenario
    settings : mapping of key to values
        Dotted keys as `Scenario.with_values` takes them, such as ``"formation.rho"``; and two more:
        ``"spacing"`` scales the initial positions about their centroid until the nearest two
        members are so far apart, and ``"n"`` takes the first n members, or adds members at the
        nearest free places of a triangular lattice about the centroid.
    policies : sequence
        As in `simulate`.
    runs : int, optional
        Runs of every cell; without it, laws are exact, as by `evaluate`.
    seed : int
        Of the runs; every cell sees the same random numbers.
    tolerance, max_states, merging
        Of the laws; see `evaluate`.
    solver : str
        Of the formation problems.
    workers : int or executor
        As in `simulate`; they share the cells.
    checkpoint, if_exists
        As in `simulate`; every sweep point is saved when it is finished.
    progress : callable, optional
        Called with the number of cells that are done, and of all.

    Raises
    ------
    ScenarioError
        An unknown key, or a key without values.
    PolicyError, CheckpointError, ValueError
        As in `simulate`.
    """
    checked_workers(workers)
    settings = {key: _plain(values) for key, values in settings.items()}
    _require_known(scenario, settings)
    made = distinct_policies(policies, str)
    runs = None if runs is None else int(runs)
    options = Options(runs, int(seed), tolerance, max_states, aggregation_tol, solver)
    cells = [
        SweepPoint(scenario, dict(zip(settings, values, strict=True)), policy, options)
        for values in product(*settings.values())
        for policy in made
    ]
    found: dict[int, dict[str, Any]] = {}
    with ExitStack() as stack:
        store = None
        if checkpoint is not None:
            inputs = _inputs(scenario, settings, [cell.policy_name for cell in cells], options)
            store = stack.enter_context(Checkpoint(checkpoint, inputs, if_exists))
            found = dict(_kept(store, len(cells)))
        left = [place for place in range(len(cells)) if place not in found]
        if workers != 1 and left:
            require_sendable({cell.policy_name: cell for cell in cells})
        for index, row in done_jobs([cells[place] for place in left], workers):
            found[left[index]] = row
            if store is not None:
                store.save(_name(left[index]), {"row": np.array(json.dumps(row))})
            if progress is not None:
                progress(len(found), len(cells))
        if store is not None:
            store.finish()
    rows = [found[place] for place in range(len(cells))]
    effort = pd.DataFrame({"cell": range(len(rows)), "seconds": [row["seconds"] for row in rows]})
    table = pd.DataFrame(
        [cell.identity() | row["found"] for cell, row in zip(cells, rows, strict=True)]
    )
    for name in ("runs", "successes", "states"):
        table[name] = table[name].astype("Int64")
    return Sweep(scenario, tuple(settings), table, effort)


def _plain(values: Sequence[Any]) -> Any:
    """Values as Python's own numbers, so that they can be written as JSON."""
    if isinstance(values, str):
        return values
    return [value.item() if isinstance(value, np.generic) else value for value in values]


def _require_known(scenario: Scenario, settings: Mapping[str, Sequence[Any]]) -> None:
    for key, values in settings.items():
        if isinstance(values, str) or not len(values):
            raise ScenarioError(f"{key} has no values: give a list of them, such as [0.05, 0.1]")
    if "swarm.positions" in settings and DERIVED.keys() & settings.keys():
        raise ScenarioError("swarm.positions cannot be swept together with n or spacing")
    for key in settings.keys() - DERIVED.keys():
        try:
            scenario.with_values({key: settings[key][0]})
        except ScenarioError as error:
            if "no such key" in str(error):
                hint = f"; beyond its keys there are {' and '.join(DERIVED)}"
                raise ScenarioError(f"{error}{hint}") from error


def _inputs(
    scenario: Scenario, settings: Mapping[str, Sequence[Any]], policies: list[str], given: Options
) -> dict[str, Any]:
    return {
        "study": "sweep",
        "scenario": tomllib.loads(scenario.to_toml()),
        "settings": {key: json.loads(json.dumps(list(values))) for key, values in settings.items()},
        "keys": list(settings),  # their order is that of the cells
        "policies": list(dict.fromkeys(policies)),
        "options": vars(given),
        "casswarm": version("casswarm"),
    }


def _kept(store: Checkpoint, cells: int) -> Iterator[tuple[int, dict[str, Any]]]:
    for place in range(cells):
        cell = store.load(_name(place))
        if cell is not None:
            row = json.loads(str(cell["row"]))
            if row["found"]["status"] == "ok":  # what failed is tried again
                yield place, row


def _name(place: int) -> str:
    return f"point-{place:06d}"
