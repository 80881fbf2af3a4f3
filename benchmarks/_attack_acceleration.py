"""The claim about guides with limits of acceleration: no such path is below the bound."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from _attack_model import Rates, shortened
from _attack_records import Check
from _attack_scenarios import Rng

import casswarm as csw

_PATHS, _ROUNDS, _TRIALS = 3000, 40, 100
_EPS = 2.0**-52


class _Limited:
    """Velocities (B, T, 2) of paths within all limits, and their risks, all steps counted."""

    def __init__(self, scenario: csw.Scenario, radius: float) -> None:
        self.scenario, self.radius = scenario, radius
        self.rates = Rates.from_scenario(scenario)

    def projected(self, velocities: np.ndarray) -> np.ndarray:
        """Velocities changed, one step after the other, to obey the limits."""
        scenario = self.scenario
        previous = scenario.swarm.velocity
        within = shortened(scenario, velocities)
        for step in range(velocities.shape[1]):
            if step == 0 and previous == "guide":
                continue
            last = np.asarray(previous, float) if step == 0 else within[:, step - 1]
            a_max = scenario.swarm.a_max if step == 0 else scenario.guide_a_max
            change = within[:, step] - last
            length = np.hypot(*change.T)[:, None]
            change *= np.minimum(1.0, np.sqrt(a_max) / np.maximum(length, 1e-300))
            within[:, step] = shortened(scenario, last + change)
        return within

    def risks(self, velocities: np.ndarray) -> np.ndarray:
        """Least risk (B,) of each path up to a step in the smaller target; infinite without one."""
        scenario, count = self.scenario, len(velocities)
        positions = np.tile(np.asarray(scenario.guide_start, float), (count, 1))
        risks, least = np.zeros(count), np.full(count, np.inf)
        for step in range(min(velocities.shape[1], scenario.n_steps)):
            positions = positions + scenario.time.dt * velocities[:, step]
            risks += scenario.time.dt * self.rates.after(step + 1).single(positions)
            inside = scenario.target.distances(positions) <= self.radius
            least = np.where(inside, np.minimum(least, risks), least)
        return least


def acceleration(rng: Rng, scenario: csw.Scenario, guide: csw.Guide) -> Iterator[Check]:
    """No path within the limits that ends as deep in the target is below the bound."""
    proof = None if guide.certificate is None else guide.certificate.accelerated
    if proof is None:
        return
    limited = _Limited(scenario, proof.radius * (1 - 1e-12))
    dt, v_max, steps = scenario.time.dt, scenario.swarm.v_max, scenario.n_steps
    straight = (np.array(scenario.target.center) - scenario.guide_start) / (steps * dt)
    noise = 10 ** rng.uniform(-2, 0.5, size=(_PATHS, 1, 1)) * v_max
    noise = noise * rng.normal(size=(_PATHS, steps, 2))
    starts = [straight * rng.uniform(1, 3, size=(_PATHS, 1, 1)) + noise]
    starts += [c.velocities[None] for c in guide.best_per_homotopy_class()[:3]]
    for part, start in enumerate(starts):
        velocities = limited.projected(start)
        least, scale = limited.risks(velocities), 0.03 * v_max
        path, risk = velocities[least.argmin()], float(least.min())
        for _ in range(_ROUNDS):
            change = np.cumsum(rng.normal(size=(_TRIALS, *path.shape)), axis=1)
            change *= scale * 10 ** rng.uniform(-2, 0, size=(_TRIALS, 1, 1))
            trials = limited.projected(path + change - change.mean(axis=1, keepdims=True))
            values = limited.risks(trials)
            if values.min() < risk:
                path, risk = trials[values.argmin()], float(values.min())
            else:
                scale *= 0.8
        if np.isfinite(risk):
            limit = 64 * _EPS * steps * risk
            detail = f"bound {proof.bound!r}, risk {risk!r}"
            yield Check(f"acceleration, start {part}", proof.bound - risk, limit, detail)
