"""Scenarios small enough for brute force, and independent implementations of the rates."""

from __future__ import annotations

import math
from collections.abc import Sequence

import casadi as ca
import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import minimum_filter

from casswarm import Scenario

Array = NDArray[np.float64]
Point = tuple[float, float]

DT, V_MAX, ALPHA = 0.33, 2.0, (4.0, 3.0, 4.0)  # Table I


def small(
    positions: Sequence[Point],
    target: Point,
    radars: Sequence[Point],
    steps: int,
    **values: object,
) -> Scenario:
    """A scenario with Table I's numbers; `values` by dotted key, the dot written as two
    underscores.
    """
    data = {
        "name": "small",
        "swarm": {"positions": positions, "v_max": V_MAX, "a_max": 0.5},
        "target": {"center": target, "radius": 0.5},
        "time": {"dt": DT, "t_f": steps * DT},
        "hazard": {
            "kind": "saturation",
            "radars": radars,
            "alpha_1": ALPHA[0],
            "alpha_2": ALPHA[1],
            "alpha_3": ALPHA[2],
        },
    }
    scenario = Scenario.from_data(data)
    return scenario.with_values({key.replace("__", "."): v for key, v in values.items()})


def three_members(**values: object) -> Scenario:
    """Three members and a radar beside their way, in twelve steps; `values` as in `small`."""
    positions = [(0.0, 0.0), (0.3, 0.2), (-0.2, 0.3)]
    return small(positions, (3.0, 0.0), [(1.5, 0.8)], 12, **values)


def colliding(scenario: Scenario) -> Scenario:
    """The scenario with rates that grow where members are close."""
    values = {"kind": "saturation+collision", "beta_1": 0.2, "beta_2": 6.0}
    return scenario.with_values({f"hazard.{key}": value for key, value in values.items()})


ON_THE_WAY = [(1.3, 0.7), (2.1, -0.9)]


def pair(steps: int = 4, **values: object) -> Scenario:
    """Two members close to one another, and two radars on their way; `values` as in `small`."""
    return small([(0.0, 0.0), (0.2, 0.3)], (2.0, 0.4), ON_THE_WAY, steps, **values)


BESIDE = [(1.0, 0.9), (2.2, -0.8)]
"""Radars on both sides of the way of `abreast`."""


def abreast(n: int, steps: int = 8, **values: object) -> Scenario:
    """One to three members on their way between two radars; `values` as in `small`."""
    return small([(0.0, 0.0), (0.4, 0.1), (-0.2, 0.4)][:n], (3.0, 0.2), BESIDE, steps, **values)


def around(rng: np.random.Generator, n: int, spread: float = 0.4) -> list[Point]:
    """Random positions around the origin."""
    return [(float(x), float(y)) for x, y in rng.uniform(-spread, spread, (n, 2))]


def image(
    scenario: Scenario,
    matrix: Array,
    order: Sequence[int] | None = None,
    shift: tuple[float, float] = (0.0, 0.0),
) -> Scenario:
    """The scenario with its axes mapped, moved by `shift`, and its members in another order."""
    members = scenario.positions if order is None else scenario.positions[order]
    velocity = scenario.swarm.velocity

    def mapped(points: Array) -> Array:
        return np.asarray(points) @ matrix.T + shift

    return scenario.with_values(
        {
            "hazard.zone": [zone.mapped(mapped) for zone in scenario.hazard_table.zone],
            "swarm.positions": members @ matrix.T + shift,
            "swarm.velocity": velocity if velocity == "guide" else matrix @ np.array(velocity),
            "target.center": matrix @ np.array(scenario.target.center) + shift,
            "hazard.radars": np.array(scenario.hazard_table.radars) @ matrix.T + shift,
        }
    )


def rate_by_hand(
    member: int, positions: Array, alive: Sequence[bool], radars: Sequence[Point]
) -> float:
    """Equation (8), loop by loop, for a living member away from the radars' cores."""
    x, y = positions[member]
    density = sum(
        1 / (1 + ALPHA[2] * ((x - u) ** 2 + (y - v) ** 2))
        for (u, v), living in zip(positions, alive, strict=True)
        if living
    )
    strength = sum(ALPHA[0] / ((x - u) ** 2 + (y - v) ** 2) for u, v in radars)
    return strength / (1 + ALPHA[1] * density)


