"""Benchmark problems that planning and simulation pose to solvers, recorded on scenarios.

A recorder is passed to `plan` and `simulate`; it delegates every problem to another solver.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import product
from typing import ClassVar

import numpy as np
from typing_extensions import override

from .._util.numbers import require_seed
from ..comparison.families import Family, require_count
from ..comparison.problem import Problem
from ..errors import ComparisonError
from ..formation import Auto
from ..formation.task import corridor_formation
from ..guide.agent import plan_from
from ..guide.plan import plan
from ..hazard import Saturation
from ..motion.planar import PlanarSets
from ..motion.step import Motion, Step
from ..nlp.program import Instances, Nlp
from ..nlp.solution import BatchSolution
from ..policies import Policy
from ..scenario import Scenario
from ..solvers import Answer, Ipopt, Solver
from ..typing import FloatArray
from .inputs import policy_list, policy_name
from .simulation import simulate

NOISE = 0.05
"""Standard deviation by which a guide's warm start is off the solution, in steps at v_max."""


@dataclass(frozen=True, eq=False)
class Recorder(Solver):
    """Delegates to another solver, and records every problem with the answer's x."""

    inner: Solver
    records: list[tuple[Nlp, Instances, FloatArray]] = field(default_factory=list)

    name: ClassVar[str] = "recorder"
    summary: ClassVar[str] = "records the problems of another solver"

    @override
    def run(self, nlp: Nlp, instances: Instances) -> Sequence[Answer]:
        answers = self.inner.timed_answers(nlp, instances)[1]
        self.records.append((nlp, instances, np.stack([answer.x for answer in answers])))
        return answers

    @override
    def solve_batch(
        self, nlp: Nlp, instances: Instances, *, sensitivities: bool = False
    ) -> BatchSolution:
        if sensitivities:
            return super().solve_batch(nlp, instances, sensitivities=True)
        batch = self.inner.solve_batch(nlp, instances)
        self.records.append((nlp, instances, batch.x))
        return batch

    def sample(self, count: int, rng: np.random.Generator) -> Iterator[tuple[Nlp, Instances]]:
        """Single instances of steps that are spread over the runs."""
        steps = np.linspace(0, len(self.records), count + 2)[1:-1].astype(int)
        for step in steps:
            nlp, instances, _ = self.records[step]
            row = int(rng.integers(len(instances)))
            yield nlp, instances[row : row + 1]


def guide_starts(
    instances: Instances, x: FloatArray, rng: np.random.Generator
) -> dict[str, Instances]:
    """Cold start, as it was posed, and warm start: the answer x (1, nx) with noise added."""
    near = np.where(np.isfinite(x), x, instances.x0)
    return {"cold": instances, "warm": instances.with_x0(near + NOISE * rng.normal(size=x.shape))}


def formation_starts(nlp: Nlp, instances: Instances) -> dict[str, Instances]:
    """Cold start, zero velocities as in the paper, and warm start: the previous velocities.

    They are projected onto the feasible set; over several steps the warm start is that of the
    policy.
    """
    cold = np.zeros_like(instances.x0)
    starts, sets = {"cold": instances.with_x0(cold), "warm": instances}, instances.feasible_set
    if isinstance(sets, PlanarSets):
        previous_velocities = nlp.parameter_blocks(instances.p)["previous_velocities"]
        points = sets.project(previous_velocities.reshape(*sets.shape, 2))
        starts["warm"] = instances.with_x0(points.reshape(cold.shape))
    return starts


HORIZONS = (30, 100, 300)
"""Numbers of steps of the guides, each of ten units of time."""

SIZES = {5: (20, 0.05), 20: (6, 0.12), 50: (2, 0.25)}
"""Runs that the states come from, and rho, by the number of members."""


# --- guides


