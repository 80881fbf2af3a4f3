"""Contradictions and doubts in a scenario, whose keys are valid one by one."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from .._util.numbers import CORE_FRACTION
from .._util.text import counted
from .._util.user_code import USER_ERRORS
from . import members
from .hazard_table import HazardTable, of_cases
from .sections import MOST_STEPS, Disc, GuideOptions, Swarm, Target, Time
from .validation import as_text

if TYPE_CHECKING:
    from .model import Scenario

_MAX_DECADE = 150  # the square of a rate must not overflow
_ROUNDING = 1e-9


def core_radius(target: Target, hazard: HazardTable) -> float:
    """Distance below which the rates of built-in kinds are regularised."""
    return CORE_FRACTION * target.radius if hazard.core_radius is None else hazard.core_radius


def contradictions(
    scenario: Scenario, folder: Path | None = None, allow_code: bool = False
) -> Iterator[str]:
    """Contradictions in a scenario of a file in `folder`; `allow_code` as of `load_scenario`."""
    if kinds := list(members.problems(scenario)):
        yield from kinds  # without which nothing is known about members
        return
    arriving = int(scenario.swarm.counting.sum())
    if scenario.success.arrivals > arriving:
        yield (
            f"success.arrivals is {scenario.success.arrivals}, but there "
            f"{'is' if arriving == 1 else 'are'} {counted(arriving, 'member')}"
            f"{'' if arriving == scenario.n else ' that count (swarm.kinds)'}; lower it or add "
            "members"
        )
    swarm, target = scenario.swarm, scenario.target
    yield from of_cases(scenario.hazard_table, partial(_start_problems, swarm, target))
    yield from _reach_problems(scenario.swarm, scenario.target, scenario.time)
    yield from _margin_problems(scenario.guide, scenario.target)
    yield from _overlaps(scenario.target)
    yield from of_cases(scenario.hazard_table, partial(_collision_problems, target))
    yield from of_cases(scenario.hazard_table, partial(_zone_problems, swarm))
    custom = partial(_custom_hazard_problems, scenario, folder, allow_code)
    yield from of_cases(scenario.hazard_table, custom)


def doubts(scenario: Scenario) -> Iterator[str]:
    """Yield doubts about settings that are allowed in a scenario, but hardly meant."""
    return of_cases(scenario.hazard_table, partial(_doubts, scenario.swarm, scenario.target))


def _doubts(swarm: Swarm, target: Target, hazard: HazardTable) -> Iterator[str]:
    for first, second in _equal_points(hazard.radars):  # radars in time may take turns
        yield f"hazard.radars[{first}] and [{second}] are the same point: their rates are added"
    for k, zone in enumerate(hazard.zone):
        if any(zone.contains(disc.center) for disc in target.discs):
            yield f"hazard.zone[{k}] contains a target's centre, where members arrive"
    for k, inside in enumerate(target.contains(np.reshape(hazard.starts, (-1, 2)))):
        if inside:
            yield f"hazard.radars[{k}] lies in the target zone, where members must arrive"
    if hazard.beta_1 is not None:
        for first, second in _equal_points(swarm.positions):
            yield (
                f"swarm.positions[{first}] and [{second}] are the same point: these members "
                "collide from the start"
            )


def _equal_points(points: Sequence[tuple[float, float]]) -> Iterator[tuple[int, int]]:
    """Indices of every point that an earlier one equals, and of the first such."""
    seen: dict[tuple[float, float], int] = {}
    for index, point in enumerate(points):
        first = seen.setdefault(point, index)
        if first != index:
            yield first, index


def _start_problems(swarm: Swarm, target: Target, hazard: HazardTable) -> Iterator[str]:
    """Members that start inside a radar or in the target zone, or faster than they can move."""
    apart = core_radius(target, hazard)
    places = {f"hazard.radars[{k}]": center for k, center in enumerate(hazard.radars)}
    places |= {f"hazard.radar[{k}]": radar.start for k, radar in enumerate(hazard.radar)}
    for i, position in enumerate(swarm.positions):
        for name, center in places.items():
            if math.dist(position, center) < apart:
                yield (
                    f"swarm.positions[{i}] is {as_text(list(position))}, on "
                    f"{name}; move one of them, {apart:g} or more apart "
                    "(hazard.core_radius)"
                )
    for i, inside in enumerate(target.contains(np.array(swarm.positions))):
        if inside:
            yield (
                f"swarm.positions[{i}] is {as_text(list(swarm.positions[i]))}, inside the target "
                "zone; every member must start outside: move it or the target"
            )
    if swarm.velocity == "guide":
        return
    disc = swarm.speed == "disc"
    speed = math.hypot(*swarm.velocity) if disc else max(map(abs, swarm.velocity))
    v_max = min(kind.v_max or math.inf for kind in swarm.member_kinds)
    if speed > v_max:
        what = "its length" if disc else "each component"
        whose = "swarm.v_max" if v_max == swarm.v_max else "v_max of a kind"
        yield (
            f"swarm.velocity is {as_text(list(swarm.velocity))}; {what} may be at most "
            f"{whose} = {v_max:g}: lower the velocity or raise v_max"
        )


def _reach_problems(swarm: Swarm, target: Target, time: Time) -> Iterator[str]:
    """Too few or too many steps, or a target that is out of reach in all of them."""
    horizon = f"time.t_f is {time.t_f:g} with dt = {time.dt:g}"
    if time.steps < 1:
        yield f"{horizon}, less than one step; raise t_f to {time.dt:g} or more, or lower dt"
        return
    if time.steps > MOST_STEPS:
        yield f"{horizon}, {time.steps:g} steps; at most {MOST_STEPS} are allowed, raise dt"
        return
    if time.steps * time.substeps > MOST_STEPS:
        yield (
            f"time.substeps is {time.substeps} in each of {counted(time.steps, 'step')}; at most "
            f"{MOST_STEPS} parts are allowed in all, lower it"
        )
    start, step = np.array(swarm.positions[swarm.central_member]), time.dt * _speed(swarm)
    nearest = min(target.discs, key=partial(_distance, swarm, start))
    if not in_reach(swarm, time, nearest):
        distance = _distance(swarm, start, nearest)
        along = "" if swarm.speed == "disc" else " along an axis"
        needed = math.ceil(distance / step * (1 - _ROUNDING))
        yield (
            f"target.center is {as_text(list(nearest.center))}, out of reach: from the guide's "
            f"start {as_text(start.tolist())} the distance{along} is {distance:.6g}, and "
            f"{counted(time.steps, 'step')} of dt * v_max = {step:.6g} cover "
            f"{time.steps * step:.6g}; the fastest path takes {counted(needed, 'step')}: raise "
            f"time.t_f to {needed * time.dt:.6g} or more, or swarm.v_max, or move the target nearer"
        )


def in_reach(swarm: Swarm, time: Time, target: Disc) -> bool:
    """True if the guide can arrive in a target zone in time, but for rounding."""
    distance = _distance(swarm, np.array(swarm.positions[swarm.central_member]), target)
    return distance <= time.steps * time.dt * _speed(swarm) * (1 + _ROUNDING)


def _speed(swarm: Swarm) -> float:
    """Largest speed of the guide, that of the member with which it starts."""
    return swarm.member_kinds[swarm.central_member].v_max or swarm.v_max


def _distance(swarm: Swarm, start: NDArray[np.float64], target: Disc) -> float:
    """Length that a path to a target zone has at least, in the norm that v_max bounds."""
    if swarm.speed == "disc":
        return float(target.distances(start)) - target.radius
    return _axis_distance(start, target)


def _axis_distance(start: NDArray[np.float64], target: Disc) -> float:
    """Smallest r for which the square start + [-r, r]^2 meets the target zone.

    Velocities are bounded by component, so the set of reachable positions is a square.
    """
    far, near = sorted(np.abs(np.array(target.center) - start), reverse=True)
    if far - near >= target.radius:  # a side of the square touches the disc
        return float(far - target.radius)
    # otherwise a corner (far - r, near - r) from the centre does, at distance `radius`
    return max(0.0, float(far + near - math.sqrt(2 * target.radius**2 - (far - near) ** 2)) / 2)


def _margin_problems(guide: GuideOptions, target: Target) -> Iterator[str]:
    """A margin that is not smaller than the target zones."""
    least = min(disc.radius for disc in target.discs)
    if guide.margin is not None and guide.margin >= least:
        yield (
            f"guide.margin is {guide.margin:g}; it must be below target.radius = {least:g}, or "
            "omit it"
        )


def _overlaps(target: Target) -> Iterator[str]:
    """Target zones that overlap, in which it is not clear what was meant."""
    for second, disc in enumerate(target.other):
        for first, earlier in enumerate(target.discs[: second + 1], -1):
            if math.dist(disc.center, earlier.center) < disc.radius + earlier.radius:
                name = "target" if first < 0 else f"target.other[{first}]"
                yield f"target.other[{second}] overlaps {name}; move one of them, or remove it"


def _collision_problems(target: Target, hazard: HazardTable) -> Iterator[str]:
    """Rates of members at one point that are too large to compute with."""
    if hazard.beta_1 is None or hazard.beta_2 is None:
        return
    core = core_radius(target, hazard)
    if hazard.beta_2 * math.log10(math.sqrt(2) * hazard.beta_1 / core) > _MAX_DECADE:
        yield (
            f"hazard.beta_2 is {hazard.beta_2:g} with beta_1 = {hazard.beta_1:g}: the rate of "
            f"members that touch exceeds 1e{_MAX_DECADE}; lower one of them, or raise "
            f"hazard.core_radius = {core:g}"
        )


def _zone_problems(swarm: Swarm, hazard: HazardTable) -> Iterator[str]:
    """Members that start in a zone."""
    for k, table in enumerate(hazard.zone):
        if any(table.problems("")):
            continue  # which are reported by the table
        for i, position in enumerate(swarm.positions):
            if table.contains(position):
                yield (
                    f"hazard.zone[{k}] contains swarm.positions[{i}] = {as_text(list(position))}; "
                    "members must start outside: move one of them"
                )


def _custom_hazard_problems(
    scenario: Scenario, folder: Path | None, allow_code: bool, hazard: HazardTable
) -> Iterator[str]:
    """A function of the user that may not be run, cannot be imported, or fails at the start."""
    if not hazard.is_custom:
        return
    subject = f"hazard.kind is {as_text(hazard.kind)}"
    if hazard.is_named_by_file and not allow_code:
        yield f"{subject}{_consent(str(hazard.kind), folder)}"
        return
    try:
        built = hazard.build(core_radius(scenario.target, hazard), folder, scenario.time.dt)
        built.after(1).rates(scenario.positions)
    except USER_ERRORS as error:  # the user's code may raise anything
        yield f"{subject}: {' '.join(str(error).split()) or type(error).__name__}"


def _consent(kind: str, folder: Path | None) -> str:
    """Request for the user's consent before code that a file names is imported."""
    from ..hazard.custom import missing, origin

    code = f"the module {kind.partition(':')[0]!r}" if folder is None else origin(kind, folder)
    if code is None:
        return f": {missing(kind, folder)}"  # type: ignore[arg-type]
    return (
        f", which is code in {code}. It is not run without consent: read it, and if you trust it, "
        "allow it by --allow-code, in Python by load_scenario(..., allow_code=True)"
    )
