"""What solvers are compared on: the problems that planning and simulation pose to their solver.

Nothing is made up for the comparison. A solver that listens is given to `plan` and `simulate` on
random scenarios, hands every question on to casswarm's own solver, and keeps some of them.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import product
from typing import ClassVar

import numpy as np

from .._util.text import did_you_mean
from ..errors import ComparisonError
from ..optimization.feasible_sets.planar import PlanarSets
from ..optimization.problem import Instances, Nlp
from ..optimization.solution import BatchSolution
from ..optimization.solvers import Answer, Auto, Ipopt, Solver
from ..planning.plan import plan, plan_from
from ..scenario import Scenario
from ..studies.simulation import simulate
from ..typing import FloatArray

HORIZONS = (30, 100, 300)
"""Steps of the guides; the same ten units of time, in finer and finer steps."""

SIZES = {5: (20, 0.05), 20: (6, 0.12), 50: (2, 0.25)}
"""Members of the formations; the runs that their states come from, and rho."""

NOISE = 0.05
"""Standard deviation by which a guide's warm start is off the solution, in steps at v_max."""


@dataclass(frozen=True, eq=False)
class Problem:
    """A problem, and where solvers start on it. Problems pickle.

    Parameters
    ----------
    name : str
    family : str
        Problems of a family, and of a kind of start, share tables and profiles.
    nlp : Nlp
    starts : mapping of str to Instances
        A single instance for every kind of start, such as cold and warm; they differ in their start
        alone.
    traits : mapping
        Plain values that describe it, for tables.
    """

    name: str
    family: str
    nlp: Nlp
    starts: Mapping[str, Instances]
    traits: Mapping[str, object] = field(default_factory=dict)

    def __post_init__(self) -> None:
        for start, instances in self.starts.items():
            if len(instances) != 1:
                raise ComparisonError(
                    f"problem {self.name!r} has {len(instances)} instances as its {start} start; "
                    "expected one"
                )

    def fingerprint(self) -> str:
        """Hash of its numbers and of its functions at the starts: equal for equal problems."""
        digest = hashlib.sha256(f"{self.name} {self.family} {self.nlp.name}".encode())
        for start, instances in self.starts.items():
            digest.update(start.encode())
            for part in ("x0", "p", "lbx", "ubx", "lbg", "ubg"):
                digest.update(np.ascontiguousarray(getattr(instances, part)).tobytes())
            values = self.nlp.evaluate(instances.x0[0], instances.p[0])
            digest.update(b"".join(np.asarray(value).tobytes() for value in values))
        return digest.hexdigest()[:16]


def make_problems(
    family: str,
    count: int | None = None,
    seed: int = 0,
    progress: Callable[[str], None] | None = None,
) -> list[Problem]:
    """Problems of a family, the same for the same numbers.

    Parameters
    ----------
    family : {"guides", "formations", "quick"}
        See `FAMILIES`.
    count : int, optional
        Guides of every horizon, or states of every kind of formation; by default those of
        `FAMILIES`.
    seed : int
    progress : callable, optional
        Called with a line on what is being made.

    Raises
    ------
    ComparisonError
        An unknown family, or a count below one.
    """
    if family not in FAMILIES:
        raise ComparisonError(f"family {family!r} is unknown{did_you_mean(family, FAMILIES)}")
    made, default = FAMILIES[family][:2]
    count = default if count is None else count
    if count < 1:
        raise ComparisonError(f"problems = {count}; allowed: whole numbers from 1")
    return list(made(count, seed, progress or (lambda _: None)))


# --- guides


def _guides(
    count: int, seed: int, progress: Callable[[str], None], horizons: Sequence[int] = HORIZONS
) -> Iterator[Problem]:
    for number, horizon in product(range(count), horizons):
        rng = np.random.default_rng([seed, 1, number])  # the same field at every horizon
        radars = _field(rng, 2 + (2 * number) % 5)
        progress(f"guide {number}, {horizon} steps")
        yield _guide(f"guide-{horizon}-{number}", radars, horizon, rng)


def _guide(name: str, radars: FloatArray, horizon: int, rng: np.random.Generator) -> Problem:
    dt = 10.0 / horizon
    scenario = _scenario(
        name, [(0.0, 0.0)], radars, {"kind": "saturation", "alpha_1": 4.0}, dt, 2.0 * dt**2
    ).with_values({"guide.arrival": "horizon"})
    listener = _Listener(Ipopt())
    plan_from(scenario, scenario.guide_start, listener, search="local")
    nlp, instances, found = listener.heard[0]
    near = np.where(np.isfinite(found), found, instances.x0)
    near = near + NOISE * rng.normal(size=near.shape)
    traits = {"radars": len(radars), "horizon": horizon}
    return _problem(
        name, "guides", nlp, {"cold": instances, "warm": instances.with_x0(near)}, traits
    )


# --- formations


def _formations(
    count: int,
    seed: int,
    progress: Callable[[str], None],
    sizes: Mapping[int, tuple[int, float]] = SIZES,
) -> Iterator[Problem]:
    for n, (runs, rho) in sizes.items():
        rng = np.random.default_rng([seed, 2, n])
        scenario = _swarm(n, rho, _field(rng, int(rng.integers(2, 7))))
        guide = plan(scenario, search="local", check=False)
        for rate, policy in product(_RATES, ("leader", "constrained")):
            progress(f"states of {n} members, {policy}, {rate}")
            listener = _Listener(Auto())
            variant = scenario.with_values({f"hazard.{k}": v for k, v in _RATES[rate].items()})
            simulate(
                variant, [policy], runs, seed, guide=guide, solver=listener, save_trajectories=0
            )
            for number, (nlp, instances) in enumerate(listener.chosen(count, rng)):
                zero = np.zeros_like(instances.x0)  # where the paper starts
                yield _problem(
                    f"{policy}-{n}-{rate}-{number}",
                    "formations",
                    nlp,
                    {"cold": instances.with_x0(zero), "warm": _from_previous(nlp, instances)},
                    {"members": n, "policy": policy, "rate": rate},
                )


