"""Exact laws of policies, their chains and gradients, and estimates for large swarms."""

from __future__ import annotations

import math
import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, TypeVar

import numpy as np
from numpy.typing import ArrayLike
from typing_extensions import Unpack

from .._util.numbers import require_seed, rounded_up
from .._util.progress import reporter
from .._util.settings import (
    ENUMERATED,
    EXACT,
    Accuracy,
    EvaluationKeywords,
    Execution,
    Keywords,
    given_values,
)
from .._util.text import counted, shown
from ..chain.distribution import Estimate, OutcomeDistribution
from ..chain.exact import (
    MAX_BYTES,
    MAX_MEMBERS,
    ExpansionOptions,
    StateSpaceExpansion,
    sample_residual,
)
from ..chain.gradient import success_and_gradient
from ..chain.markov_chain import MarkovChain, markov_chain_of
from ..chain.monte_carlo import Chain
from ..chain.prediction import StatePrediction, predicted
from ..errors import CasswarmWarning, PolicyError
from ..guide.guide import Guide
from ..policies.parametric import ParametricPolicy
from ..policies.user import repeated
from ..scenario.scenario_files import require_scenario
from ..scenario.variations import require_default
from ..solvers import Solver
from ..typing import FloatArray, Interval, Seed
from .inputs import PosedStudy, policy_list, policy_name, require_runs

if TYPE_CHECKING:
    from ..scenario import Scenario

T = TypeVar("T")

TOLERANCE = 1e-3
MAX_STATES = 1_000_000
MAX_STATES_OF_LARGE = 10_000  # with more than MAX_MEMBERS members
MAX_STATES_OF_GRADIENT = 200_000

MAX_PRUNED_FRACTION = 1e-5  # of a state's probability, when an estimate splits the state
VISITS = 2.0  # expected of R plain runs to the least probable state that is enumerated
_DEFAULTS = ENUMERATED | {"progress": None}


def evaluate(
    scenario: Scenario,
    policy: Any = "leader",
    tolerance: float | None = None,
    *,
    guide: Guide | None = None,
    solver: str | Solver = "auto",
    solver_options: Mapping[str, Any] | None = None,
    accuracy: Accuracy | None = None,
    execution: Execution | None = None,
    **plain: Unpack[EvaluationKeywords],
) -> OutcomeDistribution:
    """Compute the outcome distribution of the chain under a policy, within proven bounds.

    Nothing is sampled.

    Parameters
    ----------
    scenario : Scenario
        Of at most 12 members if `tolerance` is 0, which takes all 2^n outcomes of a step.
    policy : str, Policy, or as in `simulate`; or a list of one
    tolerance : float
        Width of the bounds, by default 1e-3: the probability mass of unlikely states that may be
        left out.
    guide : Guide, optional
        Planned from the scenario by default.
    solver : str or Solver
        For the formation problems.
    solver_options : mapping, optional
        Options of a solver that is given by name.
    accuracy, execution, **plain
        Values of `Accuracy` and `Execution`, in these records or as plain keywords:

        - `max_states`, by default a million, or ten thousand with more than 12 members, for every
          case of a hazard that is not known. If that is too few for `tolerance`, the bounds are
          wider: `OutcomeDistribution.residual_mass` is their width, and
          `OutcomeDistribution.advice` says what would help.
        - `aggregation_tol`, the largest spacing of the lattice of positions, in units of length.
          The policy's commands are rounded so that members move to lattice points, within v_max and
          a_max, and nearly equal states coincide. The bounds are proven for the policy with these
          commands. By default the spacing is `Policy.decision_tol` times v_max dt, which rounds no
          more than the policy's solver does: 2^-23 for policies that solve formation problems, 0
          for all others. 0 rounds nothing; coarser lattices often need fewer states, for a policy
          that is rounded more.
        - `memory`, megabytes that states may take, at least 1 and by default 537. Where that is too
          little, the least probable states are left out, and the bounds are wider.
        - `progress`, which receives the policy's name and the enumerated probability mass, of a
          total of 1.

    Returns
    -------
    OutcomeDistribution
        Of a hazard that is not known (``hazard.case``), for its prior and for every case.

    Raises
    ------
    PolicyError
        An unknown policy, several policies, a policy that answers the same state differently, a
        swarm that is too large for a tolerance of 0, or an `aggregation_tol` that is negative, too
        small for double precision, or too large for members to move.
    PlanningError
        No guide was found.
    ValueError
        A tolerance outside [0, 1), or fewer than one state.
    TypeError
        A value that is given plainly and in a record, or is none of these.

    Examples
    --------
    >>> import casswarm as csw
    >>> distribution = csw.evaluate(csw.load_scenario("paper-1"), "leader", tolerance=1e-3)
    >>> low, high = distribution.success
    >>> 0 <= low <= high <= low + 1e-3
    True
    """
    require_scenario("evaluate", scenario)
    given = plain if tolerance is None else {**plain, "tolerance": tolerance}
    values = given_values("evaluate", accuracy, execution, plain=given, **_DEFAULTS)
    tolerance, max_states, aggregation_tol, memory, progress = values
    options = expansion_options(scenario, tolerance, max_states, memory=memory)
    inputs = scenario, policy, guide, solver, solver_options, reporter(progress)
    expansions, _ = _expanded(inputs, options, aggregation_tol)
    laws = [expansion.distribution() for expansion in expansions]
    return OutcomeDistribution.of_cases(_weighted(scenario, laws))


