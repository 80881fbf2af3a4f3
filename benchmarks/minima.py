"""How often the batch solvers end in a local minimum, where members collide.

Run with the installed package::

    python benchmarks/minima.py            # all kinds of states, about twenty minutes on two cores
    python benchmarks/minima.py --quick    # a tenth of the states

Every problem is solved as policies solve it, and from 96 starts. A state counts as *worse* if its
objective is more than 1 % above the best that was found. States are of simulated runs, or crowded:
five members at random in a disc around the guide's point, with random velocities.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from _timing import arguments, print_table, timed

import casswarm as csw
from casswarm.formation import Auto
from casswarm.formation.horizon_method import InteriorPoint
from casswarm.formation.projected_gradient import SpectralProjectedGradient
from casswarm.formation.task import corridor_formation, leader_formation
from casswarm.motion.step import Motion, Step
from casswarm.nlp.program import Instances, Nlp
from casswarm.nlp.solution import BatchSolution

Batches = list[tuple[Nlp, Instances]]

RUNS = {
    ("paper-2", "local"): ("leader", "constrained", "leader-mpc-3", "constrained-mpc-3"),
    ("paper-2", "global"): ("leader", "constrained", "constrained-mpc-3"),
    ("gauntlet", "global"): ("leader", "constrained", "constrained-mpc-3"),
}
"""Scenario and search of the guide, and the policies whose states are solved."""

CROWDED = (0.25, 0.4)
"""Radii of the discs of crowded states."""

BEST = Auto(batch=SpectralProjectedGradient(n_starts=96), paths=InteriorPoint(n_starts=96))


@dataclass(frozen=True)
class Recorder(Auto):
    """The default solver, which notes the problems that it is given."""

    seen: tuple[Batches, ...] = ([],)

    def solve_batch(self, nlp: Nlp, instances: Instances) -> BatchSolution:
        """Note the problems, and solve them."""
        self.seen[0].append((nlp, instances))
        return super().solve_batch(nlp, instances)


def of_runs(scenario: csw.Scenario, policy: str, states: int) -> Batches:
    """Problems of states at random from simulated runs."""
    seen: Batches = []
    guide = csw.plan(scenario, certify=False)
    recorded = csw.make_policy(policy, scenario, guide, solver=Recorder(seen=(seen,)))
    csw.simulate(scenario, [recorded], runs=200, guide=guide)
    total = sum(len(instances) for _, instances in seen)
    rng = np.random.default_rng(0)
    chosen = rng.random(total) < states / total
    batches, first = [], 0
    for nlp, instances in seen:
        rows = chosen[first : first + len(instances)]
        first += len(instances)
        if rows.any():
            batches.append((nlp, instances[rows]))
    return batches


def crowded(scenario: csw.Scenario, policy: str, radius: float, states: int) -> Batches:
    """Problems of members at random in a disc around a point of the guide."""
    rng, n, guide = np.random.default_rng(0), scenario.n, csw.plan(scenario, certify=False)
    steps = rng.integers(3, scenario.n_steps - 3, states)
    here, there = (np.array([guide.reference(t + s) for t in steps]) for s in (0, 1))
    angle = rng.uniform(0.0, 2.0 * np.pi, (states, n))
    distance = radius * np.sqrt(rng.random((states, n)))
    offsets = distance[..., None] * np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    velocities = ((there - here) / scenario.time.dt)[:, None] + rng.normal(0, 0.3, (states, n, 2))
    motion = Motion.from_scenario(scenario)
    step = Step(
        scenario.hazard,
        motion,
        here[:, None] + offsets,
        np.clip(velocities, -motion.v_max, motion.v_max),
        np.ones((states, n), bool),
        there[None],
    )
    if policy == "leader":
        formation = leader_formation(step, np.argmin(distance, axis=1))
    else:
        formation = corridor_formation(step, scenario.formation.rho)
    rows = formation.free.any(axis=1)
    return [(formation.nlp, formation.instances[rows])]


def kinds(states: int) -> Iterator[tuple[str, Batches]]:
    """Names of the kinds of states, and their problems."""
    for (name, search), policies in RUNS.items():
        scenario = csw.load_scenario(name).with_values({"guide.search": search})
        for policy in policies:
            count = states // 5 if "mpc" in policy else states
            yield f"{name}, {search} guide, {policy}", of_runs(scenario, policy, count)
    scenario = csw.load_scenario("paper-2")
    for policy in ("leader", "constrained"):
        for radius in CROWDED:
            problems = crowded(scenario, policy, radius, states // 5)
            yield f"paper-2, crowded within {radius}, {policy}", problems


def main() -> None:
    """Print a row for every kind of states."""
    options = arguments(__doc__)
    rows = []
    for name, batches in kinds(250 if options.quick else 2500):
        excess, seconds = [], 0.0
        for nlp, instances in batches:
            seconds += timed(lambda p=nlp, i=instances: Auto().solve_batch(p, i)).wall
            found, best = (s.solve_batch(nlp, instances).objective for s in (Auto(), BEST))
            excess.append(found / np.minimum(found, best) - 1.0)
        relative = np.concatenate(excess)
        worse = int((relative > 0.01).sum())
        count = f"{worse} of {len(relative)} ({worse / len(relative):.2%})"
        time = f"{1e6 * seconds / len(relative):.1f} us"
        rows.append([name, count, f"{relative.max():.1%}", time])
    print_table(["states", "worse by more than 1 %", "worst", "time per state"], rows)


if __name__ == "__main__":
    main()
