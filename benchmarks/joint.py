"""Joint plans: success, spread over seeds, time, and comparison with bound and mean field.

Run with the installed package::

    python benchmarks/joint.py            # half an hour
    python benchmarks/joint.py --quick    # some minutes: less of everything
    python benchmarks/joint.py members    # one table

Prints Markdown tables. Planning uses one core; its CPU time depends less on the machine's load than
its wall-clock time.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterable, Sequence
from functools import partial

import casadi as ca
import numpy as np
from _random_swarms import has_guide, random_restarts, random_scenario
from _timing import arguments, print_table, timed

import casswarm as csw
from casswarm import Scenario, SwarmPlan
from casswarm.joint import InitialGuess, JointProblem, PlanDistribution, PlanTree
from casswarm.joint.numeric import joint_program
from casswarm.joint.plan_distribution import likely_sets
from casswarm.nlp import LagrangianHessian
from casswarm.nlp.program import Nlp
from casswarm.policies import JointPolicy, ReplanningPolicy
from casswarm.problems.joint import JointForm, JointTask, joint_instances
from casswarm.solvers import Ipopt
from casswarm.solvers.interior_point.derivatives import Condensation, NumericDerivatives

SCENARIOS = ("paper-1", "paper-2", "ring", "wall", "crossfire", "gauntlet", "single-agent")
MEMBERS = range(2, 9)
Row = Sequence[object]


def around(name: str, n: int) -> Scenario:
    """A built-in scenario with n members on a circle."""
    angles = 2 * np.pi * np.arange(n) / n
    positions = [[0.5 * math.cos(angle), 0.5 * math.sin(angle)] for angle in angles]
    return csw.load_scenario(name).with_values({"swarm.positions": positions})


def seeds(quick: bool) -> Iterable[Row]:
    """Minimum and maximum success over seeds, and the time of a plan."""
    for name in SCENARIOS[:2] if quick else SCENARIOS:
        scenario = csw.load_scenario(name)
        count = 2 if quick or not name.startswith("paper") else 5
        plans = [timed(partial(csw.plan_swarm, scenario, seed=seed)) for seed in range(count)]
        values = [plan.value for plan, _, _ in plans]
        clock, cpu = (float(np.median([row[k] for row in plans])) for k in (1, 2))
        best = plans[0][0]
        assert best.bound is not None
        leader = csw.evaluate(scenario, "leader", 1e-3, aggregation_tol=1e-6).success
        yield (
            name,
            f"{leader[0]:.4f}",
            f"{min(values):.6f}",
            f"{max(values):.6f}",
            str(best.bound).removeprefix("no policy can exceed "),
            f"{clock:.1f} s ({cpu:.1f})",
        )


def restarts(quick: bool) -> Iterable[Row]:
    """Plans of random scenarios against the best of 40 random restarts of the same solver."""
    count, ratios, seconds = 40, [], []
    for seed in range(10 if quick else 100):
        scenario = random_scenario(seed)
        if not has_guide(scenario):
            continue
        plan, *of_plan = timed(partial(csw.plan_swarm, scenario))
        search = partial(random_restarts, scenario, plan.initial_velocities, count, seed)
        best, *of_restarts = timed(search)
        ratios.append((1 - plan.value) / (1 - best))
        seconds.append((of_plan[1], of_restarts[1]))
    ratio, cpu = np.array(ratios), np.array(seconds)
    yield (
        len(ratio),
        *(int((ratio > 1 + share).sum()) for share in (0.01, 0.001)),
        f"{ratio.max():.3f}",
        int((ratio < 0.99).sum()),
        *(f"{median:.2f} s ({total:.0f})" for median, total in zip(*summary(cpu), strict=True)),
    )


def summary(cpu: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Medians and totals of columns."""
    return np.median(cpu, axis=0), cpu.sum(axis=0)


def sizes(quick: bool) -> Iterable[Row]:
    """Plans of 30 steps against the number of members."""
    for name in ("paper-1", "paper-2"):
        for n in (2, 3, 4, 5) if quick else MEMBERS:
            scenario = around(name, n)
            plan, clock, cpu = timed(partial(csw.plan_swarm, scenario))
            assert plan.distribution is not None
            yield (
                name,
                n,
                f"{plan.distribution.failure:.3g}",
                f"{plan.bound.failure:.3g}" if plan.bound else "-",
                plan.solution.status,
                f"{1000 * gradient_seconds(scenario):.2f} ms",
                f"{clock:.1f} s ({cpu:.1f})",
            )


def instance_of(scenario: Scenario) -> tuple[Nlp, np.ndarray, np.ndarray]:
    """The program of a scenario, with variables and parameters."""
    form = JointForm(scenario.n, scenario.n_steps)
    nlp = joint_program(scenario.hazard, form)
    task = JointTask.from_scenario(scenario, np.zeros((scenario.n, 2)))
    arrivals = np.full(scenario.n, scenario.n_steps)
    velocities = np.full((scenario.n_steps, scenario.n, 2), 0.8)
    instance = joint_instances(nlp, form, task, [arrivals], [velocities])
    return nlp, instance.x0[0], instance.p[0]


