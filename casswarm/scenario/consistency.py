"""What must hold between the tables of a scenario: a line for each thing that does not."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from .._util.constants import CORE_RADIUS
from .hazard_section import HazardTable
from .sections import GuideOptions, Swarm, Target, Time
from .validation import shown

_MAX_STEPS = 100_000
_ROUNDING = 1e-9


def start_problems(swarm: Swarm, target: Target, hazard: HazardTable) -> list[str]:
    """Members that start inside a radar or in the target zone, or faster than they can move."""
    lines = []
    positions = np.array(swarm.positions)
    for i, position in enumerate(swarm.positions):
        for radar, place in enumerate(hazard.radars):
            if math.dist(position, place) < CORE_RADIUS:
                lines.append(
                    f"swarm.positions[{i}] is {shown(list(position))}, on hazard.radars[{radar}]; "
                    f"move one of them, {CORE_RADIUS:g} or more apart"
                )
    lines += [
        f"swarm.positions[{i}] is {shown(list(swarm.positions[i]))}, in the target zone already; "
        "every member must start outside, move it or the target"
        for i in np.flatnonzero(target.distances(positions) <= target.radius)
    ]
    if swarm.velocity != "guide" and max(map(abs, swarm.velocity)) > swarm.v_max:
        lines.append(
            f"swarm.velocity is {shown(list(swarm.velocity))}; each component may be at most "
            f"swarm.v_max = {swarm.v_max:g}: lower the velocity or raise v_max"
        )
    return lines


def way_problems(swarm: Swarm, target: Target, time: Time) -> list[str]:
    """Too few or too many steps, or a target that is out of reach in all of them."""
    given = f"time.t_f is {time.t_f:g} with dt = {time.dt:g}"
    if time.steps < 1:
        return [f"{given}, less than one step; raise t_f to {time.dt:g} or more, or lower dt"]
    if time.steps > _MAX_STEPS:
        return [f"{given}, {time.steps:g} steps; at most {_MAX_STEPS} are allowed, raise dt"]
    start = np.array(swarm.positions[swarm.central_member])
    way = shortest_way(start, target)
    reach = time.steps * time.dt * swarm.v_max
    if way <= reach * (1 + _ROUNDING):
        return []
    needed = math.ceil(way / (time.dt * swarm.v_max) * (1 - _ROUNDING))
    distance = math.dist(start, target.center)
    return [
        f"target.center is {shown(list(target.center))}, out of reach: at distance {distance:.6g} "
        f"from the guide's start {shown(start.tolist())}, {way:.6g} to go along an axis, where "
        f"{time.steps} steps of dt * v_max = {time.dt * swarm.v_max:.6g} go {reach:.6g}; the "
        f"shortest possible way takes {needed} steps: raise time.t_f to {needed * time.dt:.6g} or "
        "more, or swarm.v_max, or move the target nearer"
    ]


def shortest_way(start: NDArray[np.float64], target: Target) -> float:
    """Least r such that the square start + [-r, r]^2 meets the target zone.

    Velocities are bounded by component, so that the places within reach are a square.
    """
    far, near = sorted(np.abs(np.array(target.center) - start), reverse=True)
    if far - near >= target.radius:  # a side of the square touches the disc
        return float(far - target.radius)
    # else a corner (far - r, near - r) from the centre does, at distance `radius`
    return max(0.0, float(far + near - math.sqrt(2 * target.radius**2 - (far - near) ** 2)) / 2)


def margin_problems(guide: GuideOptions, target: Target) -> list[str]:
    """Arrival deeper inside the target zone than the zone is."""
    if guide.margin is None or guide.margin < target.radius:
        return []
    return [
        f"guide.margin is {guide.margin:g}; it must be below target.radius = {target.radius:g}, "
        "or leave it out"
    ]


def custom_hazard_problems(swarm: Swarm, hazard: HazardTable, folder: Path | None) -> list[str]:
    """Users' function that cannot be imported, or fails at the initial state."""
    if not hazard.is_custom:
        return []
    positions = np.array(swarm.positions)
    try:
        hazard.build(folder).rates(positions, np.ones(len(positions), dtype=bool))
    except Exception as error:  # the user's code may raise anything
        reason = " ".join(str(error).split()) or type(error).__name__
        looked = f" (looked for in the folder {folder} first)" if folder else ""
        return [f"hazard.kind is {shown(hazard.kind)}: {reason}{looked}"]
    return []