def estimate(
    scenario: Scenario,
    policy: Any = "leader",
    runs: int = 10_000,
    seed: Seed = 0,
    *,
    guide: Guide | None = None,
    solver: str | Solver = "auto",
    solver_options: Mapping[str, Any] | None = None,
    accuracy: Accuracy | None = None,
    execution: Execution | None = None,
    **plain: Unpack[Keywords],
) -> Estimate:
    """Estimate the success probability: probable states are enumerated, the rest is sampled.

    For swarms whose exact distribution takes too many states. States of probability at least
    2 / `runs` are enumerated; with `max_states`, that many states, however improbable. The
    residual mass M is sampled by `runs` runs, so the interval is about M times as wide as that of
    `runs` plain runs, and narrower than that of as many plain runs as solve the same number of
    states (equal where M is nearly 1).

    Parameters
    ----------
    scenario, policy, guide, solver, solver_options
        As in `evaluate`.
    runs : int
        Number of runs that sample the residual mass, at least 1.
    seed : int or Generator
        As in `simulate`.
    accuracy, execution, **plain
        Values of `Accuracy` and `Execution`, in these records or as plain keywords:

        - `tolerance`, by default 1e-3, `max_states` and `memory`, as in `evaluate`, for the
          enumerated part.
        - `aggregation_tol`, the largest spacing of the lattice of positions, in units of length, as
          in `evaluate`, for both parts.
        - `progress`: True for progress bars, or a function (see `Progress`) that receives the
          policy's name and the enumerated probability mass, of a total of 1, and then "sampling"
          and the number of runs that have ended, of all.

    Returns
    -------
    Estimate
        It separates what is proven from what is statistical. Of a hazard that is not known, every
        case is sampled by `runs` runs.

    Raises
    ------
    PolicyError, PlanningError, ValueError, TypeError
        As in `evaluate`; fewer than one run, or a seed out of range.
    """
    require_scenario("estimate", scenario)
    runs, seed = require_runs("runs", runs), require_seed(seed)
    values = given_values("estimate", accuracy, execution, plain=plain, **_DEFAULTS)
    tolerance, max_states, aggregation_tol, memory, progress = values
    options = replace(
        expansion_options(scenario, tolerance, max_states, memory=memory),
        max_pruned_fraction=MAX_PRUNED_FRACTION,
        min_probability=VISITS / runs if max_states is None else 0.0,
    )
    inputs = scenario, policy, guide, solver, solver_options, reporter(progress)
    expansions, posed = _expanded(inputs, options, aggregation_tol)
    chain = Chain(scenario, posed.velocities, seed, lattice=expansions[0].options.lattice)
    sampled = [sample_residual(expansion, chain, runs, inputs[-1]) for expansion in expansions]
    return Estimate.of_cases(_weighted(scenario, sampled))