def gradient_seconds(scenario: Scenario) -> float:
    """Median CPU time of the exact objective with its gradient."""
    nlp, x, p = instance_of(scenario)
    return median_seconds(partial(nlp.gradient, x, p))


def median_seconds(work: Callable[[], object], repeats: int = 5) -> float:
    """Median CPU time, without the first call."""
    work()
    return timed(work, repeats).cpu


def hessians(quick: bool) -> Iterable[Row]:
    """CPU time of the Lagrangian's Hessian from single steps and by automatic differentiation."""
    for n in (3, 5) if quick else (2, 3, 4, 5, 6):
        nlp, x, p = instance_of(around("paper-1", n))
        weight, multipliers = ca.MX.sym("f"), ca.MX.sym("g", nlp.g.shape[0])
        lagrangian = weight * nlp.objective + ca.dot(multipliers, nlp.g)
        second = ca.triu(ca.hessian(lagrangian, nlp.x)[0])
        automatic = ca.Function("automatic", [nlp.x, nlp.p, weight, multipliers], [second])
        values = (x, p, 1.0, np.ones(nlp.g.shape[0]))
        own = nlp.attached(LagrangianHessian)
        by_steps, by_ad = (
            median_seconds(partial(function, *values), 3) for function in (own, automatic)
        )
        yield n, f"{1e3 * by_steps:.1f} ms", f"{1e3 * by_ad:.0f} ms", f"{by_ad / by_steps:.1f}"


def newton(quick: bool) -> Iterable[Row]:
    """CPU time of Newton's equations: derivatives, factors by steps, and a dense factorisation."""
    cases = ((5, 30), (5, 120)) if quick else ((2, 30), (5, 30), (5, 120), (7, 30), (8, 30))
    for n, steps in cases:
        scenario = in_steps(around("paper-1", n), steps)
        nlp, x, p = instance_of(scenario)
        numeric = nlp.attached(NumericDerivatives)
        assert numeric is not None
        problems, rows = numeric.problems(p[None]), np.arange(1)
        at = problems.linearise(rows, x[:, None])
        none, weights = np.zeros((nlp.sizes[2], 1)), np.ones((len(x) + nlp.sizes[2], 1))
        factors = partial(at.factors, Condensation(none, 1e6 * weights), np.zeros(1))
        matrix = np.eye(len(x)) + 1.0 / len(x)
        times = (
            median_seconds(partial(problems.linearise, rows, x[:, None])),
            median_seconds(factors),
            median_seconds(partial(np.linalg.cholesky, matrix)),
        )
        yield n, steps, *(f"{1e3 * seconds:.2f} ms" for seconds in times)


def in_steps(original: Scenario, steps: int) -> Scenario:
    """A scenario of 30 steps in another number of steps, in the same time of flight."""
    factor = 30 / steps  # of the change of velocity per step
    values = {"time.dt": 9.9 / steps, "swarm.a_max": original.swarm.a_max * factor**2}
    return original.with_values(values | {"guide.a_max": original.guide_a_max * factor**2})


def horizons(quick: bool) -> Iterable[Row]:
    """Plans of five members against the number of steps in the same time of flight."""
    for steps in (15, 30, 60) if quick else (15, 30, 60, 120):
        for name in ("paper-1", "paper-2"):
            scenario = in_steps(csw.load_scenario(name), steps)
            plan, clock, cpu = timed(partial(csw.plan_swarm, scenario, certify=False))
            yield (
                name,
                steps,
                f"{plan.value:.6f}",
                plan.solution.status,
                f"{clock:.1f} s ({cpu:.1f})",
            )


def mean_field(quick: bool) -> Iterable[Row]:
    """The mean field's value of the exact plan, and the exact value of the mean field's plan."""
    for name in ("paper-1", "paper-2"):
        for n in (2, 5) if quick else (2, 4, 6, 8, 10):
            scenario = around(name, n).with_values({"hazard.alpha_1": 12.0})
            exact = csw.plan_swarm(scenario, initial_guesses=["formations"])
            estimate, value = by_mean_field(scenario, exact)
            yield name, n, f"{exact.value:.5f}", f"{estimate:.5f}", f"{value:.5f}"


