"""Benchmark problems: those that planning and simulation pose on random scenarios."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from itertools import product

import numpy as np

from .._util.seeds import require_seed
from .._util.text import did_you_mean
from ..errors import ComparisonError
from ..optimization.solvers import Auto, Ipopt
from ..planning.plan import plan, plan_from
from ..scenario import Scenario
from ..studies.simulation import simulate
from ..typing import FloatArray, Progress
from .problem import Problem
from .recorder import Recorder, formation_starts, guide_starts

HORIZONS = (30, 100, 300)
"""Numbers of steps of the guides, each of ten units of time."""

SIZES = {5: (20, 0.05), 20: (6, 0.12), 50: (2, 0.25)}
"""Runs that the states come from, and rho, by the number of members."""


def make_problems(
    family: str,
    count: int | None = None,
    seed: int = 0,
    progress: Progress | None = None,
) -> list[Problem]:
    """Problems of a family; the same seed gives the same problems.

    Parameters
    ----------
    family : {"guides", "formations", "quick"}
        See `FAMILIES`.
    count : int, optional
        Guides of every horizon, or states of every kind of formation; by default those of
        `FAMILIES`.
    seed : int
        From 0 to 2^64 - 1.
    progress : Progress, optional

    Raises
    ------
    ComparisonError
        An unknown family, or a count below one.
    ValueError
        A seed out of range.
    """
    if family not in FAMILIES:
        raise ComparisonError(f"family {family!r} is unknown{did_you_mean(family, FAMILIES)}")
    seed = require_seed(seed)
    generate, default = FAMILIES[family]
    count = default if count is None else count
    if count < 1:
        raise ComparisonError(f"count = {count}; allowed: whole numbers from 1")
    made: list[Problem] = []
    for problem in generate(count, seed):
        if progress is not None:
            progress("making problems", len(made), None)
        made.append(problem)
    return made


# --- guides


def _guides(count: int, seed: int, horizons: Sequence[int] = HORIZONS) -> Iterator[Problem]:
    for number, horizon in product(range(count), horizons):
        rng = np.random.default_rng([seed, 1, number])  # the same field at every horizon
        radars = _field(rng, 2 + (2 * number) % 5)
        yield _guide(f"guide-{horizon}-{number}", radars, horizon, rng)


def _guide(name: str, radars: FloatArray, horizon: int, rng: np.random.Generator) -> Problem:
    dt = 10.0 / horizon
    scenario = _scenario(
        name, [(0.0, 0.0)], radars, {"kind": "saturation", "alpha_1": 4.0}, dt, 2.0 * dt**2
    ).with_values({"guide.arrival": "horizon"})
    recorder = Recorder(Ipopt())
    plan_from(scenario, scenario.guide_start, recorder, search="local")
    nlp, instances, x = recorder.records[0]
    starts = guide_starts(instances, x, rng)
    traits = {"radars": len(radars), "horizon": horizon}
    return Problem(name, "guides", nlp, starts, traits)


# --- formations


def _formations(
    count: int, seed: int, sizes: Mapping[int, tuple[int, float]] = SIZES
) -> Iterator[Problem]:
    for n, (runs, rho) in sizes.items():
        rng = np.random.default_rng([seed, 2, n])
        scenario = _swarm(n, rho, _field(rng, int(rng.integers(2, 7))))
        guide = plan(scenario, search="local", check=False)
        for rate, policy in product(_RATES, ("leader", "constrained")):
            recorder = Recorder(Auto())
            variant = scenario.with_values({f"hazard.{k}": v for k, v in _RATES[rate].items()})
            simulate(
                variant, [policy], runs, seed, guide=guide, solver=recorder, save_trajectories=0
            )
            for number, (nlp, instances) in enumerate(recorder.sample(count, rng)):
                starts = formation_starts(nlp, instances)
                traits = {"members": n, "policy": policy, "rate": rate}
                name = f"{policy}-{n}-{rate}-{number}"
                yield Problem(name, "formations", nlp, starts, traits)


_RATES: dict[str, dict[str, object]] = {
    "saturation": {"kind": "saturation"},
    "collision": {"kind": "saturation+collision", "beta_1": 0.2, "beta_2": 6.0},
}


def _swarm(n: int, rho: float, radars: FloatArray) -> Scenario:
    """Scenario of n members at the points of a square grid that are closest to its centre."""
    axis = 0.3 * np.arange(-8, 9)
    grid = np.stack(np.meshgrid(axis, axis), axis=-1).reshape(-1, 2)
    order = np.argsort((grid**2).sum(axis=1), kind="stable")
    positions = [(float(x), float(y)) for x, y in grid[order[:n]]]
    # without a larger alpha_1, a large swarm would lose no member
    hazard = {"kind": "saturation", "alpha_1": 0.8 * n}
    values = {"guide.a_max": 0.2, "formation.rho": rho, "guide.arrival": "horizon"}
    return _scenario(f"swarm-{n}", positions, radars, hazard, 0.33, 0.5).with_values(values)


# --- shared by both families


def _field(rng: np.random.Generator, number: int) -> FloatArray:
    """Radars (number, 2) on both sides of the line from the origin to the target."""
    along, lateral = rng.uniform(0.2, 0.85, number), rng.uniform(-0.3, 0.3, number)
    line = np.array(_TARGET)
    normal = np.array([-line[1], line[0]])
    return np.asarray(along[:, None] * line + lateral[:, None] * normal)


_TARGET = (8.0, 6.5)


def _scenario(
    name: str,
    positions: Sequence[tuple[float, float]],
    radars: FloatArray,
    hazard: Mapping[str, object],
    dt: float,
    a_max: float,
) -> Scenario:
    return Scenario.from_data(
        {
            "name": name,
            "swarm": {"positions": positions, "v_max": 2.0, "a_max": a_max},
            "target": {"center": _TARGET, "radius": 0.5},
            "time": {"dt": dt, "t_f": 10.0 + dt / 2},
            "hazard": {"radars": radars.tolist(), "alpha_2": 3.0, "alpha_3": 4.0, **hazard},
        }
    )


def _quick(count: int, seed: int) -> Iterator[Problem]:
    yield from _guides(count, seed, (10,))
    yield from _formations(count, seed, {3: (4, 0.05)})


FAMILIES: dict[str, tuple[Callable[..., Iterator[Problem]], int]] = {
    "guides": (_guides, 3),
    "formations": (_formations, 3),
    "quick": (_quick, 1),
}
"""Generator and default number of the problems of every family."""

DESCRIPTIONS = {
    "guides": "paths of a single agent among random radars",
    "formations": "states of simulated runs among random radars",
}
"""What the problems of a random family are."""
