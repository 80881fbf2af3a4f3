"""The batch solver against Ipopt, Opti, alpaqa and JAX on the states of real runs.

Run with the installed package::

    python benchmarks/batch.py            # all, about ten minutes on two cores
    python benchmarks/batch.py --quick    # fewer states and repeats

Needs ``pip install jax`` and ``pip install --pre alpaqa`` for their rows; without, they say so.
Every state is n = 5, taken at random from simulated runs of the problem's own policy. Times are
medians per state; every other program runs in turn with casswarm's, so that ratios are of one run.
"""

from __future__ import annotations

import statistics
from collections.abc import Callable
from dataclasses import dataclass, replace

import casadi as ca
import numpy as np
from _timing import arguments, in_turn, print_table, timed

import casswarm as csw
from casswarm.optimization.feasible_sets.planar import PlanarSets
from casswarm.optimization.problem import Instances, Nlp
from casswarm.optimization.solvers import Auto, Ipopt
from casswarm.policies import Decision, Policy
from casswarm.policies.leader_selection import LEADER_SELECTION
from casswarm.problems.formation import corridor_formation, leader_formation
from casswarm.problems.step import Motion, Step

PROBLEMS = {
    "leader": ("paper-1", "leader", 1000),
    "leader, collisions": ("paper-2", "leader", 500),
    "constrained": ("paper-1", "constrained", 300),
    "constrained, collisions": ("paper-2", "constrained", None),
}
"""Scenario, policy, and how many times faster than Ipopt casswarm should be."""


@dataclass
class Recorder(Policy):
    """A policy that notes the states it is asked about."""

    inner: Policy
    seen: list[tuple[int, np.ndarray, np.ndarray, np.ndarray]]
    name: str = "recorded"

    def decide_batch(
        self, step: int, positions: np.ndarray, previous_velocities: np.ndarray, alive: np.ndarray
    ) -> Decision:
        """Note the states, and decide as the inner policy does."""
        self.seen.append((step, positions.copy(), previous_velocities.copy(), alive.copy()))
        return self.inner.decide_batch(step, positions, previous_velocities, alive)


def formations(name: str, policy: str, states: int) -> tuple[csw.Scenario, Nlp, Instances]:
    """Formation problems of states at random from 300 runs, at least two members alive."""
    scenario = csw.load_scenario(name)
    guide = csw.plan(scenario)
    recorder = Recorder(csw.make_policy(policy, scenario, guide), [])
    csw.simulate(scenario, [recorder], runs=300, guide=guide)
    places = [
        (k, row)
        for k, (_, _, _, alive) in enumerate(recorder.seen)
        for row in np.flatnonzero(alive.sum(axis=1) > 1)
    ]
    chosen = np.random.default_rng(0).choice(len(places), states, replace=states > len(places))
    nlp, parts = None, []
    for k, (step, positions, previous_velocities, alive) in enumerate(recorder.seen):
        rows = np.array([places[c][1] for c in chosen if places[c][0] == k], dtype=int)
        if rows.size:
            goal = guide.reference(step + 1)
            data = Step(
                scenario.hazard,
                Motion.from_scenario(scenario),
                positions[rows],
                previous_velocities[rows],
                alive[rows],
                goal[None],
            )
            formation = (
                leader_formation(data, LEADER_SELECTION["nearest"](data, guide.reference(step)))
                if policy == "leader"
                else corridor_formation(data, scenario.formation.rho)
            )
            nlp = formation.nlp
            parts.append(formation.instances)
    assert nlp is not None
    return scenario, nlp, joined(parts)


def joined(parts: list[Instances]) -> Instances:
    """All instances as one batch."""

    def arrays(name: str, owner: Callable[[Instances], object]) -> np.ndarray:
        return np.concatenate([getattr(owner(part), name) for part in parts])

    sets = (
        arrays(name, lambda p: p.feasible_set) for name in ("lower", "upper", "centers", "radii")
    )
    names = ("x0", "p", "lbx", "ubx", "lbg", "ubg")
    whole = Instances(
        *(arrays(name, lambda p: p) for name in names), feasible_set=PlanarSets(*sets)
    )
    return replace(whole, scale=arrays("scale", lambda p: p))


def ipopt(nlp: Nlp, instances: Instances) -> tuple[float, np.ndarray]:
    """Seconds a state of a compiled parametric Ipopt, its judging not counted; its objectives."""
    found = Ipopt().solve_batch(nlp, instances)
    return found.seconds / len(instances), np.where(found.success, found.objective, np.inf)


def opti(nlp: Nlp, instances: Instances) -> float:
    """Seconds a state of an Opti problem written anew for every state."""

    def one(row: int) -> None:
        problem = ca.Opti()
        v = problem.variable(nlp.sizes[0])
        f, g = nlp.evaluate(v, instances.p[row])
        problem.minimize(f)
        lower, upper = instances.lbx[row], instances.ubx[row]
        problem.subject_to(problem.bounded(lower, v, upper))
        finite = np.flatnonzero(np.isfinite(instances.ubg[row]))
        if finite.size:
            problem.subject_to(g[finite.tolist()] <= instances.ubg[row][finite])
        problem.set_initial(v, instances.x0[row])
        problem.solver("ipopt", {"print_time": False}, {"print_level": 0, "sb": "yes"})
        problem.solve_limited()

    one(0)
    return statistics.median(timed(lambda row=row: one(row)).wall for row in range(len(instances)))


