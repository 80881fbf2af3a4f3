"""The success of a policy and its gradient, along all histories of losses that are followed.

For every history of losses, the states and their probabilities are smooth functions of the
parameters, but for kinks of measure zero. A forward sweep enumerates the states, step by step; a
backward sweep gives the value of every state and its derivatives (the adjoint recursion of
``docs/policy-gradients.md``). Equal states are one state: the value of a state does not depend on
how it was reached.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import casadi as ca
import numpy as np

from .._util.threads import locked_cache
from ..hazard import Hazard
from ..policies.parametric import BatchFunction, ParametricPolicy
from ..typing import BoolArray, FloatArray, IntArray
from . import gradient_kernels as kernels
from .outcome_kernels import Outcomes, Step, Totals
from .states import States, outcomes
from .transition import Lattice, Transition, transition

if TYPE_CHECKING:
    from ..scenario import Scenario

_BEFORE_MERGING = 0.1
"""Share of what may be left out that outcomes may have before equal ones are identified."""

_PER_STATE = 32
"""Largest number of outcomes before that, per state that may be followed."""


@dataclass(frozen=True)
class FollowingOptions:
    """What is followed, and how arrivals are counted.

    Parameters
    ----------
    tolerance : float
        Probability mass that may be left out.
    max_states : int
        Maximum number of states; more is left out where it does not suffice.
    arrival_smoothing : float
        w: a member at the distance d from the target's centre is absorbed with a probability that
        increases smoothly from 0 at d = R, the radius, to 1 at d = R - w. With 0 all members in the
        target are absorbed.
    lattice : Lattice, optional
        Lattice of the positions, on which nearly equal states become equal. Rounding to it is
        differentiated as if it were none.
    """

    tolerance: float
    max_states: int
    arrival_smoothing: float = 0.0
    lattice: Lattice | None = None


@dataclass(frozen=True, eq=False)
class FollowedStep:
    """The states of a step that are followed, and where they lead.

    Parameters
    ----------
    states : States
    move : Transition
    step : Step
    arrival_slopes : (S, n, 2)
        Derivatives of the probabilities of absorption with respect to X(t+1).
    edges : Edges
    """

    states: States
    move: Transition
    step: Step
    arrival_slopes: FloatArray
    edges: kernels.Edges


@dataclass(frozen=True, eq=False)
class FollowedTree:
    """All states that are followed, and the mass of those that are not."""

    steps: list[FollowedStep]
    residual_mass: float

    @classmethod
    def of(
        cls,
        scenario: Scenario,
        policy: ParametricPolicy,
        initial_velocities: FloatArray,
        options: FollowingOptions,
    ) -> FollowedTree:
        """Enumerate the states of a policy, the most probable ones if not all can be followed."""
        steps: list[FollowedStep] = []
        residual, count = 0.0, 0
        states = States.initial(scenario, initial_velocities)
        for step in range(scenario.n_steps):
            count += len(states)
            following = scenario.n_steps - 1 - step
            share = (options.tolerance - residual) / following if following else 1.0
            limit = max(0, options.max_states - count) // following if following else 0
            move = transition(scenario, policy, step, states, options.lattice)
            absorption = _absorption(scenario, move, options.arrival_smoothing)
            followed, states, left_out = _advance(states, move, absorption, share, limit)
            steps.append(followed)
            residual += left_out if following else 0.0  # after the last step nobody arrives
            if not len(states):
                break
        return cls(steps, residual)

    def gradient(
        self, scenario: Scenario, policy: ParametricPolicy
    ) -> tuple[float, float, FloatArray]:
        """Objective and success of what is followed, and the gradient (p,) of the objective."""
        n = scenario.n
        after = kernels.Values(*np.zeros((2, 0)), *np.zeros((2, 0, n, 2)))
        gradient = np.zeros_like(policy.parameters)
        for step in range(len(self.steps) - 1, -1, -1):
            after, of_step = _backward(scenario, policy, step, self.steps[step], after)
            gradient += of_step
        return float(after.objective[0]), float(after.success[0]), gradient

    @property
    def states(self) -> int:
        """Number of states."""
        return sum(len(step.states) for step in self.steps)


def _advance(
    states: States,
    move: Transition,
    absorption: tuple[FloatArray, FloatArray],
    share: float,
    limit: int,
) -> tuple[FollowedStep, States, float]:
    """The step of states, the states after it that are followed, and the mass that is not.

    At most `share` is left out unless more than `limit` states would be followed.
    """
    step = move.step(states, absorption[0])
    probable, left_out = _probable_outcomes(step, _BEFORE_MERGING * share, _PER_STATE * limit)
    following, children = move.following(*probable).aggregated()
    kept, dropped = _kept(following.weights, share - left_out, limit)
    children = np.where(kept, np.cumsum(kept) - 1, -1)[children]
    starts = np.searchsorted(probable.parents, np.arange(len(states) + 1))
    edges = kernels.Edges(starts, probable.survived, children)
    followed = FollowedStep(states, move, step, absorption[1], edges)
    return followed, following[kept], left_out + dropped


def _probable_outcomes(step: Step, share: float, limit: int) -> tuple[Outcomes, float]:
    """Outcomes in which the run goes on, as `_kept` chooses them, and the mass of the others."""
    counts, sums = np.zeros(kernels.BINS, np.int64), np.zeros(kernels.BINS)
    number, totals = 0, Totals.zeros(*step.alive.shape)
    for batch in outcomes(step, totals):
        kernels.count_masses(batch.masses, counts, sums)
        number += 1
    last, left_out = _last_bin(counts, sums, share, limit)
    # more than a batch would take too much memory: they are enumerated once more
    batches = [batch] if number == 1 else outcomes(step, totals, kernels.least_mass(last))
    chosen = []
    for batch in batches:
        rows = np.flatnonzero(_flags(batch.masses, last))
        chosen.append(Outcomes._make(array.take(rows, axis=0) for array in batch))
    if len(chosen) > 1:
        chosen = [Outcomes._make(map(np.concatenate, zip(*chosen, strict=True)))]
    return chosen[0], left_out


def _kept(masses: FloatArray, share: float, limit: int) -> tuple[BoolArray, float]:
    """Which states (S,) are followed, and the mass of the others; see `_advance`."""
    counts, sums = np.zeros(kernels.BINS, np.int64), np.zeros(kernels.BINS)
    kernels.count_masses(masses, counts, sums)
    last, left_out = _last_bin(counts, sums, share, limit)
    return _flags(masses, last), left_out


def _flags(masses: FloatArray, last: int) -> BoolArray:
    """Which masses are in bins up to `last`."""
    flags = np.empty(len(masses), bool)
    kernels.flag_masses(masses, last, flags)
    return flags


def _last_bin(counts: IntArray, sums: FloatArray, share: float, limit: int) -> tuple[int, float]:
    """The last bin that is followed, and the mass in all bins after it.

    Whole bins are left out, so that what is followed does not depend on the order of equal states.
    """
    after = np.append(sums[::-1].cumsum()[::-1], 0.0)[1:]  # in the bins after each
    needless = after <= share
    last = int(needless.argmax())
    allowed = int((counts.cumsum() <= limit).sum()) - 1
    last = min(last, allowed)
    return last, float(after[last]) if last >= 0 else float(sums.sum())


def _absorption(
    scenario: Scenario, move: Transition, smoothing: float
) -> tuple[FloatArray, FloatArray]:
    """Probabilities (S, n) that members are absorbed, and their derivatives (S, n, 2)."""
    if smoothing == 0.0:
        return move.inside.astype(float), np.zeros_like(move.positions)
    radius = scenario.target.radius
    offsets = move.positions - np.array(scenario.target.center)
    scale = radius**2 - (radius - smoothing) ** 2
    z = np.clip((radius**2 - (offsets**2).sum(axis=-1)) / scale, 0.0, 1.0) * move.inside
    slopes = (6.0 * z * (1.0 - z) * -2.0 / scale)[..., None] * offsets
    return z * z * (3.0 - 2.0 * z), slopes


def _backward(
    scenario: Scenario,
    policy: ParametricPolicy,
    step: int,
    followed: FollowedStep,
    after: kernels.Values,
) -> tuple[kernels.Values, FloatArray]:
    """Values of the states of a step, and this step's part of the gradient (p,)."""
    states, move, dt = followed.states, followed.move, scenario.time.dt
    shape = states.positions.shape
    by = kernels.Adjoints(*np.zeros((2, *shape[:2])), *np.zeros((2, *shape)))
    before = kernels.Values(*np.empty((2, len(states))), *np.empty((2, 0, 0, 2)))
    kernels.backward(followed.step, move.inside, followed.edges, after, before, by)
    to_rates = -dt * move.survival * by.survival
    to_positions = by.positions + by.arrival[..., None] * followed.arrival_slopes
    to_positions += rates_adjoint(scenario.hazard, move.positions, states.alive, to_rates)
    seeds = by.velocities + dt * to_positions
    state = states.positions, states.previous_velocities, states.alive
    to_commanded, to_previous = policy.project_adjoint(step, state, seeds)
    by_position, by_previous, gradient = policy.adjoint(step, state, to_commanded, states.weights)
    living = states.alive[..., None]
    positions = np.where(living, to_positions + by_position, 0.0)
    velocities = np.where(living, to_previous + by_previous, 0.0)
    return before._replace(positions=positions, velocities=velocities), gradient


def rates_adjoint(
    hazard: Hazard, positions: FloatArray, alive: BoolArray, seeds: FloatArray
) -> FloatArray:
    """Derivatives of the sum of seeds (B, n) times rates with respect to positions, (B, n, 2)."""
    batch = len(alive)
    columns = (positions.reshape(batch, -1).T, alive.T.astype(float), (seeds * alive).T)
    (derivatives,) = _rates_adjoint(hazard, alive.shape[1])(*columns)
    return derivatives.T.reshape(positions.shape)


@locked_cache(maxsize=64)
def _rates_adjoint(hazard: Hazard, n: int) -> BatchFunction:
    positions, alive = ca.MX.sym("positions", 2 * n), ca.MX.sym("alive", n)
    seeds = ca.MX.sym("seeds", n)
    rates = hazard.expression(ca.reshape(positions, 2, n), alive.T)
    derivatives = ca.jtimes(ca.vec(rates), positions, seeds, True)
    return BatchFunction.of([positions, alive, seeds], [derivatives])
