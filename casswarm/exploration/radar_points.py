"""Radars as points that are dragged, also where not every case of a hazard has all of them.

A radar of all cases is a point of its own. One of some cases only belongs to a cloud, a radar whose
place is not known: no case has two radars of a cloud, and they move together.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, NamedTuple

if TYPE_CHECKING:
    from ..scenario import Scenario
    from ..scenario.hazard_table import HazardKeys
    from ..scenario.radars import Radar

_LISTS = ("radars", "radar")  # keys of a hazard with radars


class _Key(NamedTuple):
    """What radars of several cases have in common if they are one."""

    name: str  # of `_LISTS`
    radar: tuple[float, float] | Radar
    number: int  # among equal ones

    @property
    def start(self) -> tuple[float, float]:
        return self.radar if isinstance(self.radar, tuple) else self.radar.start

    def value_at(self, position: tuple[float, float]) -> Any:
        """The value in its list if it starts at another position."""
        return position if isinstance(self.radar, tuple) else self.radar.moved_to(position)


@dataclass(frozen=True)
class RadarPoint:
    """A radar of one or several cases.

    Parameters
    ----------
    position : (float, float)
        At time 0.
    table : Radar or None
        Of a radar that moves or switches.
    cases : tuple of int
        The distinct cases of the scenario that have it.
    cloud : int or None
        Number of its cloud; None if all cases have it.
    """

    position: tuple[float, float]
    table: Radar | None
    cases: tuple[int, ...]
    cloud: int | None


def _keys(table: HazardKeys) -> Iterator[_Key]:
    """Radars of a table, in their order."""
    seen: Counter[tuple[str, object]] = Counter()
    for name in _LISTS:
        for radar in getattr(table, name):
            yield _Key(name, radar, seen[name, radar])
            seen[name, radar] += 1


def _by_cases(scenario: Scenario) -> dict[_Key, tuple[int, ...]]:
    """Cases that have each radar; the radars in the order of the first case, then the others'."""
    found: dict[_Key, tuple[int, ...]] = {}
    for number, case in enumerate(scenario.cases):
        for key in _keys(case.scenario.hazard_table):
            found[key] = (*found.get(key, ()), number)
    return found


def _clouds(found: dict[_Key, tuple[int, ...]], count: int) -> dict[_Key, int]:
    """Clouds of the radars that not all cases have: the first one without a case in common."""
    taken: list[set[int]] = []
    clouds = {}
    for key, cases in found.items():
        if len(cases) == count:
            continue
        free = (number for number, others in enumerate(taken) if others.isdisjoint(cases))
        clouds[key] = number = next(free, len(taken))
        if number == len(taken):
            taken.append(set())
        taken[number].update(cases)
    return clouds


def radar_points(scenario: Scenario) -> tuple[RadarPoint, ...]:
    """Radars of a scenario; of one whose hazard is known, in their order."""
    found = _by_cases(scenario)
    clouds = _clouds(found, len(scenario.cases))
    return tuple(
        RadarPoint(
            key.start,
            None if isinstance(key.radar, tuple) else key.radar,
            cases,
            clouds.get(key),
        )
        for key, cases in found.items()
    )


def with_radar_at(
    scenario: Scenario, index: int, position: tuple[float, float]
) -> dict[str, object]:
    """Values by key with a radar of `radar_points` at another position, and its cloud with it."""
    found = _by_cases(scenario)
    clouds, chosen = _clouds(found, len(scenario.cases)), list(found)[index]
    cloud = clouds.get(chosen)
    moving = {chosen} if cloud is None else {key for key in found if clouds.get(key) == cloud}
    places = {
        key: tuple(p + (s - q) for p, s, q in zip(position, key.start, chosen.start, strict=True))
        for key in moving
    }
    table = scenario.hazard_table
    values: dict[str, object] = {
        f"hazard.{name}": value for name, value in _moved(table, places).items()
    }
    if table.case:
        cases = [{"weight": c.weight} | c.given | _moved(c, places) for c in table.case]
        values["hazard.case"] = cases
    return values


def _moved(table: HazardKeys, places: dict[_Key, Any]) -> dict[str, Sequence[Any]]:
    """Lists of a table of which a radar moves."""
    values: dict[str, Sequence[Any]] = {}
    for name in _LISTS:
        keys = [key for key in _keys(table) if key.name == name]
        if not places.keys().isdisjoint(keys):
            values[name] = [key.value_at(places.get(key, key.start)) for key in keys]
    return values
