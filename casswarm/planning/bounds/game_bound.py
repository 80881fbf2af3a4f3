"""Bounds from level games: which potential and which grid of levels, for any number of members.

Every choice here gives a valid bound; it is guided by the value of the game in which all members
always have the same level and drop as far as they can, which is nearly optimal.
"""

from __future__ import annotations

import math
import time
from collections.abc import Iterator
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from ...typing import FloatArray
from .grid import Relaxation
from .level_game import LevelGame, look_ups
from .potential import Potential, PotentialFamily

_GROUP = 6  # members of a game
_COARSE_NODES = 1_000_000  # of the potentials that are compared
_LARGEST = np.geomspace(0.06, 0.5, 18)  # drops that are compared, relative to the mean level
_SLOPES = (2.0, 4.0, 8.0, 16.0)  # relative to the mean slope between the members and the target
_LOST_LEVEL = 0.01  # relative loss of level for a small slope
_CELLS = (1, 2, 3, 4, 5, 6, 7, 8, 10, 12, 16, 20, 24, 32, 40, 48, 64)
_STAGE = 30.0  # ratio of work of one stage and the one before
_FIRST_WORK = 1e6


class GameBound(NamedTuple):
    """A bound on the success probability of every policy.

    Parameters
    ----------
    value : float
    limited : bool
        Whether the time limit made it weaker.
    """

    value: float
    limited: bool


class Choice(NamedTuple):
    """Largest drop of a potential and the number of levels in it."""

    largest: float
    cells: int


class Effort(NamedTuple):
    """How much to compute; see `success_bound`.

    Parameters
    ----------
    max_nodes : int
        Maximum number of nodes of a potential, over all steps.
    max_work : float
        Largest number of values that a game looks up, about; finite.
    accuracy : float
        Refine until the bound on the probability of failure rises by less, relatively.
    deadline : float
        Time of `time.monotonic`; no game is begun that is expected to end later.
    """

    max_nodes: int
    max_work: float
    accuracy: float
    deadline: float


def game_bound(
    task: Relaxation, starts: FloatArray, multiplier: float, effort: Effort
) -> GameBound:
    """The least bound of level games of increasing work; 1 if even the smallest needs too much.

    Parameters
    ----------
    task : Relaxation
    starts : (n, 2)
        Initial positions.
    multiplier : float
        Of arrival, as of `StageCosts`.
    effort : Effort
    """
    nearly = replace(task, radius=task.radius * (1 + 1e-9))
    reachable = nearly.reachable(starts, task.steps)
    fine = PotentialFamily(task, starts, effort.max_nodes, multiplier)
    if not reachable.any() or fine.size > effort.max_nodes:
        return GameBound(1.0, limited=False)
    coarse = PotentialFamily(task, starts, min(_COARSE_NODES, effort.max_nodes), multiplier)
    groups = _groups(np.flatnonzero(reachable))
    slope = _slope(coarse, reachable)
    levels = _start_levels(coarse, slope, reachable)
    best, used, seconds = 1.0, 0.0, 0.0
    for work in _stages(effort.max_work):
        choice = _choose(task, len(starts), len(groups[0]), levels, work)
        if choice is None:
            continue
        begun = time.monotonic()
        if begun + (seconds * work / used if used else 0.0) > effort.deadline:
            return GameBound(best, limited=True)
        value = _product(fine.potential(slope, choice.largest), groups, choice.cells)
        seconds, used = time.monotonic() - begun, work
        improved, best = best - value, min(best, value)
        if value < 1.0 and improved < effort.accuracy * (1.0 - value):
            break
    return GameBound(best, limited=False)


def _stages(max_work: float) -> Iterator[float]:
    work = _FIRST_WORK
    while work < max_work:
        yield work
        work *= _STAGE
    yield max_work


def _groups(members: np.ndarray) -> list[np.ndarray]:
    """Members in as few groups as possible, of equal size but for one."""
    return [group for group in np.array_split(members, -(-len(members) // _GROUP)) if len(group)]


def _product(potential: Potential, groups: list[np.ndarray], cells: int) -> float:
    """1 - product of the probabilities that no member of a group arrives, each with all others."""
    failure = 1.0
    for group in groups:
        failure *= 1.0 - LevelGame(potential, cells, tuple(group.tolist())).value()
    return 1.0 - failure * (1 - 1e-12)


def _slope(family: PotentialFamily, reachable: np.ndarray) -> float:
    """A small slope with nearly the levels of a large one."""
    task, starts = family.task, family.starts[reachable]
    distance = float(np.hypot(*(starts - task.center).T).mean())
    level = float(np.mean(family.potential().start_levels[reachable]))
    mean = max(level, 1e-3) / max(distance, task.radius)
    for factor in _SLOPES:
        limited = family.potential(factor * mean).start_levels[reachable]
        if limited.mean() >= (1 - _LOST_LEVEL) * level:
            break
    return factor * mean


def _start_levels(
    family: PotentialFamily, slope: float, reachable: np.ndarray
) -> list[tuple[float, FloatArray]]:
    """Largest drops that may be chosen, and the levels at the start with each."""
    level = float(np.mean(family.potential(slope).start_levels[reachable]))
    drops = [float(drop) for drop in max(level, 1e-3) * _LARGEST]
    return [(drop, family.potential(slope, drop).start_levels[reachable]) for drop in drops]


def _choose(
    task: Relaxation,
    members: int,
    players: int,
    levels: list[tuple[float, FloatArray]],
    work: float,
) -> Choice | None:
    """The largest drop and grid of levels that promise the least bound; None if there is none."""
    choices: list[tuple[float, Choice]] = []
    for largest, starts in levels:
        for cells in _CELLS:
            size = max(2, math.ceil(float(starts.max()) / largest * cells) + 1)
            if look_ups(players, size, cells) <= work:
                effective = largest * (1 + 1.2 / cells**2)  # interpolation acts like larger drops
                value = _together(task, members, float(starts.mean()), effective)
                choices.append((value, Choice(largest, cells)))
    return min(choices)[1] if choices else None


def _together(task: Relaxation, members: int, level: float, largest: float) -> float:
    """Success of members that always have the same level and drop by `largest` in every step."""
    steps = math.floor(level / largest)
    rest = max(level - steps * largest, 0.0)
    value = np.append(0.0, np.ones(members))
    for drop, repeated in ((largest, steps), (rest, 1)):
        transition = np.zeros((members + 1, members + 1))
        transition[0, 0] = 1.0
        for alive in range(1, members + 1):
            least = task.hazard.least_rates(
                alive, np.array([alive - 1.0]), np.array([drop / task.dt])
            )
            assert least is not None
            survival = math.exp(-task.dt * float(least[0, 0]))
            for left in range(alive + 1):
                lost = alive - left
                weight = math.comb(alive, left) * survival**left * (1.0 - survival) ** lost
                transition[alive, left] = weight
        for _ in range(repeated):
            value = transition @ value
    return float(value[-1])
