"""Initial guesses of joint plans: the best of some families, and changes of the best plan."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from ...problems.joint_instances import JointTask
from ...typing import FloatArray
from ..plan import plan_from
from .changes import changes
from .distribution import MAX_EXACT
from .families import class_paths, families, waves
from .screening import InitialGuess, delayed, screened, track

if TYPE_CHECKING:
    from ...scenario import Scenario

INITIAL_GUESSES = ("formations", "own", "waves", "perturbed")
"""Kinds of initial guesses: formations, members' own paths, random ones, and changes of the best
plan."""

_AMPLITUDE = 0.1  # of perturbations, in units of v_max
_WAVES = 4
_PERTURBED = ", perturbed"


@dataclass(frozen=True, eq=False)
class Guesses:
    """The initial guesses of one joint plan.

    Parameters
    ----------
    scenario : Scenario
    task : JointTask
    objective : str
    """

    scenario: Scenario
    task: JointTask
    objective: str

    @cached_property
    def paths(self) -> dict[str, list[FloatArray]]:
        """Paths (T+1, 2) of a single agent by homotopy class; see `class_paths`."""
        scenario = self.scenario
        values = {
            "guide.arrival": "any",
            "guide.acceleration_limited": True,
            "guide.margin": 1e-3 * scenario.target.radius,  # the joint plan decides on the offsets
        }
        guide = plan_from(
            scenario.with_values(values),
            scenario.guide_start,
            search="global",
            initial_velocity=self.task.initial_velocities[0],
        )
        return class_paths(scenario, guide)

    def first(self, kinds: Sequence[str], count: int) -> list[InitialGuess]:
        """The best formations and own paths, where they are among the kinds.

        Formations where members' own paths do not apply.
        """
        own = "own" in kinds and 1 < self.scenario.n <= MAX_EXACT
        formations = "formations" in kinds or not (own or "waves" in kinds)
        if not own and not formations:
            return []
        found = families(self.scenario, self.task, self.paths, formations, own)
        return screened(self.scenario, self.task, self.objective, list(found), count)

    def waves(self, count: int, rng: np.random.Generator) -> list[InitialGuess]:
        """Random guesses; their cost before they are optimised tells too little to choose."""
        family = waves(self.task, count, rng)
        arrivals = delayed(self.task, family.arrivals)
        velocities = track(self.task, family.goals)
        return [
            InitialGuess(family.name, arrivals[k], velocities[: family.last(k), k])
            for k in range(count)
        ]

    def changed(self, plan: InitialGuess, count: int, rerouted: bool = True) -> list[InitialGuess]:
        """The best changes of a plan, before they are optimised; none without an exact cost.

        `rerouted` tells whether members take other paths, which needs the guide's.
        """
        if not 1 < self.scenario.n <= MAX_EXACT:
            return []
        found = changes(self.task, plan, self.paths if rerouted else {})
        return screened(self.scenario, self.task, self.objective, list(found), count)

    def perturbed(self, plan: InitialGuess, rng: np.random.Generator) -> InitialGuess:
        """The plan with random low-frequency waves added to every member's velocity."""
        steps, n, _ = plan.velocities.shape
        phases = np.linspace(0.0, np.pi, steps)[:, None] * np.arange(_WAVES)
        amplitudes = rng.normal(size=(_WAVES, n, 2)) / np.sqrt(_WAVES)
        waves = np.tensordot(np.cos(phases), amplitudes, axes=1)
        return replace(
            plan,
            name=f"{plan.name.removesuffix(_PERTURBED)}{_PERTURBED}",
            velocities=plan.velocities + _AMPLITUDE * self.task.motion.v_max * waves,
        )
