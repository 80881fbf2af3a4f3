"""The batch solver against Ipopt, Opti, alpaqa and JAX on the states of real runs.

Run with the installed package::

    python benchmarks/batch.py            # all, about ten minutes on two cores
    python benchmarks/batch.py --quick    # fewer states and repeats

Needs ``pip install jax pounce-solver`` and ``pip install --pre alpaqa`` for their columns, which
otherwise say so. The share after other solvers is what they solved.
Every state is n = 5, taken at random from simulated runs of the problem's own policy. Times are
medians per state; every other program runs in turn with casswarm's, so that ratios are of one run.
"""

from __future__ import annotations

import statistics
from collections.abc import Callable
from dataclasses import dataclass

import casadi as ca
import numpy as np
from _timing import arguments, in_turn, print_table, timed

import casswarm as csw
from casswarm._util.silence import silence
from casswarm.formation import Auto
from casswarm.formation.objective import start_count
from casswarm.formation.task import LEADER_SELECTION, FormationTask, or_none
from casswarm.motion.step import Motion, Step
from casswarm.nlp.program import Instances, Nlp
from casswarm.policies import Decision, Policy
from casswarm.scenario.variations import with_parameters
from casswarm.solvers import SOLVERS, Ipopt, make_solver

PROBLEMS = {
    "leader": ("paper-1", "leader"),
    "leader, collisions": ("paper-2", "leader"),
    "constrained": ("paper-1", "constrained"),
    "constrained, collisions": ("paper-2", "constrained"),
}
"""Scenario and policy."""
GENERIC = ("interior-point", "pounce")
"""Interior-point methods for any problem: casswarm's for batches, and POUNCE."""


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


def recorded(name: str, policy: str, states: int, n: int | None = None) -> FormationTask:
    """Formation problems of states at random from 300 runs, at least two members alive."""
    scenario = csw.load_scenario(name)
    guide = csw.plan(scenario)
    if n is not None:
        scenario = with_parameters(scenario, {"n": n})
    recorder = Recorder(csw.make_policy(policy, scenario, guide), [])
    csw.simulate(scenario, [recorder], runs=300, guide=guide)
    steps = np.concatenate([np.full(len(seen[-1]), seen[0]) for seen in recorder.seen])
    arrays = [np.concatenate(parts) for parts in list(zip(*recorder.seen, strict=True))[1:]]
    several = np.flatnonzero(arrays[-1].sum(axis=1) > 1)
    rng = np.random.default_rng(0)
    chosen = several[rng.choice(len(several), states, replace=states > len(several))]
    goals = np.array([guide.reference(step + 1) for step in steps[chosen]])
    motion = Motion.from_scenario(scenario)
    step = Step(scenario.hazard, motion, *(array[chosen] for array in arrays), goals[None])
    if policy != "leader":
        return FormationTask(step, or_none(None, states), scenario.formation.rho)
    references = np.array([guide.reference(step) for step in steps[chosen]])
    return FormationTask(step, LEADER_SELECTION["nearest"](step, references))


def ipopt(nlp: Nlp, instances: Instances) -> tuple[float, np.ndarray]:
    """Seconds a state of a compiled parametric Ipopt, its judging not counted; its objectives."""
    found = Ipopt().solve_batch(nlp, instances)
    return found.seconds / len(instances), np.where(found.success, found.objective, np.inf)


def generic(name: str, nlp: Nlp, instances: Instances) -> str:
    """Time a state of one of casswarm's solvers for any problem, and the share it solves."""
    if reason := SOLVERS[name].unavailable():
        return reason
    found = make_solver(name).solve_batch(nlp, instances)
    again = make_solver(name).solve_batch(nlp, instances)
    took = 1e6 * min(found.seconds, again.seconds) / len(instances)
    return f"{took:.3g} us ({again.success.mean():.0%})"


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
    free = np.inf * np.ones(nlp.sizes[0])
    described = pa.minimize(f, x).subject_to_box((-free, free)).subject_to(g, (-wide, wide))
    with silence():  # of the compiler
        problem = described.with_param(p, instances.p[0]).compile(sym=ca.SX.sym)
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


