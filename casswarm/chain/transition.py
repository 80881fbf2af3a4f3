"""The deterministic part of a step of the chain, on a lattice where states may be rounded.

The paper's section II.C: observe positions and living members, decide, move; then member i survives
with probability exp(-dt lambda_i(X(t+1), alive(t))).

**News that is late.** With ``information.delay`` d, members know at step t who was alive at t - d.
A policy gets those as the living. Who is lost and not known to be is a ghost: it moves as the
policy would move it, and has neither a rate nor a density.

**Lattice.** A policy decides only to the accuracy of its solver, so states that are equal in exact
arithmetic differ in their last digits, and so do all of their successors. On a lattice a member's
command is rounded so that the member moves to a lattice point: the nearest one or, where that
exceeds v_max or a_max, the nearest of the nine around it that does not. Where none of them is
allowed, which takes a set thinner than the lattice, the command is executed as it is. This is a
policy of its own, whose commands differ from the given policy's by at most 3/2 spacing / dt in each
component, and in which states coincide exactly.

The lattice moves with the guide. So a member on the guide stays exactly on it, members that gather
around it coincide, and which of them leads is not decided by rounding.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from .._util.numbers import SPEED_TOL
from ..compiled.kernels import contiguous
from ..errors import PolicyError
from ..hazard import subdivided
from ..motion.planar import PlanarSets
from ..motion.step import Motion
from ..policies.base import Policy, checked_velocities
from ..typing import BoolArray, FloatArray, IntArray
from .belief import Observation
from .states import States, Step

if TYPE_CHECKING:
    from ..guide.guide import Guide
    from ..scenario import Scenario


_NEIGHBOURS = np.array(list(product((0.0, -1.0, 1.0), repeat=2)))  # the nearest point comes first
_COARSEST = 1 / 8  # spacing, in displacements that v_max and a_max allow
_FINEST = 1e-13  # spacing, in the scenario's largest coordinate: indices remain exact


@dataclass(frozen=True, eq=False)
class Lattice:
    """Square lattice of positions that moves along a path.

    Parameters
    ----------
    path : (N+1, 2)
        A point of the lattice at every step.
    spacing : float
    dt, v_max : float
    """

    path: FloatArray
    spacing: float
    dt: float
    v_max: float

    @classmethod
    def along(
        cls, guide: Guide, scenario: Scenario, spacing: float | None, accuracy: float = 0.0
    ) -> Lattice | None:
        """Lattice that moves with a guide.

        Parameters
        ----------
        guide : Guide
        scenario : Scenario
        spacing : float, optional
            By default as near to `accuracy` v_max dt as is allowed; 0 for no lattice.
        accuracy : float
            0 for no lattice.

        Returns
        -------
        Lattice, or None

        Raises
        ------
        PolicyError
            The spacing is so large that members could not move, or too small for double precision.
        """
        motion = Motion.from_scenario(scenario)
        path = np.stack([guide.reference(step) for step in range(scenario.n_steps + 1)])
        reach, slowest = motion.dt * motion.v_max, motion.dt * float(motion.limits[:, :2].min())
        extent = max(np.abs(scenario.positions).max(), np.abs(path).max())
        finest = _FINEST * (float(extent) + scenario.n_steps * reach)
        coarsest = _COARSEST * slowest
        if spacing is None:
            allowed = accuracy > 0 and finest <= coarsest
            spacing = min(max(accuracy * reach, finest), coarsest) if allowed else 0.0
        if spacing != 0.0 and not finest <= spacing <= coarsest:
            raise PolicyError(
                f"aggregation_tol = {spacing:g}; allowed: 0, or from {finest:.3g}, for double "
                f"precision, to {coarsest:.3g}, a part of what members can move in a step",
                key="aggregation_tol",
                value=spacing,
            )
        return cls(path, spacing, motion.dt, motion.v_max) if spacing else None

    def moved(
        self, step: int, positions: FloatArray, velocities: FloatArray, sets: PlanarSets
    ) -> tuple[FloatArray, FloatArray]:
        """Velocities and positions (B, n, 2) of a step to lattice points near the commanded ones.

        Equal indices of lattice points give equal results to the last bit.

        Parameters
        ----------
        step : int
            t.
        positions, velocities : (B, n, 2)
            X(t), and the commanded velocities, within their sets.
        sets : PlanarSets, shape (B, n)
            Velocities that v_max and a_max allow.
        """
        start = self._indices(step, positions)
        commanded = positions + self.dt * velocities
        exact = (commanded - self.path[step + 1]) / self.spacing
        goals = np.rint(exact)
        moves = self._velocities(step, goals - start)
        exceeds = self._exceeds(sets, moves)
        if exceeds.any():
            rows = np.nonzero(exceeds)
            goals[rows] = self._allowed(step, start[rows], exact[rows], sets[exceeds])
            moves[rows] = self._velocities(step, goals[rows] - start[rows])
        following = self.path[step + 1] + self.spacing * goals
        if exceeds.any():
            exceeds = self._exceeds(sets, moves)  # only next to limits that hold a sliver
            moves[exceeds], following[exceeds] = velocities[exceeds], commanded[exceeds]
        return moves, following

    def _indices(self, step: int, positions: FloatArray) -> FloatArray:
        """Positions in spacings: whole numbers for lattice points, to the last bit."""
        indices = (positions - self.path[step]) / self.spacing
        nearest = np.rint(indices)
        on = self.path[step] + self.spacing * nearest == positions
        return np.asarray(np.where(on, nearest, indices))

    def _velocities(self, step: int, moves: FloatArray) -> FloatArray:
        """Velocities of moves, in spacings relative to the path."""
        own = self.path[step + 1] - self.path[step]
        return np.asarray((own + self.spacing * moves) / self.dt)

    def _exceeds(self, sets: PlanarSets, velocities: FloatArray) -> BoolArray:
        return np.asarray(sets.violation(velocities) > SPEED_TOL * self.v_max)

    def _allowed(
        self, step: int, start: FloatArray, exact: FloatArray, sets: PlanarSets
    ) -> FloatArray:
        """The allowed goal (R, 2) nearest to the exact one among the nine around, if any."""
        nearest = np.rint(exact)
        best, least = nearest.copy(), np.full(len(exact), np.inf)
        for offset in _NEIGHBOURS:
            other = nearest + offset
            distance = np.hypot(*(other - exact).T)
            distance[self._exceeds(sets, self._velocities(step, other - start))] = np.inf
            nearer = distance < least
            best[nearer], least[nearer] = other[nearer], distance[nearer]
        return best


COUNTS = ("infeasible", "solver_failures", "fallbacks", "saturated")
"""Counts of a step: infeasible, failures and fallbacks as in `Decision`, and the number of members
whose velocity was projected to respect v_max and a_max."""

SATURATION_TOL = 1e-9
"""Excess over v_max or a_max, relative to v_max, up to which a projected velocity is not counted:
solvers meet limits to about this accuracy."""


@dataclass(frozen=True, eq=False)
class Transition:
    """Result of a policy's step from B states, before survival is drawn.

    Parameters
    ----------
    velocities, positions : (B, n, 2)
        V(t), within v_max and a_max, and X(t+1).
    survival : (B, n)
        Probability that a living member survives the step; 1, without meaning, for the destroyed.
    inside : (B, n) bool
        Members in the target zone at X(t+1), of those that count.
    arrivals : int
        Number of survivors among these that ends the run.
    counts : dict of name to (B,) int
        The counts of `COUNTS`.
    late : (B, n) int, optional
        Number of steps after t + 1 until the loss of a member that does not survive is known.
    case : (B,) int, optional
        The true case of a hazard that is not known.
    observation : Observation, optional
        What beliefs follow from, where states include them.
    """

    velocities: FloatArray
    positions: FloatArray
    survival: FloatArray
    inside: BoolArray
    arrivals: int
    counts: dict[str, IntArray]
    late: IntArray | None = None
    case: IntArray | None = None
    observation: Observation | None = None

    def step(self, states: States, absorption: FloatArray | None = None) -> Step:
        """The step of states as kernels take it.

        Parameters
        ----------
        states : States
            The B states.
        absorption : (B, n), optional
            Probability that a surviving member is absorbed, by default 1 in the target zone.
        """
        if absorption is None:
            absorption = self.inside.astype(float)
        rows = contiguous(states.weights), contiguous(self.survival), contiguous(absorption)
        return Step(*rows, contiguous(states.alive), self.arrivals)

    def believed(self, parents: IntArray, survived: BoolArray) -> BoolArray:
        """Members (K, n) that are not known to be lost after the step."""
        return survived if self.late is None else survived | (self.late[parents] > 0)

    def following(self, parents: IntArray, survived: BoolArray, weights: FloatArray) -> States:
        """States (K,) after the step: of which state, who survived it, and with which weight."""
        late = None if self.late is None else np.where(survived, 0, self.late[parents])
        believed = self.believed(parents, survived)[..., None]
        return States(
            np.where(believed, self.positions[parents], 0.0),
            np.where(believed, self.velocities[parents], 0.0),
            survived,
            weights,
            late,
            None if self.case is None else self.case[parents],
            None if self.observation is None else self.observation.posterior(parents, survived),
        )


def transition(
    scenario: Scenario,
    policy: Policy,
    step: int,
    states: States,
    lattice: Lattice | None = None,
) -> Transition:
    """Advance B states from `step` to step + 1; on a lattice, to lattice points.

    Raises
    ------
    PolicyError, HazardError
        Velocities or rates of the wrong shape, or not finite.
    """
    positions, previous_velocities, believed = map(
        _read_only, (states.positions, states.previous_velocities, states.believed)
    )
    if states.belief is not None:
        policy = policy.given(states.belief)
    decision = policy.decide(step, positions, previous_velocities, believed)
    commanded = checked_velocities(policy.name, step, decision.velocities, believed)
    motion = Motion.from_scenario(scenario)
    sets = motion.sets(previous_velocities)
    excess = np.where(believed, sets.violation(commanded) / motion.v_max, 0.0)
    exceeds = excess > SPEED_TOL
    velocities = commanded.copy()
    if exceeds.any():
        velocities[exceeds] = sets[exceeds].project(commanded[exceeds])
    if lattice is None:
        following = positions + scenario.time.dt * velocities
    else:
        velocities, following = lattice.moved(step, positions, velocities, sets)
    saturated = (excess > SATURATION_TOL).sum(axis=1)
    counts = decision.infeasible, decision.failures, decision.fallbacks, saturated
    survival, observation = _survival(scenario, step, positions, following, states)
    return Transition(
        velocities=velocities,
        positions=following,
        survival=survival,
        inside=scenario.swarm.counted(scenario.target.contains(following)),
        arrivals=scenario.success.arrivals,
        counts=dict(zip(COUNTS, counts, strict=True)),
        late=_lateness(scenario, states),
        case=states.case,
        observation=observation,
    )


def _lateness(scenario: Scenario, states: States) -> IntArray | None:
    """Number of steps (B, n) after this one until a loss is known: in it, or before it."""
    if states.late is None:
        return None
    if scenario.delay is None:  # never: what is lost stays believed
        return np.where(states.alive, 1, states.late)
    return np.where(states.alive, scenario.delay, np.maximum(states.late - 1, 0))


def _survival(
    scenario: Scenario, step: int, before: FloatArray, after: FloatArray, states: States
) -> tuple[FloatArray, Observation | None]:
    """Probabilities (B, n) of surviving a step in the true cases, and what is observed of them."""
    if states.case is None:
        rates = _rates(scenario, step, before, after, states.alive)
        return np.exp(-scenario.time.dt * rates), None
    every = np.arange(len(states))
    survival = np.ones((len(scenario.cases), *states.alive.shape))
    for k, case in enumerate(scenario.cases):
        rows = every if states.belief is not None else np.flatnonzero(states.case == k)
        path = before[rows], after[rows], states.alive[rows]
        survival[k, rows] = np.exp(-scenario.time.dt * _rates(case.scenario, step, *path))
    seen = None
    if states.belief is not None:
        seen = Observation(states.belief, states.alive, survival)
    return survival[states.case, every], seen


def _rates(
    scenario: Scenario, step: int, before: FloatArray, after: FloatArray, alive: BoolArray
) -> FloatArray:
    """Rates (B, n) of a step from positions (B, n, 2) to others: means over its parts."""
    parts = scenario.time.substeps
    hazard, path = scenario.by_parts.hazard, subdivided(np.stack([before, after]), parts)
    rates = [hazard.after(parts * step + k).rates(path[k], alive) for k in range(1, parts + 1)]
    return rates[0] if parts == 1 else np.asarray(np.mean(rates, axis=0))


def _read_only(array: NDArray[Any]) -> NDArray[Any]:
    """A view that a policy cannot write to, so that it cannot change the state."""
    view = array.view()
    view.flags.writeable = False
    return view