def predict_states(
    scenario: Scenario,
    policy: Any = "leader",
    tolerance: float | None = None,
    *,
    guide: Guide | None = None,
    solver: str | Solver = "auto",
    solver_options: Mapping[str, Any] | None = None,
    accuracy: Accuracy | None = None,
    **plain: Unpack[EvaluationKeywords],
) -> StatePrediction:
    """Predict how many states `evaluate` will solve, and the memory that they take.

    It follows from the states that at most 16,000 sampled runs visit: ``docs/chain.md``.

    Parameters
    ----------
    scenario, policy, tolerance, guide, solver, solver_options, accuracy, **plain
        As in `evaluate`; and `time_limit`, seconds of a sample after which none is larger.

    Returns
    -------
    StatePrediction
        Of a hazard that is not known, for the first case.

    Examples
    --------
    >>> import casswarm as csw
    >>> 300 < csw.predict_states(csw.load_scenario("paper-1"), "leader").states < 10_000
    True
    """
    require_scenario("predict_states", scenario)
    given = plain if tolerance is None else {**plain, "tolerance": tolerance}
    defaults = ENUMERATED | {"time_limit": math.inf}
    values = given_values("predict_states", accuracy, plain=given, **defaults)
    tolerance, max_states, lattice, memory, time_limit = values
    options = expansion_options(scenario, tolerance, max_states, memory=memory)
    inputs = scenario, policy, guide, solver, solver_options
    return predicted(_expansions(inputs, options, lattice)[0][0], time_limit)


def markov_chain(
    scenario: Scenario,
    policy: Any = "leader",
    tolerance: float | None = None,
    *,
    guide: Guide | None = None,
    solver: str | Solver = "auto",
    solver_options: Mapping[str, Any] | None = None,
    accuracy: Accuracy | None = None,
    **plain: Unpack[EvaluationKeywords],
) -> MarkovChain:
    """Enumerate the Markov chain of a policy: states, transitions and labels.

    `MarkovChain.export` writes it for model checkers (``docs/model-checkers.md``).

    Parameters
    ----------
    scenario : Scenario
        Of at most 12 members, and of a hazard that is known.
    policy, guide, solver, solver_options
        As in `evaluate`.
    tolerance : float
        Probability of the histories that may be left out, by default 1e-3. At 0 all are followed.
    accuracy, **plain
        Values of `Accuracy`, in this record or as plain keywords: `max_states`, by default 200,000,
        of which the most probable are followed, and `aggregation_tol`, as in `evaluate`.

    Returns
    -------
    MarkovChain

    Raises
    ------
    PolicyError, PlanningError, ValueError, TypeError
        As in `evaluate`; a swarm that is too large.
    ScenarioError
        A hazard that is not known.

    Examples
    --------
    >>> import casswarm as csw
    >>> chain = csw.markov_chain(csw.load_scenario("paper-1"), "leader", tolerance=0.01)
    >>> chain.transitions.shape == (len(chain.steps), len(chain.steps))
    True
    >>> low, high = chain.success
    >>> low <= high <= low + 0.01
    True
    """
    require_scenario("markov_chain", scenario)
    require_default(scenario, "hazard.case", "the chain of a policy")
    _require_few(scenario, "chains are", "estimate() takes larger swarms")
    given = plain if tolerance is None else {**plain, "tolerance": tolerance}
    values = given_values("markov_chain", accuracy, plain=given, **EXACT)
    tolerance, max_states, aggregation_tol = values
    options = expansion_options(scenario, tolerance, max_states, MAX_STATES_OF_GRADIENT)
    inputs = scenario, policy, guide, solver, solver_options
    return markov_chain_of(_expansions(inputs, options, aggregation_tol)[0][0])