def jax(task: FormationTask, n_starts: int) -> Callable[[], np.ndarray]:
    """All states at once by the same algorithm in JAX, from the first of the same starts."""
    from jax_program import batch_program

    from casswarm.formation.multistart_kernels import START_SPREAD
    from casswarm.formation.spectral_kernels import Starts

    hazard, instances = task.step.hazard, task.formation().instances
    batch, n = task.step.alive.shape
    keys = ("alpha_1", "alpha_2", "alpha_3", "beta_1", "beta_2")
    numbers = {key: getattr(hazard, key) for key in keys if hasattr(hazard, key)}
    assert instances.feasible_set is not None
    discs = instances.feasible_set.radii.shape[-1]
    p, units = instances.p, instances.scale
    weights = p[:, 5 * n : 6 * n]
    one = bool((np.count_nonzero(weights, axis=1) == 1).all())
    order = np.argsort(-weights, axis=1, kind="stable")  # who has the weight comes first
    program = batch_program(hazard.radar_positions, numbers, 1 if one else n, discs, 1e-9, 400)

    def ordered(array: np.ndarray) -> np.ndarray:
        return np.take_along_axis(array, order.reshape(order.shape + (1,) * (array.ndim - 2)), 1)

    data = {
        "positions": ordered(p[:, : 2 * n].reshape(batch, n, 2)),
        "alive": ordered(p[:, 4 * n : 5 * n]),
        "weights": ordered(weights),
        "dt": p[:, 6 * n + 2],
        "sets": ordered(instances.feasible_set.packed),
        "metric": units[:, 0] ** 2 / units[:, 1],
    }
    lanes = {key: np.moveaxis(array, 0, -1).copy() for key, array in data.items()}
    sets, guesses = instances.feasible_set, instances.x0.reshape(batch, n, 2)
    radii = sets.radii.min(axis=-1)
    spread = START_SPREAD * np.where(np.isfinite(radii), radii, 0.0)
    starts = Starts.around(n_starts, spread, guesses, sets.centers.sum(axis=-2))
    moves = starts.directions[:n_starts].reshape(-1, 1, n, 2) * starts.spread[..., None]
    starts = instances.x0.reshape(batch, n, 2) + moves
    first = np.stack([np.moveaxis(ordered(start), 0, -1) for start in starts])

    def run() -> np.ndarray:
        return np.asarray(program(first, lanes)[1])

    return run


def row(name: str, states: int, repeats: int) -> list[str]:
    """Measure one problem; its row of the table."""
    scenario_name, policy = PROBLEMS[name]
    task = recorded(scenario_name, policy, states)
    nlp, instances = task.nlp, task.formation().instances
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
    cells += [generic(other, nlp, few) for other in GENERIC]
    cells.append(f"{1e3 * opti(nlp, instances[slice(0, 20)]):.1f} ms")
    for other, program in (
        ("alpaqa", lambda: (alpaqa(nlp, few), 100)),
        ("jax", lambda: (jax(task, start_count(nlp)), states)),
    ):
        try:
            work, number = program()
        except ImportError as error:
            cells.append(f"{other}: {error}")
            continue
        _, took, ratio = in_turn(ours, work, repeats if other == "jax" else 3)
        ratio *= states / number
        cells.append(f"{1e6 * took / number:.2f} us ({ratio:.2f} x)")
    answers = (
        f"{worse.sum()} worse, {better.sum()} better than Ipopt, {found.used_fallback.sum()} "
        f"fallbacks, {(~found.success).sum()} unsolved of {states}; "
        f"stationarity <= {found.stationarity.max():.0e}"
    )
    return [name, *cells, answers]


def main() -> None:
    """Print the table."""
    states, repeats = (500, 5) if arguments(__doc__).quick else (2000, 21)
    columns = ("problem", "casswarm auto", "Ipopt, compiled", *GENERIC)
    columns += ("Opti, rebuilt", "alpaqa", "JAX")
    print_table((*columns, "answers"), (row(name, states, repeats) for name in PROBLEMS))


if __name__ == "__main__":
    main()
