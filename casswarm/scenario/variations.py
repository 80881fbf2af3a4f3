"""Parameters of a scenario that can be varied: its keys, and two derived ones, n and spacing."""

from __future__ import annotations

import math
import sys
from collections.abc import Callable, Mapping, Sequence
from typing import Any, get_args

import numpy as np

from .._util.text import shown
from ..errors import ScenarioError
from ..typing import FloatArray
from .model import Scenario
from .validation import NO_SUCH_KEY, field_of

_MAX_MEMBERS = 10_000


def with_parameters(scenario: Scenario, values: Mapping[str, Any]) -> Scenario:
    """Copy of the scenario with other values, by key or by a name of `DERIVED`.

    Raises
    ------
    ScenarioError
        Invalid values.
    """
    keys = {key: value for key, value in values.items() if key not in DERIVED}
    try:
        changed = scenario.with_values(keys) if keys else scenario
    except ScenarioError as error:
        if NO_SUCH_KEY not in str(error):
            raise
        hint = f"; beyond its keys there are {' and '.join(DERIVED)}"
        raise ScenarioError(f"{error}{hint}", **vars(error)) from error
    for key in DERIVED:
        if key in values:
            positions = DERIVED[key](changed, values[key])
            changed = changed.with_values({"swarm.positions": positions.tolist()})
    return changed


def value(scenario: Scenario, key: str) -> Any:
    """Value of a parameter; None if the scenario leaves it out."""
    if key == "n":
        return scenario.n
    table, _, leaf = key.partition(".")
    return getattr(scenario.hazard_table if table == "hazard" else getattr(scenario, table), leaf)


def require_default(scenario: Scenario, key: str, part: str) -> None:
    """Raise ScenarioError where a key has a value that a part of the package does not treat.

    Which part treats which key is a table in ``docs/limits.md``, and a test.
    """
    field, present = field_of(key, Scenario), value(scenario, key)
    assert field is not None
    if present != field.default:
        treated = "scenarios without it" if field.default is None else shown(field.default)
        raise ScenarioError(
            f"{key} is {shown(present)}, and {part} treats only {treated} "
            "(docs/limits.md has the parts that treat others)",
            key=key,
            value=present,
            part=part,
        )


def whole_numbers(key: str, values: Sequence[Any]) -> list[Any]:
    """Values of a parameter; if it takes whole numbers only, such as n, they become int.

    Raises
    ------
    ScenarioError
        A fraction for such a parameter.
    """
    field = field_of(key, Scenario)
    if key != "n" and (field is None or not _takes_integers(field.annotation)):
        return list(values)
    for value in values:
        if isinstance(value, float) and not value.is_integer():
            raise ScenarioError(f"{key} takes whole numbers, not {value:g}", key=key, value=value)
    return [int(value) if isinstance(value, float) else value for value in values]


def _takes_integers(annotation: Any) -> bool:
    """True for int, alone or among other types."""
    return annotation is int or any(map(_takes_integers, get_args(annotation)))


def _with_members(scenario: Scenario, n: Any) -> FloatArray:
    """The first n members, or more members at the nearest free points of a triangular lattice.

    The lattice has the spacing of the members, or the target's radius if there is no other.
    """
    positions = scenario.positions
    if scenario.swarm.kind is not None:
        raise ScenarioError(
            "n cannot be varied where swarm.kind gives every member a kind; set swarm.positions "
            "and swarm.kind together",
            key="swarm.kind",
            value=scenario.swarm.kind,
        )
    if not (isinstance(n, int) and not isinstance(n, bool) and 1 <= n <= _MAX_MEMBERS):
        raise ScenarioError(
            f"n = {shown(n)}; allowed: whole numbers from 1 to {_MAX_MEMBERS}", key="n", value=n
        )
    if n <= len(positions):
        return positions[:n]
    spacing = _min_distance(positions) if len(positions) > 1 else 0.0
    spacing = spacing or scenario.target.radius
    reach = math.ceil(math.sqrt(n)) + 2
    steps = np.arange(-2 * reach, 2 * reach + 1)
    i, j = (axis.ravel() for axis in np.meshgrid(steps, steps))
    lattice = np.stack([i + 0.5 * j, 0.75**0.5 * j], axis=1)
    lattice = lattice[np.lexsort((lattice[:, 1], lattice[:, 0], np.hypot(*lattice.T).round(9)))]
    members = list(positions)
    for point in spacing * lattice + positions.mean(axis=0):
        if len(members) == n:
            break
        if np.hypot(*(np.array(members) - point).T).min() > 0.5 * spacing:
            members.append(point)
    return np.array(members)


def _with_spacing(scenario: Scenario, spacing: Any) -> FloatArray:
    """Positions scaled about their centroid."""
    positions = scenario.positions
    if isinstance(spacing, bool) or not (
        isinstance(spacing, (int, float)) and 0 < spacing <= sys.float_info.max
    ):
        raise ScenarioError(
            f"spacing = {shown(spacing)}; allowed: finite numbers above 0",
            key="spacing",
            value=spacing,
        )
    if len(positions) < 2 or _min_distance(positions) == 0:
        raise ScenarioError(
            "spacing needs at least two members, at distinct positions", key="spacing"
        )
    center = positions.mean(axis=0)
    return np.asarray(center + (positions - center) * (spacing / _min_distance(positions)))


def _min_distance(positions: FloatArray) -> float:
    """Smallest distance between two members."""
    distances = np.hypot(*(positions[:, None] - positions[None]).transpose(2, 0, 1))
    return float(distances[~np.eye(len(positions), dtype=bool)].min())


DERIVED: dict[str, Callable[[Scenario, Any], FloatArray]] = {
    "n": _with_members,
    "spacing": _with_spacing,
}
"""Parameters that are not keys of a scenario."""