def _guides(count: int, seed: int, horizons: Sequence[int] = HORIZONS) -> Iterator[Problem]:
    for number, horizon in product(range(count), horizons):
        rng = np.random.default_rng([seed, 1, number])  # the same field at every horizon
        radars = _field(rng, 2 + (2 * number) % 5)
        dt, name = 10.0 / horizon, f"guide-{horizon}-{number}"
        hazard = {"kind": "saturation", "alpha_1": 4.0}
        scenario = _scenario(name, [(0.0, 0.0)], radars, hazard, dt, 2.0 * dt**2)
        scenario = scenario.with_values({"guide.arrival": "horizon"})
        recorder = Recorder(Ipopt())
        plan_from(scenario, scenario.guide_start, recorder, search="local")
        nlp, instances, x = recorder.records[0]
        traits = {"radars": len(radars), "horizon": horizon}
        yield Problem(name, "guides", nlp, guide_starts(instances, x, rng), traits)


# --- formations


def _formations(
    count: int, seed: int, sizes: Mapping[int, tuple[int, float]] = SIZES
) -> Iterator[Problem]:
    for n, (runs, rho) in sizes.items():
        rng = np.random.default_rng([seed, 2, n])
        scenario = _swarm(n, rho, _field(rng, int(rng.integers(2, 7))))
        guide = plan(scenario, search="local", check=False, certify=False)
        for rate, policy in product(_RATES, ("leader", "constrained")):
            recorder = Recorder(Auto())
            variant = scenario.with_values({f"hazard.{k}": v for k, v in _RATES[rate].items()})
            simulate(variant, policy, runs, seed, guide=guide, solver=recorder, save_trajectories=0)
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


_GUIDE = re.compile(r"guide-\d+-(\d+)")
_STATE = re.compile(r"(.+-\d+-.+)-\d+")


def _field_of(name: str) -> str:
    """Number of a guide called guide-HORIZON-NUMBER: guides of a number have the same radars."""
    return match[1] if (match := _GUIDE.fullmatch(name)) else name


def _kind_of(name: str) -> str:
    """Kind of a formation called POLICY-MEMBERS-RATE-NUMBER, with as many numbers of each."""
    return match[1] if (match := _STATE.fullmatch(name)) else ""


def _two_members() -> tuple[Nlp, Instances]:
    """Two members in a corridor, which all kinds of solvers take: a product of planar sets."""
    step = Step(
        hazard=Saturation(((1.0, 1.0),)),
        motion=Motion(v_max=1.0, a_max=1.0, dt=1.0),
        positions=np.array([[[0.0, 0.0], [0.1, 0.0]]]),
        previous_velocities=np.zeros((1, 2, 2)),
        alive=np.ones((1, 2), bool),
        goals=np.array([[0.2, 0.1]]),
    )
    formation = corridor_formation(step, 0.1)
    return formation.nlp, formation.instances


_NOTE = (
    "The problems of the families guides and formations are those that planning and simulation "
    "pose to their solver on random scenarios. Guides have a cold start, the straight line at "
    "constant speed, and a warm start, a local solution with noise added. Formations are states "
    "of simulated runs; their cold start is zero velocities, and their warm start the velocities "
    "of the previous step, projected onto the feasible set."
)

GUIDES = Family(_guides, 3, "paths of a single agent among random radars", _NOTE, unit=_field_of)

FORMATIONS = Family(
    _formations,
    3,
    "states of simulated runs among random radars",
    _NOTE,
    kind=_kind_of,
    warm_up=_two_members,
)

QUICK = Family(_quick, 1)


COUNT = 3
"""Default number of guides, and of states for every policy."""

WITHOUT_FORMATIONS = ("naive", "joint", "joint-replanning")
"""Policies that follow planned paths, and pose no problem while they run."""

RUNS = 20
"""Simulated runs that the states come from."""