def _weighted(scenario: Scenario, answers: Sequence[T]) -> list[tuple[float, T]]:
    """Answers for every case of the hazard, with the prior weights of the cases."""
    return [(case.weight, each) for case, each in zip(scenario.cases, answers, strict=True)]


def expansion_options(
    scenario: Scenario,
    tolerance: float,
    max_states: int | None,
    most: int = MAX_STATES,
    memory: float | None = None,
) -> ExpansionOptions:
    """Validated options of the enumeration, of at most `most` states by default."""
    if not 0 <= tolerance < 1:
        raise ValueError(f"tolerance = {tolerance}; allowed: from 0 to below 1")
    if max_states is None:
        max_states = most if scenario.n <= MAX_MEMBERS else MAX_STATES_OF_LARGE
    if max_states < 1:
        raise ValueError(f"max_states = {max_states}; allowed: whole numbers from 1")
    if tolerance == 0:
        _require_few(scenario, "a tolerance of 0 is", "give a larger tolerance")
    if memory is not None and not 1 <= memory < math.inf:
        raise ValueError(f"memory = {shown(memory)}; allowed: megabytes from 1")
    max_bytes = MAX_BYTES if memory is None else int(1e6 * memory)
    return ExpansionOptions(tolerance, max_states, max_bytes=max_bytes)


def _require_few(scenario: Scenario, what: str, advice: str) -> None:
    """Raise PolicyError for a swarm whose 2^n outcomes of a step are too many."""
    if scenario.n > MAX_MEMBERS:
        raise PolicyError(
            f"{scenario.name} has {scenario.n} members; {what} for at most {MAX_MEMBERS}, whose "
            f"steps have {1 << MAX_MEMBERS} outcomes: {advice}",
            scenario=scenario.name,
            members=scenario.n,
            max_members=MAX_MEMBERS,
        )


def _expanded(
    inputs: tuple[Any, ...], options: ExpansionOptions, aggregation_tol: float | None
) -> tuple[list[StateSpaceExpansion], PosedStudy]:
    """The same as `_expansions`, expanded to the tolerance."""
    expansions, posed = _expansions(inputs, options, aggregation_tol)
    for expansion in expansions:
        expansion.expand(posed.progress)
    return expansions, posed


def _expansions(
    inputs: tuple[Any, ...], options: ExpansionOptions, aggregation_tol: float | None
) -> tuple[list[StateSpaceExpansion], PosedStudy]:
    """New expansions of the inputs of `PosedStudy.of`, one for every case of the hazard."""
    scenario, policy, *others = inputs
    names = list(map(policy_name, listed := policy_list(policy)))
    if len(names) > 1:
        raise PolicyError(
            f"one policy is evaluated at a time, not {len(names)}: {', '.join(names)}; call "
            "the function for each of them",
            policies=names,
        )
    posed = PosedStudy.of(scenario, listed, *others)
    options = replace(options, lattice=posed.lattice(aggregation_tol))
    policy = repeated(posed.policies[0])
    expansions = [
        StateSpaceExpansion(scenario, policy, posed.velocities, options, case)
        for case in range(len(scenario.cases))
    ]
    return expansions, posed


