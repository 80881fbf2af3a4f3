"""The model from its equations in plain NumPy, independent of casswarm's own: docs/model.md.

Rates (8) and (9) with the regularisation at short distances, the enumeration of the chain (1), and
projections onto the sets of one member by Dykstra's algorithm.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
from _attack_scenarios import limits_of

import casswarm as csw
from casswarm.scenario.members import MemberKind
from casswarm.scenario.radars import Radar
from casswarm.scenario.zones import ZoneTable

_CORE = 0.01  # where the hazard does not state its core radius


@dataclass(frozen=True)
class Rates:
    """Rates of the paper's two scenarios, with radars in time and zones."""

    radars: np.ndarray
    strengths: np.ndarray
    alpha: tuple[float, float, float]
    beta: tuple[float, float] | None
    core: float
    tracks: tuple[Radar, ...] = ()
    dt: float = 0.0
    zones: tuple[ZoneTable, ...] = ()
    parts: int = 1
    kinds: tuple[MemberKind, ...] = ()

    @classmethod
    def from_scenario(cls, scenario: csw.Scenario) -> Rates:
        """Rates from the numbers of a scenario's hazard table."""
        table = scenario.hazard_table
        radars = np.array(table.radars, float).reshape(-1, 2)
        strengths = np.ones(len(radars)) if table.strengths is None else np.array(table.strengths)
        beta = None if table.beta_1 is None else (table.beta_1, table.beta_2)
        alpha = table.alpha_1, table.alpha_2, table.alpha_3
        core = getattr(scenario.hazard.after(1), "core_radius", None) or _CORE
        return cls(
            *(radars, strengths, alpha, beta, float(core)),
            *(tuple(table.radar), scenario.time.dt, tuple(table.zone)),
            scenario.time.substeps,
            scenario.swarm.member_kinds,
        )

    def after(self, step: float) -> Rates:
        """Rates with all radars where they are, and as strong as they are, after a step."""
        if not self.tracks:
            return self
        radars, strengths, time = list(self.radars), list(self.strengths), step * self.dt
        for track in self.tracks:
            place = np.array(track.position or (0.0, 0.0)) + time * np.array(
                track.velocity or (0.0, 0.0)
            )
            if track.path:
                times, *axes = np.array(track.path, float).T
                place = np.array([np.interp(time, times, axis) for axis in axes])
            now = time * (1 - 1e-9)  # a step that ends with an interval is in it
            on = track.active is None or any(begin < now <= end for begin, end in track.active)
            radars.append(place)
            strengths.append(track.strength * on)
        return replace(self, radars=np.array(radars), strengths=np.array(strengths), tracks=())

    def over(self, step: int, before: np.ndarray, after: np.ndarray, *alive: np.ndarray) -> Any:
        """Rates of a step, means over its parts: of members if some are `alive`, else single."""
        total = 0.0
        for k in range(1, self.parts + 1):
            share = k / self.parts
            rates, points = self.after(step + share), (1 - share) * before + share * after
            total = total + (rates.members(points, *alive) if alive else rates.single(points))
        return total / self.parts

    def along(self, path: np.ndarray) -> np.ndarray:
        """Rates (T,) of a single agent in the steps of a path (T + 1, 2)."""
        if not self.tracks and self.parts == 1:
            return self.single(path[1:])
        return np.array([self.over(t, *path[t : t + 2]) for t in range(len(path) - 1)])

    def single(self, points: np.ndarray) -> np.ndarray:
        """Rates (...) of a single agent at points (..., 2)."""
        squared = ((points[..., None, :] - self.radars) ** 2).sum(axis=-1)
        rates = self.alpha[0] / (1 + self.alpha[1]) * (self.strengths / self._core(squared)).sum(-1)
        return rates + self.of_zones(points)

    def of_zones(self, points: np.ndarray) -> np.ndarray:
        """Rates (...) of a single agent in zones at points (..., 2)."""
        total = np.zeros(points.shape[:-1])
        for zone in self.zones:
            u = np.minimum(_distances(zone, points) / zone.edge, 1.0)
            total += zone.rate * (1 - u) ** 3 * (1 + 3 * u + 6 * u**2)
        return total

    def members(self, positions: np.ndarray, alive: np.ndarray) -> np.ndarray:
        """Rates (n,) of members at positions (n, 2), without meaning for the destroyed."""
        rates = np.empty(len(positions))
        for i, x in enumerate(positions):
            others = [j for j in np.flatnonzero(alive) if j != i]
            pairs = [float(((x - positions[j]) ** 2).sum()) for j in others]
            density = self.kinds[i].density
            for j, pair in zip(others, pairs, strict=True):
                density += self.kinds[j].density / (1 + self.alpha[2] * pair)
            squared = ((x - self.radars) ** 2).sum(axis=-1)
            source = self.alpha[0] * float((self.strengths / self._core(squared)).sum())
            source += (1 + self.alpha[1]) * float(self.of_zones(x))
            rates[i] = self.kinds[i].exposure * source / (1 + self.alpha[1] * density)
            if self.beta is not None:
                one, two = self.beta
                rates[i] += sum((one / np.sqrt(self._core(np.array(p)))) ** two for p in pairs)
        return rates

    def _core(self, squared: np.ndarray) -> np.ndarray:
        core = self.core**2
        return np.where(squared >= core, squared, (core + squared**2 / core) / 2)