def guide_problems(scenario: Scenario, count: int = COUNT, seed: int = 0) -> list[Problem]:
    """Problems that planning the scenario's guide poses: solves spread over its search.

    Their cold start is the search's own, and their warm start the answer with noise added.

    Parameters
    ----------
    scenario : Scenario
    count : int
        The largest number of problems; a local search has a single one.
    seed : int
        Of the noise.

    Returns
    -------
    list of Problem
        Of the family "NAME guides".

    Raises
    ------
    ComparisonError
        A count below one, or no problem had anything to optimise.
    PlanningError
        No guide was found.
    """
    rng = np.random.default_rng([require_seed(seed), 3])
    recorder = Recorder(Ipopt())
    plan_from(scenario, scenario.guide_start, recorder)
    name, traits = f"{scenario.name} guide", {"scenario": scenario.name}
    return [
        Problem(f"{name} {number}", f"{name}s", nlp, guide_starts(instances, x, rng), traits)
        for number, (nlp, instances, x) in enumerate(_spread(recorder, count, rng, name))
    ]


def formation_problems(
    scenario: Scenario,
    policies: str | Policy | Sequence[str | Policy] = ("leader", "constrained"),
    count: int = COUNT,
    *,
    seed: int = 0,
    runs: int = RUNS,
) -> list[Problem]:
    """Formation problems of states that simulated runs of the scenario reach.

    Their cold start is zero velocities, as in the paper, and their warm start the velocities of the
    previous step, projected onto the feasible set.

    Parameters
    ----------
    scenario : Scenario
    policies : str, Policy, or sequence of these
        Names such as leader, constrained and leader-mpc-3.
    count : int
        The largest number of states for every policy, of steps that are spread over the runs.
    seed : int
        Of the runs, and of the choice among their states.
    runs : int
        Number of simulated runs.

    Returns
    -------
    list of Problem
        Of the family "NAME formations".

    Raises
    ------
    ComparisonError
        A count below one, a lone agent, or a policy that poses no problem to a solver, such as
        naive or joint.
    PlanningError
        No guide was found.
    PolicyError
        An unknown policy.
    """
    rng = np.random.default_rng([require_seed(seed), 4])
    listed = policy_list(policies)
    _require_formations(scenario, listed)
    guide = plan(scenario, check=False, certify=False)
    problems: list[Problem] = []
    for policy in listed:
        recorder, name = Recorder(Auto()), policy_name(policy)
        simulate(scenario, [policy], runs, seed, guide=guide, solver=recorder, save_trajectories=0)
        posed = _spread(recorder, count, rng, f"policy {name!r}")
        family = f"{scenario.name} formations"
        traits = {"scenario": scenario.name, "members": scenario.n, "policy": name}
        problems += [
            Problem(
                f"{scenario.name} {name} {number}", family, nlp, formation_starts(nlp, one), traits
            )
            for number, (nlp, one, _) in enumerate(posed)
        ]
    return problems


def _require_formations(scenario: Scenario, policies: Sequence[str | Policy]) -> None:
    if scenario.n < 2:
        raise ComparisonError(
            f"scenario {scenario.name!r} has a single member, which is in no formation; "
            "guide_problems poses its guide",
            scenario=scenario.name,
        )
    for policy in policies:
        if policy in WITHOUT_FORMATIONS:
            raise ComparisonError(
                f"policy {policy!r} poses no formation problem: its members follow paths that are "
                "planned before; choose leader, constrained, leader-mpc-H or constrained-mpc-H",
                policy=policy if isinstance(policy, str) else policy.name,
            )


def _spread(
    recorder: Recorder, count: int, rng: np.random.Generator, what: str
) -> list[tuple[Nlp, Instances, FloatArray]]:
    """Single instances with free variables, of recorded solves that are spread over all."""
    require_count(count)
    records = [
        (nlp, instances, x, free)
        for nlp, instances, x in recorder.records
        if len(free := np.flatnonzero((instances.lbx < instances.ubx).any(axis=1)))
    ]
    if not records:
        raise ComparisonError(f"{what}: no problem was posed to a solver, or none with a choice")
    chosen = np.unique(np.linspace(0, len(records) - 1, count + 2)[1:-1].round().astype(int))
    singles = []
    for nlp, instances, x, free in (records[i] for i in chosen):
        row = slice(at := int(rng.choice(free)), at + 1)
        singles.append((nlp, instances[row], x[row]))
    return singles
