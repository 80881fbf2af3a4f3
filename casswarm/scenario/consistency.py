"""Consistency of the tables of a scenario: a message for every contradiction."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from .._util.numbers import CORE_FRACTION
from .._util.text import counted
from .._util.user_code import USER_ERRORS
from .sections import GuideOptions, HazardTable, Swarm, Target, Time
from .validation import as_text

if TYPE_CHECKING:
    from .model import Scenario

_MAX_STEPS = 100_000
_MAX_DECADE = 150  # the square of a rate must not overflow
_ROUNDING = 1e-9


def core_radius(target: Target, hazard: HazardTable) -> float:
    """Distance below which the rates of built-in kinds are regularised."""
    return CORE_FRACTION * target.radius if hazard.core_radius is None else hazard.core_radius


def problems(
    scenario: Scenario, folder: Path | None = None, allow_code: bool = False
) -> Iterator[str]:
    """What contradicts itself in a scenario of a file in `folder`; `allow_code` as there."""
    yield from _start_problems(scenario.swarm, scenario.target, scenario.hazard_table)
    yield from _reach_problems(scenario.swarm, scenario.target, scenario.time)
    yield from _margin_problems(scenario.guide, scenario.target)
    yield from _collision_problems(scenario.target, scenario.hazard_table)
    yield from _custom_hazard_problems(scenario, folder, allow_code)


def doubts(scenario: Scenario) -> Iterator[str]:
    """What is allowed in a scenario, but hardly meant."""
    hazard, target = scenario.hazard_table, scenario.target
    for first, second in _equal_points(hazard.radars):
        yield f"hazard.radars[{first}] and [{second}] are the same point: their rates are added"
    for k, inside in enumerate(target.contains(scenario.hazard.radar_positions)):
        if inside:
            yield f"hazard.radars[{k}] lies in the target zone, where members must arrive"
    if hazard.beta_1 is not None:
        for first, second in _equal_points(scenario.swarm.positions):
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
    for i, position in enumerate(swarm.positions):
        for radar, center in enumerate(hazard.radars):
            if math.dist(position, center) < apart:
                yield (
                    f"swarm.positions[{i}] is {as_text(list(position))}, on "
                    f"hazard.radars[{radar}]; move one of them, {apart:g} or more apart "
                    "(hazard.core_radius)"
                )
    for i, inside in enumerate(target.contains(np.array(swarm.positions))):
        if inside:
            yield (
                f"swarm.positions[{i}] is {as_text(list(swarm.positions[i]))}, inside the target "
                "zone; every member must start outside: move it or the target"
            )
    if swarm.velocity != "guide" and max(map(abs, swarm.velocity)) > swarm.v_max:
        yield (
            f"swarm.velocity is {as_text(list(swarm.velocity))}; each component may be at most "
            f"swarm.v_max = {swarm.v_max:g}: lower the velocity or raise v_max"
        )


def _reach_problems(swarm: Swarm, target: Target, time: Time) -> Iterator[str]:
    """Too few or too many steps, or a target that is out of reach in all of them."""
    horizon = f"time.t_f is {time.t_f:g} with dt = {time.dt:g}"
    if time.steps < 1:
        yield f"{horizon}, less than one step; raise t_f to {time.dt:g} or more, or lower dt"
        return
    if time.steps > _MAX_STEPS:
        yield f"{horizon}, {time.steps:g} steps; at most {_MAX_STEPS} are allowed, raise dt"
        return
    start = np.array(swarm.positions[swarm.central_member])
    distance = axis_distance(start, target)
    step = time.dt * swarm.v_max
    if distance > time.steps * step * (1 + _ROUNDING):
        needed = math.ceil(distance / step * (1 - _ROUNDING))
        yield (
            f"target.center is {as_text(list(target.center))}, out of reach: from the guide's "
            f"start {as_text(start.tolist())} the distance along an axis is {distance:.6g}, and "
            f"{counted(time.steps, 'step')} of dt * v_max = {step:.6g} cover "
            f"{time.steps * step:.6g}; the fastest path takes {counted(needed, 'step')}: raise "
            f"time.t_f to {needed * time.dt:.6g} or more, or swarm.v_max, or move the target nearer"
        )


def axis_distance(start: NDArray[np.float64], target: Target) -> float:
    """Smallest r for which the square start + [-r, r]^2 meets the target zone.

    Velocities are bounded by component, so the set of reachable positions is a square.
    """
    far, near = sorted(np.abs(np.array(target.center) - start), reverse=True)
    if far - near >= target.radius:  # a side of the square touches the disc
        return float(far - target.radius)
    # otherwise a corner (far - r, near - r) from the centre does, at distance `radius`
    return max(0.0, float(far + near - math.sqrt(2 * target.radius**2 - (far - near) ** 2)) / 2)


def _margin_problems(guide: GuideOptions, target: Target) -> Iterator[str]:
    """A margin that is not smaller than the target zone."""
    if guide.margin is not None and guide.margin >= target.radius:
        yield (
            f"guide.margin is {guide.margin:g}; it must be below target.radius = "
            f"{target.radius:g}, or omit it"
        )


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


def _custom_hazard_problems(
    scenario: Scenario, folder: Path | None, allow_code: bool
) -> Iterator[str]:
    """A function of the user that may not be run, cannot be imported, or fails at the start."""
    hazard = scenario.hazard_table
    if not hazard.is_custom:
        return
    subject = f"hazard.kind is {as_text(hazard.kind)}"
    if hazard.is_named_by_file and not allow_code:
        yield f"{subject}{_consent(str(hazard.kind), folder)}"
        return
    try:
        built = hazard.build(core_radius(scenario.target, hazard), folder)
        built.rates(scenario.positions)
    except USER_ERRORS as error:  # the user's code may raise anything
        yield f"{subject}: {' '.join(str(error).split()) or type(error).__name__}"


def _consent(kind: str, folder: Path | None) -> str:
    """What is asked of the user before code that a file names is imported."""
    from ..hazard.custom import missing, origin

    code = f"the module {kind.partition(':')[0]!r}" if folder is None else origin(kind, folder)
    if code is None:
        return f": {missing(kind, folder)}"  # type: ignore[arg-type]
    return (
        f", which is code in {code}. It is not run without consent: read it, and if you trust it, "
        "allow it by --allow-code, in Python by load_scenario(..., allow_code=True)"
    )