def shortened(scenario: csw.Scenario, velocities: np.ndarray, factor: float = 1.0) -> np.ndarray:
    """Velocities (..., 2) within the limits of speed, times a factor."""
    limit = factor * limits_of(scenario)[0]
    within = np.clip(velocities, -limit, limit)
    if scenario.swarm.speed == "box":
        return within
    length = np.hypot(within[..., 0], within[..., 1])[..., None]
    return within * np.minimum(1.0, limit / np.maximum(length, 1e-300))


def speed(scenario: csw.Scenario, velocities: np.ndarray) -> float:
    """Largest speed of velocities (..., 2), relative to its limit."""
    box = scenario.swarm.speed == "box"
    largest = np.abs(velocities) if box else np.hypot(velocities[..., 0], velocities[..., 1])
    return float((largest / limits_of(scenario)[0]).max())


def _distances(zone: ZoneTable, points: np.ndarray) -> np.ndarray:
    """Distances (...) of points (..., 2) from the disc or polygon of a zone."""
    if zone.vertices is None:
        return np.maximum(np.hypot(*np.moveaxis(points - zone.center, -1, 0)) - zone.radius, 0.0)
    corners = np.array(zone.vertices)
    sides = np.roll(corners, -1, axis=0) - corners
    offsets = points[..., None, :] - corners
    part = np.clip((offsets * sides).sum(-1) / (sides**2).sum(-1), 0.0, 1.0)
    nearest = np.hypot(*np.moveaxis(offsets - part[..., None] * sides, -1, 0)).min(axis=-1)
    turns = sides[:, 0] * offsets[..., 1] - sides[:, 1] * offsets[..., 0]
    inside = (turns >= 0).all(axis=-1) | (turns <= 0).all(axis=-1)
    return np.where(inside, 0.0, nearest)


class Outcomes(NamedTuple):
    """Distribution of the outcomes: arrival (N+1,), survivors (n+1,), members (n,)."""

    arrival: np.ndarray
    survivors: np.ndarray
    members: np.ndarray


def enumerate_chain(
    scenario: csw.Scenario, policy: csw.Policy, initial_velocities: np.ndarray
) -> Outcomes:
    """The chain's distribution by recursion over all losses, state by state, equation (1).

    A policy gets as alive those who lived ``information.delay`` steps ago.
    """
    rates, n, steps = Rates.from_scenario(scenario), scenario.n, scenario.n_steps
    dt, delay = scenario.time.dt, scenario.information.delay
    targets = [scenario.target, *scenario.target.other]
    outcomes = Outcomes(np.zeros(steps + 1), np.zeros(n + 1), np.zeros(n))

    def end(alive: np.ndarray, mass: float) -> None:
        outcomes.survivors[alive.sum()] += mass
        outcomes.members[alive] += mass

    def visit(x: np.ndarray, v: np.ndarray, lived: list[np.ndarray], mass: float) -> None:
        step, alive = len(lived) - 1, lived[-1]
        if step == steps or not alive.any():
            return end(alive, mass)
        believed = lived[0 if delay == "never" else max(0, step - delay)]
        x, v = np.where(believed[:, None], x, 0.0), np.where(believed[:, None], v, 0.0)
        velocities = policy.velocities(step, x, v, believed)
        following = x + dt * velocities
        survival = np.exp(-dt * rates.over(step, x, following, alive))
        distances = [np.hypot(*(following - each.center).T) - each.radius for each in targets]
        counting = [kind.counts for kind in rates.kinds]
        inside = (np.min(distances, axis=0) <= 0) & counting
        living = np.flatnonzero(alive)
        for lives in itertools.product([True, False], repeat=len(living)):
            after = np.zeros(n, bool)
            after[living] = lives
            share = float(np.prod(np.where(lives, survival[living], 1 - survival[living])))
            if (after & inside).sum() >= scenario.success.arrivals:
                outcomes.arrival[step + 1] += mass * share
                end(after, mass * share)
            elif share > 0:
                visit(following, velocities, [*lived, after], mass * share)
        return None

    visit(np.array(scenario.positions), initial_velocities, [np.ones(n, bool)], 1.0)
    return outcomes


def project(
    points: np.ndarray,
    lower: np.ndarray,
    upper: np.ndarray,
    centers: np.ndarray,
    radii: np.ndarray,
    sweeps: int = 3000,
) -> np.ndarray:
    """Project points (m, 2) onto boxes and discs (m, K, 2), (m, K), by Dykstra's algorithm."""
    x = points.copy()
    count = radii.shape[-1]
    corrections = np.zeros((count + 1, *x.shape))
    for sweep in range(sweeps):
        before, memory = x.copy(), corrections.copy()
        for k in range(count + 1):
            y = x + corrections[k]
            if k == count:
                x = np.clip(y, lower, upper)
            else:
                offset = y - centers[:, k]
                length = np.hypot(offset[:, 0], offset[:, 1])
                factor = np.minimum(1.0, radii[:, k] / np.maximum(length, 1e-300))
                x = centers[:, k] + offset * factor[:, None]
            corrections[k] = y - x
        if sweep and np.array_equal(x, before) and np.array_equal(corrections, memory):
            break
    return x
