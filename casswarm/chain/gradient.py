"""The success of a policy and its gradient, by an adjoint recursion over the layers of states.

For every history of losses, the states and their probabilities are smooth functions of the
parameters, but for kinks of measure zero. A forward sweep enumerates the states, step by step
(`StateSpaceExpansion.layers`); a backward sweep gives the value of every state and its derivatives
(the adjoint recursion of ``docs/policy-gradient-law.md``). Equal states are one state: the value of
a state does not depend on how it was reached.
"""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING, Any, NamedTuple

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from .._util.threads import locked_cache
from ..compiled.kernels import allocating_kernel, kernel
from ..hazard import Hazard
from ..policies.parametric import BatchFunction, ParametricPolicy
from ..scenario.variations import require_default
from ..typing import BoolArray, FloatArray, IntArray
from .exact import Edges, Layer, StateSpaceExpansion
from .states import Step
from .transition import Transition

if TYPE_CHECKING:
    from ..scenario import Scenario


class Values(NamedTuple):
    """Values of S states, and derivatives of the objective."""

    objective: FloatArray  # (S,) probability of being absorbed, of what is followed
    success: FloatArray  # (S,) probability of an arrival in the target, of what is followed
    positions: FloatArray  # (S, n, 2) derivatives with respect to X(t)
    velocities: FloatArray  # (S, n, 2) and with respect to V(t-1)


class Adjoints(NamedTuple):
    """Derivatives of the objective of S states with respect to what happens in their step."""

    survival: FloatArray  # (S, n)
    arrival: FloatArray  # (S, n)
    positions: FloatArray  # (S, n, 2) X(t+1), as far as the states after the step depend on it
    velocities: FloatArray  # (S, n, 2) V(t), likewise


class Scratch(NamedTuple):
    """Buffers for a state with k living members and its 2^k - 1 outcomes in which the run goes on.

    The number of an outcome has bit j set if the j-th living member survives.
    """

    members: IntArray  # (n,) the living ones
    stays: FloatArray  # (n,) probability that each survives and moves on
    leaves: FloatArray  # (n,) is destroyed
    absorbed: FloatArray  # (n,) is absorbed
    levels: FloatArray  # (n+1, 2^n) values of the outcomes of the members up to each
    weights: FloatArray  # (n+1, 2^n) and their probabilities
    numbers: IntArray  # (2^n,) of the outcomes that are followed


def success_and_gradient(
    expansion: StateSpaceExpansion, policy: ParametricPolicy, arrival_smoothing: float
) -> tuple[float, float, FloatArray, float]:
    """Objective, success, gradient (p,) of the objective, and the mass that is not followed.

    Parameters
    ----------
    expansion : StateSpaceExpansion
        New; of the policy.
    policy : ParametricPolicy
    arrival_smoothing : float
        w: a member at the distance d from the target's centre is absorbed with a probability that
        increases smoothly from 0 at d = R, the radius, to 1 at d = R - w. With 0 all members in the
        target are absorbed. Rounding to a lattice is differentiated as if it were none.
    """
    scenario, gradient = expansion.scenario, np.zeros_like(policy.parameters)
    for key in (
        "information.delay",
        "success.arrivals",
        "time.substeps",
        "target.other",
        "swarm.speed",
    ):
        require_default(scenario, key, "the gradient of success in a policy's parameters")
    absorption = partial(_absorption, scenario, arrival_smoothing)
    layers, residual = expansion.layers(lambda move: absorption(move)[0])
    after = Values(*np.zeros((2, 0)), *np.zeros((2, 0, scenario.n, 2)))
    for step, layer in reversed(list(enumerate(layers))):
        slopes = absorption(layer.move)[1]
        after, of_step = _backward(scenario, policy, step, layer, slopes, after)
        gradient += of_step
    return float(after.objective[0]), float(after.success[0]), gradient, residual


def _absorption(
    scenario: Scenario, smoothing: float, move: Transition
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
    layer: Layer,
    slopes: FloatArray,
    after: Values,
) -> tuple[Values, FloatArray]:
    """Values of the states of a step, and this step's part of the gradient (p,)."""
    states, move, dt = layer.states, layer.move, scenario.time.dt
    shape = states.positions.shape
    by = Adjoints(*np.zeros((2, *shape[:2])), *np.zeros((2, *shape)))
    before = Values(*np.empty((2, len(states))), *np.empty((2, 0, 0, 2)))
    backward(layer.step, move.inside, layer.edges, after, before, by)
    to_rates = -dt * move.survival * by.survival
    to_positions = by.positions + by.arrival[..., None] * slopes
    hazard = scenario.hazard.after(step + 1)
    to_positions += _rates_adjoint(hazard, move.positions, states.alive, to_rates)
    seeds = by.velocities + dt * to_positions
    state = states.positions, states.previous_velocities, states.alive
    to_commanded, to_previous = policy.project_adjoint(step, state, seeds)
    by_position, by_previous, gradient = policy.adjoint(step, state, to_commanded, states.weights)
    living = states.alive[..., None]
    positions = np.where(living, to_positions + by_position, 0.0)
    velocities = np.where(living, to_previous + by_previous, 0.0)
    return before._replace(positions=positions, velocities=velocities), gradient