def alpaqa(nlp: Nlp, instances: Instances) -> Callable[[], object]:
    """All states one by one by alpaqa's PANOC in an augmented Lagrangian, generated C."""
    import alpaqa as pa

    x, p = ca.SX.sym("x", nlp.sizes[0]), ca.SX.sym("p", nlp.sizes[1])
    f, g = nlp.evaluate.expand()(x, p)
    wide = np.inf * np.ones(nlp.sizes[2])
    problem = (
        pa.minimize(f, x)
        .subject_to_box(
            (
                -wide[: nlp.sizes[0]]
                if nlp.sizes[0] <= nlp.sizes[2]
                else -np.inf * np.ones(nlp.sizes[0]),
                np.inf * np.ones(nlp.sizes[0]),
            )
        )
        .subject_to(g, (-wide, wide))
        .with_param(p, instances.p[0])
        .compile(sym=ca.SX.sym)
    )
    inner = pa.PANOCSolver({"max_iter": 500}, {"memory": 10})
    solver = pa.ALMSolver({"tolerance": 1e-7, "dual_tolerance": 1e-7, "max_iter": 50}, inner)

    def run() -> None:
        for row in range(len(instances)):
            problem.param = instances.p[row]
            problem.variable_bounds.lower = instances.lbx[row]
            problem.variable_bounds.upper = instances.ubx[row]
            problem.general_bounds.upper = instances.ubg[row]
            solver(problem, instances.x0[row], np.zeros(nlp.sizes[2]))

    return run


def jax(scenario: csw.Scenario, nlp: Nlp, instances: Instances) -> Callable[[], np.ndarray]:
    """All states at once by the same algorithm in JAX, from the same first starts."""
    from jax_program import batch_program

    from casswarm.optimization.solvers.batch.multistart_kernels import Starts
    from casswarm.optimization.solvers.batch.spg import surroundings

    hazard, batch, n = scenario.hazard, len(instances), nlp.sizes[0] // 2
    keys = ("alpha_1", "alpha_2", "alpha_3", "beta_1", "beta_2")
    numbers = {key: getattr(hazard, key) for key in keys if hasattr(hazard, key)}
    assert instances.feasible_set is not None
    discs = instances.feasible_set.radii.shape[-1]
    p, units = instances.p, instances.scale
    weights = p[:, 5 * n : 6 * n]
    one = bool((np.count_nonzero(weights, axis=1) == 1).all())
    order = np.argsort(-weights, axis=1, kind="stable")  # who has the weight comes first
    program = batch_program(hazard.radar_positions, numbers, 1 if one else n, discs, 1e-7, 3000)

    def ordered(array: np.ndarray) -> np.ndarray:
        return np.take_along_axis(array, order.reshape(order.shape + (1,) * (array.ndim - 2)), 1)

    data = {
        "positions": ordered(p[:, : 2 * n].reshape(batch, n, 2)),
        "alive": ordered(p[:, 4 * n : 5 * n]),
        "weights": ordered(weights),
        "dt": p[:, 6 * n + 2],
        "sets": ordered(instances.feasible_set.packed),
        "unit": units[:, 0],
        "metric": units[:, 0] ** 2 / units[:, 1],
    }
    lanes = {key: np.moveaxis(array, 0, -1).copy() for key, array in data.items()}
    starts = Starts.around(nlp.n_starts, *surroundings(instances))
    moves = starts.directions[: nlp.n_starts].reshape(-1, 1, n, 2) * starts.spread[..., None]
    starts = instances.x0.reshape(batch, n, 2) + moves
    first = np.stack([np.moveaxis(ordered(start), 0, -1) for start in starts])

    def run() -> np.ndarray:
        return np.asarray(program(first, lanes)[1])

    return run


def row(name: str, states: int, repeats: int) -> list[str]:
    """Measure one problem; its row of the table."""
    scenario_name, policy, goal = PROBLEMS[name]
    scenario, nlp, instances = formations(scenario_name, policy, states)
    solver = Auto()

    def ours() -> object:
        return solver.solve_batch(nlp, instances)

    found = solver.solve_batch(nlp, instances)
    few = instances[slice(0, 100)]
    slow, objective = ipopt(nlp, instances)
    own = timed(ours, repeats).wall / states
    worse = found.objective > objective + 1e-6 * np.abs(objective)
    better = found.objective < objective - 1e-6 * np.abs(objective)
    cells = [f"{1e6 * own:.2f} us", f"{1e3 * slow:.2f} ms ({slow / own:.0f} x)"]
    cells.append(f"{1e3 * opti(nlp, instances[slice(0, 20)]):.1f} ms")
    for other, program in (
        ("alpaqa", lambda: (alpaqa(nlp, few), 100)),
        ("jax", lambda: (jax(scenario, nlp, instances), states)),
    ):
        try:
            work, number = program()
        except ImportError as error:
            cells.append(f"{other}: {error}")
            continue
        _, took, ratio = in_turn(ours, work, repeats if other == "jax" and goal else 3)
        ratio *= states / number
        cells.append(f"{1e6 * took / number:.2f} us ({ratio:.2f} x)")
    goal_text = f" (goal {goal} x)" if goal else ""
    answers = (
        f"{worse.sum()} worse, {better.sum()} better than Ipopt, {found.used_fallback.sum()} "
        f"fallbacks, {(~found.success).sum()} unsolved of {states}; "
        f"stationarity <= {found.stationarity.max():.0e}"
    )
    return [f"{name}{goal_text}", *cells, answers]


def main() -> None:
    """Print the table."""
    states, repeats = (500, 5) if arguments(__doc__).quick else (2000, 21)
    columns = ("problem", "casswarm auto", "Ipopt, compiled", "Opti, rebuilt", "alpaqa", "JAX")
    print_table((*columns, "answers"), (row(name, states, repeats) for name in PROBLEMS))


if __name__ == "__main__":
    main()