def large(quick: bool) -> Iterable[Row]:
    """Plans of more members than have an exact distribution: mean field, bounds, and simulation.

    Rates are so high that losses come in cascades.
    """
    cases = (("paper-1", 12, 60.0), ("paper-2", 12, 12.0), ("paper-1", 16, 60.0))
    for name, n, strength in cases[:1] if quick else cases:
        scenario = around(name, n).with_values({"hazard.alpha_1": strength})
        guesses = ["formations"]
        planning = partial(csw.plan_swarm, scenario, initial_guesses=guesses, certify=False)
        plan, _, cpu = timed(planning)
        _, _, bounding = timed(partial(likely_sets, scenario, plan.positions))
        sample = csw.estimate(scenario, JointPolicy.from_plan(plan), 4000, tolerance=1e-4).success
        intervals = (f"{low:.6f} to {high:.6f}" for low, high in (plan.success, sample))
        yield name, n, strength, f"{plan.value:.6f}", *intervals, f"{bounding:.1f} of {cpu:.1f} s"


def by_mean_field(scenario: Scenario, exact: SwarmPlan) -> tuple[float, float]:
    """The mean field's value of a plan, and the exact value after maximising it from there."""
    form = JointForm(scenario.n, scenario.n_steps, False)
    task = JointTask.from_scenario(scenario, exact.initial_velocities)
    problem = JointProblem(scenario, task, form)
    instance = joint_instances(problem.nlp, form, task, [exact.arrivals], [exact.velocities])
    odds = float(problem.nlp.evaluate(instance.x0[0], instance.p[0])[0])
    solver = Ipopt(1e-5, 500, hessian="limited-memory", memory=20, constraint_tolerance=1e-8)
    start = InitialGuess("", exact.arrivals, exact.velocities)
    (outcome,) = problem.solve([start], solver)
    positions = problem.positions(outcome.velocities)
    distribution = PlanDistribution.from_positions(scenario, positions)
    return 1 / (1 + math.exp(odds)), 1 - distribution.failure


def replanning(quick: bool) -> Iterable[Row]:
    """The open-loop plan against replanning for survivors."""
    for name in ("gauntlet",) if quick else ("paper-1", "paper-2", "ring", "wall", "gauntlet"):
        scenario = csw.load_scenario(name)
        first = csw.plan_swarm(scenario)
        tree = PlanTree(scenario, first)
        used = time.process_time()
        policy = ReplanningPolicy(tree, JointPolicy.from_plan(first))
        success = csw.evaluate(scenario, policy, 1e-4).success
        yield (
            name,
            f"{first.value:.6f}",
            f"{success.low:.6f} to {success.high:.6f}",
            tree.solves,
            len({id(branch) for branch in tree.branches.values()}),
            tree.failures,
            f"{time.process_time() - used:.0f} s",
        )


def bounds(quick: bool) -> Iterable[Row]:
    """The bound against the number of nodes."""
    csw.success_bound(csw.load_scenario("alley"), 100_000, max_work=0)  # loads kernels
    for name in SCENARIOS[:3] if quick else SCENARIOS:
        scenario = csw.load_scenario(name)
        columns = []
        for nodes in (100_000, 1_000_000, 10_000_000):
            used = time.process_time()
            bound = csw.success_bound(scenario, nodes, max_work=0)
            columns.append(f"{bound.failure:.4g} ({1000 * (time.process_time() - used):.0f} ms)")
        yield name, *columns


TABLES: dict[str, tuple[Sequence[str], Callable[[bool], Iterable[Row]]]] = {
    "Success": (
        (
            "scenario",
            "leader",
            "joint, minimum over seeds",
            "maximum",
            "upper bound",
            "time (CPU)",
        ),
        seeds,
    ),
    "Restarts": (
        (
            "scenarios",
            "beaten by 1 %",
            "by 0.1 %",
            "worst ratio of failures",
            "better by 1 %",
            "CPU of a plan, median (total)",
            "of 40 restarts",
        ),
        restarts,
    ),
    "Members": (
        ("scenario", "n", "failure", "lower bound", "status", "gradient", "time (CPU)"),
        sizes,
    ),
    "Hessian": (("n", "from single steps", "automatic differentiation", "ratio"), hessians),
    "Newton": (("n", "steps", "derivatives", "factors by steps", "dense factors"), newton),
    "Steps": (("scenario", "steps", "success", "status", "time (CPU)"), horizons),
    "Mean field": (
        ("scenario", "n", "joint plan, exact", "joint plan, mean field", "mean-field plan, exact"),
        mean_field,
    ),
    "Large": (
        ("scenario", "n", "alpha_1", "mean field", "proven bounds", "simulated, 95 %", "CPU"),
        large,
    ),
    "Replanning": (
        ("scenario", "open loop", "replanning", "solves", "plans", "failed", "CPU"),
        replanning,
    ),
    "Bound": (("scenario", "100,000 nodes", "1,000,000 (default)", "10,000,000"), bounds),
}


def main() -> None:
    """Print the chosen tables, or all."""
    parts = {title.lower(): (title, *table) for title, table in TABLES.items()}
    options = arguments(__doc__, parts)
    for part in options.parts:
        title, columns, rows = parts[part]
        if len(options.parts) > 1:
            print(f"\n{title}\n")
        print_table(columns, rows(options.quick))


if __name__ == "__main__":
    main()