def _from_previous(nlp: Nlp, instances: Instances) -> Instances:
    """Started from the previous velocities, made feasible; a policy may know better."""
    sets = instances.feasible_set
    assert isinstance(sets, PlanarSets)
    sizes = [block.numel() for block in nlp.parameters.values()]
    first = sum(sizes[: list(nlp.parameters).index("previous_velocities")])
    previous_velocities = instances.p[:, first : first + instances.x0.shape[1]]
    points = sets.project(previous_velocities.reshape(*sets.shape, 2))
    return instances.with_x0(points.reshape(instances.x0.shape))


_RATES: dict[str, dict[str, object]] = {
    "saturation": {"kind": "saturation"},
    "collision": {"kind": "saturation+collision", "beta_1": 0.2, "beta_2": 6.0},
}


def _swarm(n: int, rho: float, radars: FloatArray) -> Scenario:
    """n members on the places of a square grid that are nearest to its middle."""
    axis = 0.3 * np.arange(-8, 9)
    grid = np.stack(np.meshgrid(axis, axis), axis=-1).reshape(-1, 2)
    order = np.argsort((grid**2).sum(axis=1), kind="stable")
    places = [(float(x), float(y)) for x, y in grid[order[:n]]]
    hazard = {"kind": "saturation", "alpha_1": 0.8 * n}  # or a large swarm would lose nobody
    values = {"guide.a_max": 0.2, "formation.rho": rho, "guide.arrival": "horizon"}
    return _scenario(f"swarm-{n}", places, radars, hazard, 0.33, 0.5).with_values(values)


# --- what both share


def _field(rng: np.random.Generator, number: int) -> FloatArray:
    """Radars (number, 2) on both sides of the way from the origin to the target."""
    along, beside = rng.uniform(0.2, 0.85, number), rng.uniform(-0.3, 0.3, number)
    way = np.array(_TARGET)
    return np.asarray(along[:, None] * way + beside[:, None] * np.array([-way[1], way[0]]))


_TARGET = (8.0, 6.5)


def _scenario(
    name: str,
    places: Sequence[tuple[float, float]],
    radars: FloatArray,
    hazard: Mapping[str, object],
    dt: float,
    a_max: float,
) -> Scenario:
    return Scenario.from_data(
        {
            "name": name,
            "swarm": {"positions": places, "v_max": 2.0, "a_max": a_max},
            "target": {"center": _TARGET, "radius": 0.5},
            "time": {"dt": dt, "t_f": 10.0 + dt / 2},
            "hazard": {"radars": radars.tolist(), "alpha_2": 3.0, "alpha_3": 4.0, **hazard},
        }
    )


def _problem(
    name: str,
    family: str,
    nlp: Nlp,
    starts: Mapping[str, Instances],
    traits: Mapping[str, object],
) -> Problem:
    variables, _, constraints = nlp.sizes
    sizes = {"variables": variables, "constraints": constraints}
    return Problem(name, family, nlp, starts, {**traits, **sizes})


@dataclass(frozen=True, eq=False)
class _Listener(Solver):
    """Hands every question on to another solver, and keeps it with the answer's x."""

    inner: Solver
    heard: list[tuple[Nlp, Instances, FloatArray]] = field(default_factory=list)

    name: ClassVar[str] = "listener"
    summary: ClassVar[str] = "keeps what another solver is asked"

    def prepare(self, nlp: Nlp) -> None:
        self.inner.prepare(nlp)

    def run(self, nlp: Nlp, instances: Instances) -> Sequence[Answer]:
        answers = self.inner.timed_answers(nlp, instances)[1]
        self.heard.append((nlp, instances, np.stack([answer.x for answer in answers])))
        return answers

    def solve_batch(self, nlp: Nlp, instances: Instances) -> BatchSolution:
        """The inner solver's."""
        found = self.inner.solve_batch(nlp, instances)
        self.heard.append((nlp, instances, found.x))
        return found

    def chosen(self, count: int, rng: np.random.Generator) -> Iterator[tuple[Nlp, Instances]]:
        """Single instances, of steps that are spread over the runs."""
        steps = np.linspace(0, len(self.heard), count + 2)[1:-1].astype(int)
        for step in steps:
            nlp, instances, _ = self.heard[step]
            row = int(rng.integers(len(instances)))
            yield nlp, instances[row : row + 1]


def _quick(count: int, seed: int, progress: Callable[[str], None]) -> Iterator[Problem]:
    yield from _guides(count, seed, progress, (10,))
    yield from _formations(count, seed, progress, {3: (4, 0.05)})


FAMILIES: dict[str, tuple[Callable[..., Iterator[Problem]], int, str]] = {
    "guides": (_guides, 3, "a lone agent's way among 2 to 6 random radars, 30, 100 and 300 steps"),
    "formations": (
        _formations,
        3,
        "states of 5, 20 and 50 members in simulated runs; both policies, with collisions and "
        "without",
    ),
    "quick": (_quick, 1, "one guide of 10 steps and four states of 3 members, for a first look"),
}
"""What makes the problems of a family, how many by default, and what they are."""
