"""Hazards that are not known: the cases of a scenario, one of which is the true one.

A scenario with `[[hazard.case]]` is a family of scenarios that differ by their hazards, with a
prior over them. Each is an ordinary scenario; parts that treat one hazard refuse the family.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from .._util.text import counted
from ..errors import ScenarioError
from .consistency import core_radius
from .hazard_table import HazardTable

if TYPE_CHECKING:
    from .model import Scenario

_EQUAL = ("kind", "alpha_2", "alpha_3", "beta_1", "beta_2")


class Case(NamedTuple):
    """One of the hazards that may be the true one.

    Parameters
    ----------
    weight : float
        Prior probability.
    scenario : Scenario
        The scenario with this hazard.
    """

    weight: float
    scenario: Scenario


def cases_of(scenario: Scenario) -> tuple[Case, ...]:
    """The distinct cases of a scenario in their order, equal ones as one; itself if it has none."""
    table = scenario.hazard_table
    weights = [case.weight for case in table.case] or [1.0]
    found: dict[HazardTable, float] = {}
    for own, weight in zip(table.cases, weights, strict=True):
        found[own] = found.get(own, 0.0) + weight
    total = sum(weights)
    return tuple(
        Case(weight / total, scenario.with_hazard_table(own) if table.case else scenario)
        for own, weight in found.items()
    )


def weighted(scenario: Scenario, weights: ArrayLike) -> HazardTable:
    """Hazard with other weights (K,) of its K distinct cases, without those of weight 0."""
    table = scenario.hazard_table
    possible = np.flatnonzero(weights)
    if len(possible) == 1:
        return scenario.cases[int(possible[0])].scenario.hazard_table
    own = dict(zip(reversed(table.cases), reversed(table.case), strict=True))
    cases = tuple(
        own[case.scenario.hazard_table].model_copy(update={"weight": float(weight)})
        for case, weight in zip(scenario.cases, np.asarray(weights, float), strict=True)
        if weight > 0
    )
    return table.model_copy(update={"case": cases})


def require_known(scenario: Scenario, part: str = "this") -> None:
    """Raise ScenarioError for a scenario with several cases, which a part does not treat."""
    if (count := len(scenario.cases)) > 1:
        raise ScenarioError(
            f"scenario '{scenario.name}' has {count} cases of its hazard (hazard.case), and {part} "
            "treats only a hazard that is known: take one of them, scenario.cases[k].scenario, "
            "their mean rates, scenario.believed, or plan a mixture of guides with ambiguity= "
            "(casswarm plan --ambiguity)",
            key="hazard.case",
            value=count,
        )


def radars_text(table: HazardTable) -> str:
    """Number of radars of a hazard, or of each of its cases, as text."""
    counts = [len(each.starts) for each in table.cases]
    least, most = min(counts), max(counts)
    number = counted(most, "radar") if least == most else f"{least} to {most} radars"
    return number if len(counts) == 1 else f"{number} in each of {len(counts)} cases"


def mean_table(scenario: Scenario, weights: ArrayLike) -> HazardTable:
    """Hazard whose rates are the weighted means of those of the K cases.

    Single-agent rates of the built-in kinds are sums over radars and zones, so they are those of
    all cases together, with strengths and zones' rates times the weights. Other means, of rates of
    users and of other constants, are computed as such: `casswarm.hazard.MeanHazard`.
    """
    tables = [case.scenario.hazard_table for case in scenario.cases]
    parts = [
        (t, float(w)) for t, w in zip(tables, np.asarray(weights, float), strict=True) if w > 0
    ]
    first = parts[0][0]
    if len(parts) == 1:
        return first
    cores = {core_radius(scenario.target, table) for table in tables}
    differ = [key for key in _EQUAL if len({getattr(table, key) for table, _ in parts}) > 1]
    if differ or len(cores) > 1 or first.is_custom:
        return _computed_mean(scenario, parts)
    alpha = first.alpha_1 or 1.0
    merged: dict[str, list[Any]] = {"radars": [], "strengths": [], "radar": [], "zone": []}
    for table, weight in parts:
        factor = weight * (table.alpha_1 or 1.0) / alpha
        merged["radars"] += table.radars
        merged["strengths"] += [factor * s for s in table.strengths or (1.0,) * len(table.radars)]
        merged["radar"] += [_scaled(radar, "strength", factor) for radar in table.radar]
        merged["zone"] += [_scaled(zone, "rate", weight) for zone in table.zone]
    lists = {key: tuple(values) for key, values in merged.items()}
    lists["strengths"] = lists["strengths"] or None  # type: ignore[assignment]
    return HazardTable.model_construct(**first.given | {"core_radius": cores.pop()} | lists)


def _computed_mean(scenario: Scenario, parts: Sequence[tuple[HazardTable, float]]) -> HazardTable:
    """Hazard of the mean of hazards of any kinds."""
    from ..hazard import MeanHazard  # imports CasADi

    folder, dt = scenario._context.get("folder"), scenario.time.dt
    hazards = [table.build(core_radius(scenario.target, table), folder, dt) for table, _ in parts]
    total = sum(weight for _, weight in parts)
    shares = tuple(weight / total for _, weight in parts)
    given = {"hazards": tuple(hazards), "weights": shares}
    return HazardTable.model_construct(kind=MeanHazard, parameters=given)


def _scaled(table: Any, key: str, factor: float) -> Any:
    """A radar or zone with a value times a factor."""
    return table.model_copy(update={key: factor * getattr(table, key)})