def single_agent_rate_by_hand(x: float, y: float, radars: Sequence[Point]) -> float:
    """Rate of an isolated agent: equation (8) with the density of the agent itself, h = 1."""
    return sum(ALPHA[0] / (1 + ALPHA[1]) / math.dist((x, y), radar) ** 2 for radar in radars)


def patrolled(
    positions: ca.MX,
    alive: ca.MX,  # noqa: ARG001
    radars: Sequence[Point] = (),
    background: float = 0.1,
) -> ca.MX:
    """Background rate, which penalises time, with a peak at every radar."""
    humps = sum(
        1 / (0.1 + (positions[:, 0] - x) ** 2 + (positions[:, 1] - y) ** 2) for x, y in radars
    )
    return background + humps + 0 * positions[:, 0]


def least_patrolled(
    lower: Array, upper: Array, radars: Sequence[Point] = (), background: float = 0.1
) -> Array:
    total = np.full(lower.shape[:-1], background)
    for radar in radars:
        farthest = np.maximum(np.abs(lower - radar), np.abs(upper - radar))
        total += 1 / (0.1 + (farthest**2).sum(axis=-1))
    return total


def bounded_patrol(positions: ca.MX, alive: ca.MX, **parameters: object) -> ca.MX:
    """As `patrolled`, with a lower bound over boxes."""
    return patrolled(positions, alive, **parameters)  # type: ignore[arg-type]


bounded_patrol.lower_bound = least_patrolled  # type: ignore[attr-defined]


def grid_bounds(
    radar: tuple[float, float], target: tuple[float, float], steps: int, cells: int
) -> tuple[float, float]:
    """Bounds of the least risk around one radar, by dynamic programming over time on a grid.

    W_t = min over the cells within reach of (dt rate + W_{t+1}), 0 in the target, with `cells`
    cells to the length of a step. The upper bound is the risk of a path along cell centres; for the
    lower one every cell has its least rate, one cell more is within reach, and any touch arrives.
    """
    h = DT * V_MAX / cells
    axis = h * np.arange(-steps * cells - 1, steps * cells + 2)
    east, north = np.meshgrid(axis - radar[0], axis - radar[1], indexing="ij")
    to_east, to_north = np.meshgrid(axis - target[0], axis - target[1], indexing="ij")
    bounds = []
    for half, radius, reach in ((h / 2, 0.5, cells + 1), (0.0, 0.5 * (1 - 1e-6), cells)):
        far = (np.abs(east) + half) ** 2 + (np.abs(north) + half) ** 2
        cost = DT * ALPHA[0] / (1 + ALPHA[1]) / np.maximum(far, 1e-12)
        nearest = [np.maximum(np.abs(offset) - half, 0.0) for offset in (to_east, to_north)]
        arrived = np.hypot(*nearest) <= radius
        bounds.append(least_cost_on_grid(cost, arrived, reach, steps))
    return bounds[0], bounds[1]


def least_cost_on_grid(cost: Array, arrived: NDArray[np.bool_], reach: int, steps: int) -> float:
    """Least cost from the middle of a square grid to where a path has arrived, step by step."""
    to_go, middle = np.where(arrived, 0.0, np.inf), len(cost) // 2
    for _ in range(steps):
        best = minimum_filter(cost + to_go, 2 * reach + 1, mode="constant", cval=np.inf)
        to_go = np.where(arrived, 0.0, best)
    return float(best[middle, middle])


MEMBER = [(0.0, 0.0)]
TWO = [(3.0, 4.0), (7.0, 6.0)]


def free(target: Point, radars: list[Point], steps: int, **values: object) -> Scenario:
    """Scenario without limits of acceleration."""
    return small(MEMBER, target, radars, steps, guide__acceleration_limited=False, **values)