@dataclass(frozen=True, eq=False)
class SuccessGradient:
    """Success probability of a parametric policy, and its derivatives.

    Parameters
    ----------
    success : Interval
        Bounds of the probability that at least one member arrives alive, as of `evaluate`.
    objective : float
        The number that is differentiated, a lower bound of the success: the lower end of `success`
        without smoothing of arrivals, and less with it. Of all histories it is between this value
        and `residual_mass` more.
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
        """True if the bounds are as narrow as requested."""
        return self.residual_mass <= self.tolerance

    @property
    def advice(self) -> str:
        """Advice on following more histories if fewer than requested were; empty otherwise."""
        if self.complete:
            return ""
        enough = rounded_up(self.residual_mass, 4)
        return (
            f"{counted(self.states, 'state')} did not suffice for tolerance = {self.tolerance:g}: "
            f"histories of probability {self.residual_mass:.3g} were left out, and the gradient is "
            "that of the others; allow more states (max_states=)"
            + (f", or a tolerance of {enough} or more" if enough < 1 else "")
        )

    def __repr__(self) -> str:
        low, high = self.success
        return (
            f"SuccessGradient(success=[{low:.6f}, {high:.6f}], objective={self.objective:.6f}, "
            f"parameters={len(self.gradient)}, states={self.states})"
        )

    def __str__(self) -> str:
        return repr(self) if self.complete else f"{self!r}; {self.advice}"


def success_gradient(
    scenario: Scenario,
    policy: ParametricPolicy,
    parameters: ArrayLike | None = None,
    tolerance: float | None = None,
    *,
    arrival_smoothing: float = 0.0,
    guide: Guide | None = None,
    accuracy: Accuracy | None = None,
    **plain: Unpack[EvaluationKeywords],
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
        Probability mass of the histories that may be left out, by default 1e-3. At 0 all are
        followed, and success and gradient are exact but for rounding.
    arrival_smoothing : float
        Width w of the smoothing of arrivals, in units of length, from 0 to the target's radius R.
        The success jumps where a member just reaches the target in some history, and its derivative
        does not show it. With w > 0, `SuccessGradient.objective` counts a living member in the
        target at the distance d from its centre as arrived with the probability
        z^2 (3 - 2 z), where z = (R^2 - d^2) / (R^2 - (R - w)^2), at most 1. That is continuously
        differentiable in d, and never more than the success.
    guide : Guide, optional
        Provides the initial velocities if the scenario says ``velocity = "guide"``; planned by
        default.

    accuracy, **plain
        Values of `Accuracy`, in this record or as plain keywords:

        - `max_states`, the maximum number of distinct states that are followed, by default 200,000.
          If that is too few for `tolerance`, the most probable histories are followed, the bounds
          are wider, and a warning says so: see `SuccessGradient.advice`.
        - `aggregation_tol`, as in `evaluate`: the spacing of the lattice to which positions are
          rounded, so that nearly equal states coincide; the value is that of the rounded policy,
          and the rounding itself is not differentiated. By default 2^-36 v_max dt or as little as
          double precision allows, far below what matters for derivatives; 0 rounds nothing.

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
    TypeError
        As in `evaluate`.

    Warns
    -----
    CasswarmWarning
        `max_states` did not suffice for the tolerance.

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
    given = plain if tolerance is None else {**plain, "tolerance": tolerance}
    values = given_values("success_gradient", accuracy, plain=given, **EXACT)
    tolerance, max_states, aggregation_tol = values
    options = expansion_options(scenario, tolerance, max_states, MAX_STATES_OF_GRADIENT)
    radius = scenario.target.radius
    if not 0 <= arrival_smoothing <= radius:
        raise ValueError(
            f"arrival_smoothing = {arrival_smoothing}; allowed: from 0 to the target's radius, "
            f"{radius:g}"
        )
    if parameters is not None:
        policy = policy.with_parameters(parameters)
    posed = PosedStudy.of(scenario, [policy], guide)
    options = replace(options, lattice=posed.lattice(aggregation_tol))
    expansions = [
        StateSpaceExpansion(case.scenario, repeated(policy), posed.velocities, options)
        for case in scenario.cases
    ]
    parts = [success_and_gradient(each, policy, arrival_smoothing) for each in expansions]
    means: Any = parts[0]
    if len(parts) > 1:  # all are linear in the prior
        weights = [case.weight for case in scenario.cases]
        columns = zip(*parts, strict=True)
        means = tuple(np.tensordot(weights, np.array(each), 1) for each in columns)
    objective, low, gradient, residual = means
    found = SuccessGradient(
        success=Interval(float(low), min(1.0, float(low + residual))),
        objective=float(objective),
        gradient=gradient,
        residual_mass=float(residual),
        states=sum(each.solved for each in expansions),
        tolerance=options.tolerance,
    )
    if not found.complete:
        warnings.warn(found.advice, CasswarmWarning, stacklevel=2)
    return found


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
    _require_few(scenario, "gradients are", "take fewer members")
