"""The success of a policy and its gradient with respect to the policy's parameters."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from numpy.typing import ArrayLike

from ..chain.exact import MAX_MEMBERS
from ..chain.gradient import FollowedTree, FollowingOptions
from ..chain.transition import Lattice
from ..errors import PolicyError
from ..guide.guide import Guide
from ..guide.plan import initial_velocities, plan
from ..policies.parametric import ParametricPolicy
from ..scenario.scenario_files import require_scenario
from ..typing import FloatArray, Interval

if TYPE_CHECKING:
    from ..scenario import Scenario

MAX_STATES = 200_000


@dataclass(frozen=True, eq=False)
class SuccessGradient:
    """Success probability of a parametric policy, and its derivatives.

    Parameters
    ----------
    success : Interval
        Bounds of the probability that at least one member arrives alive, as of `evaluate`.
    objective : float
        The number that is differentiated, a lower bound of the success: the lower end of `success`
        without smoothing of arrivals, and less with it.
    gradient : (p,)
        Derivatives of `objective` with respect to the parameters, the followed histories of losses
        being held fixed.
    residual_mass : float
        Probability mass of the histories that were not followed; the width of `success`.
    states : int
        Number of distinct states.
    tolerance : float
        Requested upper limit of `residual_mass`.
    """

    success: Interval
    objective: float
    gradient: FloatArray
    residual_mass: float
    states: int
    tolerance: float

    @property
    def complete(self) -> bool:
        """Whether the bounds are as narrow as requested."""
        return self.residual_mass <= self.tolerance

    def __repr__(self) -> str:
        low, high = self.success
        return (
            f"SuccessGradient(success=[{low:.6f}, {high:.6f}], objective={self.objective:.6f}, "
            f"parameters={len(self.gradient)}, states={self.states})"
        )


def success_gradient(
    scenario: Scenario,
    policy: ParametricPolicy,
    parameters: ArrayLike | None = None,
    tolerance: float = 1e-3,
    *,
    max_states: int = MAX_STATES,
    arrival_smoothing: float = 0.0,
    aggregation_tol: float | None = None,
    guide: Guide | None = None,
) -> SuccessGradient:
    """Differentiate the success of a policy with respect to its parameters, without sampling.

    All histories of losses but improbable ones are followed. For each of them, states and
    probabilities are functions of the parameters that are differentiated exactly, by an adjoint
    recursion: the derivatives take a few times as long as the success itself, however many
    parameters there are (``docs/policy-gradients.md``).

    Parameters
    ----------
    scenario : Scenario
        Of at most 12 members.
    policy : ParametricPolicy
        Made for this scenario.
    parameters : array_like, shape (p,), optional
        Where to differentiate; by default the policy's own parameters.
    tolerance : float
        Probability mass of the histories that may be left out. At 0 all are followed, and success
        and gradient are exact but for rounding.
    max_states : int
        Maximum number of distinct states that are followed. If that is too few for `tolerance`, the
        bounds are wider.
    arrival_smoothing : float
        Width w of the smoothing of arrivals, in units of length, from 0 to the target's radius R.
        The success jumps where a member just reaches the target in some history, and its derivative
        does not show it. With w > 0, `SuccessGradient.objective` counts a living member in the
        target at the distance d from its centre as arrived with the probability
        z^2 (3 - 2 z), where z = (R^2 - d^2) / (R^2 - (R - w)^2), at most 1. That is continuously
        differentiable in d, and never more than the success.
    aggregation_tol : float, optional
        As of `evaluate`: the spacing of the lattice to which positions are rounded, so that nearly
        equal states coincide; the value is that of the rounded policy, and the rounding itself is
        not differentiated. By default 2^-36 v_max dt or as little as double precision allows, far
        below what matters for derivatives; 0 rounds nothing.
    guide : Guide, optional
        Provides the initial velocities if the scenario says ``velocity = "guide"``; planned by
        default.

    Returns
    -------
    SuccessGradient

    Raises
    ------
    PolicyError
        A policy that is no `ParametricPolicy`, or has other members or limits than the scenario; a
        swarm that is too large; a function that fails, or whose values or derivatives are not
        finite.
    PlanningError
        No guide was found.
    ValueError
        A tolerance outside [0, 1), fewer than one state, or a width outside [0, R].

    Notes
    -----
    Derivatives are those where they exist. Kinks are where a velocity begins to be limited, jumps
    where a member just reaches the target; both are of measure zero. What is left out is not
    differentiated: for a fixed set of histories, their part of the objective is a lower bound of
    the success at every parameter, and the gradient is that of this bound.

    Examples
    --------
    >>> import casadi as ca
    >>> import numpy as np
    >>> import casswarm as csw
    >>> scenario = csw.load_scenario("barricade")
    >>> guide = csw.plan(scenario)
    >>> velocities = np.zeros((scenario.n_steps, 2))
    >>> velocities[: len(guide.velocities)] = guide.velocities
    >>> def common(step, positions, previous_velocities, alive, parameters):
    ...     return ca.repmat(parameters[2 * step : 2 * step + 2].T, scenario.n, 1)
    >>> policy = csw.ParametricPolicy(common, velocities.ravel(), scenario)
    >>> csw.success_gradient(scenario, policy, guide=guide).gradient.shape
    (36,)
    """
    require_scenario("success_gradient", scenario)
    if not isinstance(policy, ParametricPolicy):
        raise PolicyError(
            f"success_gradient takes a ParametricPolicy, not {type(policy).__name__}: make one of "
            "a function of CasADi, JAX or PyTorch by csw.ParametricPolicy(function, parameters, "
            "scenario)",
            policy=type(policy).__name__,
        )
    _require_fit(scenario, policy)
    options = _options(scenario, tolerance, max_states, arrival_smoothing)
    if parameters is not None:
        policy = policy.with_parameters(parameters)
    if guide is None:
        guide = plan(scenario, certify=False)
    lattice = Lattice.along(guide, scenario, aggregation_tol, policy.decision_tol)
    options = replace(options, lattice=lattice)
    tree = FollowedTree.of(scenario, policy, initial_velocities(scenario, guide), options)
    objective, low, gradient = tree.gradient(scenario, policy)
    return SuccessGradient(
        success=Interval(low, min(1.0, low + tree.residual_mass)),
        objective=objective,
        gradient=gradient,
        residual_mass=tree.residual_mass,
        states=tree.states,
        tolerance=tolerance,
    )


def _require_fit(scenario: Scenario, policy: ParametricPolicy) -> None:
    """Raise PolicyError for a policy of other members or limits, or a swarm that is too large."""
    if policy.scenario.n != scenario.n or policy.motion != type(policy.motion).from_scenario(
        scenario
    ):
        raise PolicyError(
            f"policy {policy.name!r} is for {policy.scenario!r}, which has other members or limits "
            f"of motion than {scenario!r}: make it with this scenario",
            policy=policy.name,
            scenario=scenario.name,
        )
    if scenario.n > MAX_MEMBERS:
        raise PolicyError(
            f"{scenario.name} has {scenario.n} members; gradients are for at most {MAX_MEMBERS}, "
            f"whose steps have {1 << MAX_MEMBERS} outcomes: take fewer members",
            scenario=scenario.name,
            members=scenario.n,
            max_members=MAX_MEMBERS,
        )


def _options(
    scenario: Scenario, tolerance: float, max_states: int, arrival_smoothing: float
) -> FollowingOptions:
    if not 0 <= tolerance < 1:
        raise ValueError(f"tolerance = {tolerance}; allowed: from 0 to below 1")
    if max_states < 1:
        raise ValueError(f"max_states = {max_states}; allowed: whole numbers from 1")
    radius = scenario.target.radius
    if not 0 <= arrival_smoothing <= radius:
        raise ValueError(
            f"arrival_smoothing = {arrival_smoothing}; allowed: from 0 to the target's radius, "
            f"{radius:g}"
        )
    return FollowingOptions(tolerance, max_states, arrival_smoothing)