def _rates_adjoint(
    hazard: Hazard, positions: FloatArray, alive: BoolArray, seeds: FloatArray
) -> FloatArray:
    """Derivatives of the sum of seeds (B, n) times rates with respect to positions, (B, n, 2)."""
    batch = len(alive)
    columns = (positions.reshape(batch, -1).T, alive.T.astype(float), (seeds * alive).T)
    (derivatives,) = _adjoint_function(hazard, alive.shape[1])(*columns)
    return derivatives.T.reshape(positions.shape)


@locked_cache(maxsize=512)  # where rates depend on time, each step has its own
def _adjoint_function(hazard: Hazard, n: int) -> BatchFunction:
    positions, alive = ca.MX.sym("positions", 2 * n), ca.MX.sym("alive", n)
    seeds = ca.MX.sym("seeds", n)
    rates = hazard.expression(ca.reshape(positions, 2, n), alive.T)
    derivatives = ca.jtimes(ca.vec(rates), positions, seeds, True)
    return BatchFunction.of([positions, alive, seeds], [derivatives])


@kernel
def weigh(step: Step, arrival: NDArray[Any], s: int, scratch: Scratch) -> int:
    """Write the members of state s and what happens to each; their number k.

    `arrival` (S, n) has the probabilities that members are absorbed if they survive.
    """
    k = 0
    for i in range(step.alive.shape[1]):
        if step.alive[s, i]:
            p, a = step.survival[s, i], arrival[s, i]
            scratch.members[k] = i
            scratch.stays[k], scratch.leaves[k] = p * (1.0 - a), 1.0 - p
            scratch.absorbed[k] = p * a
            k += 1
    return k


@kernel
def fold(k: int, scratch: Scratch) -> float:
    """Probability that a member is absorbed, now or later, given the values of the outcomes.

    The values of the outcomes in which k members move on are ``levels[k]`` (2^k,). Level d is the
    expectation over the members from d on, level 0 that over all.
    """
    levels, nobody = scratch.levels, 1.0
    for d in range(k - 1, -1, -1):
        size, nobody = 1 << d, nobody * (1.0 - scratch.absorbed[d])
        for o in range(size):
            stays, leaves = levels[d + 1, size + o], levels[d + 1, o]
            levels[d, o] = scratch.stays[d] * stays + scratch.leaves[d] * leaves
    return float(1.0 - nobody + levels[0, 0])


@kernel
def unfold(k: int, arrival: FloatArray, s: int, scratch: Scratch, by: Adjoints) -> None:
    """Write the derivatives by the probabilities of state s, and the weights of its outcomes."""
    levels, weights = scratch.levels, scratch.weights
    weights[0, 0] = 1.0
    for j in range(k):
        i, size, to_stay, to_leave = scratch.members[j], 1 << j, 0.0, 0.0
        for o in range(size):
            to_stay += weights[j, o] * levels[j + 1, size + o]
            to_leave += weights[j, o] * levels[j + 1, o]
            weights[j + 1, size + o] = weights[j, o] * scratch.stays[j]
            weights[j + 1, o] = weights[j, o] * scratch.leaves[j]
        others = 1.0  # nobody else is absorbed
        for m in range(k):
            if m != j:
                others *= 1.0 - scratch.absorbed[m]
        a = arrival[s, i]
        by.survival[s, i] = (1.0 - a) * to_stay - to_leave + a * others
        by.arrival[s, i] = (1.0 - scratch.leaves[j]) * (others - to_stay)


@kernel
def number_outcomes(edges: Edges, s: int, k: int, scratch: Scratch) -> int:
    """Write the numbers of the outcomes of state s, which has k members; return how many."""
    start, stop = edges.starts[s], edges.starts[s + 1]
    for c in range(start, stop):
        number = 0
        for j in range(k):
            number |= int(edges.survived[c, scratch.members[j]]) << j
        scratch.numbers[c - start] = number
    return int(stop - start)


@allocating_kernel
def backward(
    step: Step, inside: BoolArray, edges: Edges, after: Values, to: Values, by: Adjoints
) -> None:
    """Write the values of S states before a step, and the derivatives with respect to their moves.

    `inside` (S, n) are the members in the target after the step, and `after` the values of the
    states after it. Written are `objective` and `success` of `to`, and `by`, zeros.
    """
    n = step.alive.shape[1]
    scratch = Scratch(
        np.empty(n, np.int64),
        np.empty(n),
        np.empty(n),
        np.empty(n),
        np.zeros((n + 1, 1 << n)),
        np.empty((n + 1, 1 << n)),
        np.empty(1 << n, np.int64),
    )
    for s in range(step.weights.size):
        k, start, numbers = weigh(step, inside, s, scratch), edges.starts[s], scratch.numbers
        children = edges.children[start : start + number_outcomes(edges, s, k, scratch)]
        leaf = scratch.levels[k]
        leaf[: 1 << k] = 0.0
        for c in range(children.size):
            if children[c] >= 0:
                leaf[numbers[c]] = after.success[children[c]]
        to.success[s] = fold(k, scratch)
        weigh(step, step.arrival, s, scratch)
        for c in range(children.size):
            if children[c] >= 0:
                leaf[numbers[c]] = after.objective[children[c]]
        to.objective[s] = fold(k, scratch)
        unfold(k, step.arrival, s, scratch, by)
        for c in range(children.size):
            if children[c] >= 0:
                weight, child = scratch.weights[k, numbers[c]], children[c]
                for i in range(n):
                    if edges.survived[start + c, i]:
                        for axis in range(2):
                            by.positions[s, i, axis] += weight * after.positions[child, i, axis]
                            by.velocities[s, i, axis] += weight * after.velocities[child, i, axis]
