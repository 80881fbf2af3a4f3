"""Law of a controlled chain by brute force: states are neither shared nor aggregated."""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Callable
from itertools import product

import numpy as np
from numpy.typing import NDArray

from casswarm import Policy, Scenario

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]
Outcome = tuple[int, int]  # arrival step (-1: none), survivors
Move = Callable[[int, Array, Array, Flags], Array]


def law_by_hand(
    scenario: Scenario,
    previous: Array,
    move: Move,
    rates: Callable[[Array, Flags], Array] | None = None,
) -> dict[Outcome, float]:
    """Probabilities of all outcomes, by recursion over the fates of all members.

    `move` returns the positions (n, 2) after a step from positions, previous velocities, and who is
    alive; data of destroyed members are 0. `rates` are the scenario's by default, with the means
    over the parts of a step, and the number of arrivals that ends a run is the scenario's, too.
    """
    law: dict[Outcome, float] = defaultdict(float)
    dt, m = scenario.time.dt, scenario.time.substeps

    def rated(step: int, x: Array, following: Array, alive: Flags) -> Array:
        if rates is not None:
            return rates(following, alive)
        parts = [(k / m, (step + k / m) * dt) for k in range(1, m + 1)]
        points = [((1 - share) * x + share * following, time) for share, time in parts]
        return np.mean([scenario.hazard.rates(p, alive, time=t) for p, t in points], axis=0)

    def follow(step: int, x: Array, previous: Array, alive: Flags, weight: float) -> None:
        if not alive.any() or step == scenario.n_steps:
            law[-1, int(alive.sum())] += weight
            return
        x, previous = x * alive[:, None], previous * alive[:, None]
        following = move(step, x, previous, alive)
        survival = np.exp(-dt * rated(step, x, following, alive))
        targets = [(scenario.target.center, scenario.target.radius)]
        targets += [(disc.center, disc.radius) for disc in scenario.target.other]
        arrived = [any(math.dist(x, c) <= r for c, r in targets) for x in following]
        for fate in product((False, True), repeat=len(alive)):
            survivors = np.array(fate)
            if (survivors & ~alive).any():
                continue
            mass = weight * np.prod(np.where(survivors, survival, 1 - survival)[alive])
            inside = survivors & arrived & scenario.swarm.counting
            if inside.sum() >= scenario.success.arrivals:
                law[step + 1, sum(fate)] += mass
            else:
                follow(step + 1, following, (following - x) / dt, survivors, mass)

    follow(0, scenario.positions, previous, np.ones(scenario.n, bool), 1.0)
    return law


def commanded(scenario: Scenario, policy: Policy) -> Move:
    """Motion by the velocities of a policy."""

    def move(step: int, x: Array, previous: Array, alive: Flags) -> Array:
        return x + scenario.time.dt * policy.velocities(step, x, previous, alive)

    return move


def success_of(law: dict[Outcome, float]) -> float:
    """Probability of an arrival."""
    return sum(chance for (arrival, _), chance in law.items() if arrival > 0)
