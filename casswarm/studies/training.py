"""Training of parametric policies by the exact gradient of their success."""

from __future__ import annotations

import math
import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property, partial
from typing import Any

import pandas as pd

from .._util.text import shown
from ..bounds.success_bound import success_bound
from ..errors import CasswarmWarning
from ..guide.guide import Guide
from ..guide.plan import plan
from ..policies.parametric import ParametricPolicy
from ..scenario import Scenario
from ..scenario.scenario_files import require_scenario
from ..typing import FloatArray, Interval
from .evaluation import SuccessGradient, evaluate, success_gradient

METHODS = ("L-BFGS-B", "BFGS", "CG", "SLSQP")
"""Methods of `scipy.optimize.minimize` that need nothing but a gradient."""

STAGES = ((0.4, 0.03, 30), (0.2, 0.02, 30), (0.1, 0.02, 30), (0.04, 0.01, 30), (0.01, 0.01, 30))
"""Stages of a training: smoothing of arrivals in radii of the target, tolerance, iterations."""


@dataclass(frozen=True, eq=False)
class Training:
    """A trained policy, and how its training went.

    Parameters
    ----------
    scenario : Scenario
    policy : ParametricPolicy
        After the training.
    success : Interval
        Proven bounds of its success probability, as of `evaluate`.
    history : DataFrame
        A row for every gradient: `stage`, `smoothing` (units of length) and `objective`, that of
        `SuccessGradient`. Objectives of different stages are smoothed differently.
    messages : tuple of str
        The optimiser's message at the end of each stage.
    """

    scenario: Scenario
    policy: ParametricPolicy
    success: Interval
    history: pd.DataFrame
    messages: tuple[str, ...]

    @cached_property
    def gap(self) -> float:
        """Success that is missing at most: `success_bound` minus the lower bound of the success."""
        return success_bound(self.scenario).value - self.success.low

    def __repr__(self) -> str:
        low, high = self.success
        return (
            f"Training({self.policy.name!r}, success=[{low:.6f}, {high:.6f}], "
            f"gradients={len(self.history)}, stages={len(self.messages)})"
        )


def train(
    scenario: Scenario,
    policy: ParametricPolicy,
    method: str = "L-BFGS-B",
    *,
    stages: Sequence[tuple[float, float, int]] = STAGES,
    guide: Guide | None = None,
    options: Mapping[str, Any] | None = None,
) -> Training:
    """Maximise the success of a policy over its parameters, by `success_gradient`.

    Each stage begins with the parameters of the one before and smooths arrivals less, since the
    success itself jumps where a member just reaches the target (``docs/policy-gradients.md``). The
    answer is a local optimum of the last stage's objective.

    Parameters
    ----------
    scenario : Scenario
        Of at most 12 members.
    policy : ParametricPolicy
        Made for this scenario; its parameters are the start.
    method : {"L-BFGS-B", "BFGS", "CG", "SLSQP"}
        Of `scipy.optimize.minimize`.
    stages : sequence of (radii, tolerance, iterations)
        Of each stage: the smoothing of arrivals in radii of the target, from 0 to 1, the tolerance
        of `success_gradient`, and the largest number of iterations.
    guide : Guide, optional
        Provides the initial velocities if the scenario says ``velocity = "guide"``; planned by
        default.
    options : mapping, optional
        Further options of the method, such as ``{"maxcor": 20}``.

    Returns
    -------
    Training

    Raises
    ------
    PolicyError
        As of `success_gradient`.
    PlanningError
        No guide was found.
    ValueError
        An unknown method, no stage, or invalid numbers of a stage.

    Examples
    --------
    >>> import casadi as ca
    >>> import casswarm as csw
    >>> scenario = csw.load_scenario("barricade")
    >>> def homing(step, positions, previous_velocities, alive, parameters):
    ...     to_target = ca.repmat(ca.DM(scenario.target.center).T, scenario.n, 1) - positions
    ...     return parameters[0] * to_target + ca.repmat(parameters[1:3].T, scenario.n, 1)
    >>> policy = csw.ParametricPolicy(homing, [0.6, 0.3, 0.0], scenario)
    >>> training = csw.train(scenario, policy, stages=[(0.4, 0.05, 2)])
    >>> list(training.history)
    ['stage', 'smoothing', 'objective']
    """
    require_scenario("train", scenario)
    if method not in METHODS:
        raise ValueError(f"method = {shown(method)}; allowed: {', '.join(METHODS)}")
    _require_stages(stages)
    if guide is None and scenario.swarm.velocity == "guide":
        guide = plan(scenario.believed, certify=False)
    rows: list[tuple[int, float, float]] = []
    messages = []
    for stage, (radii, tolerance, iterations) in enumerate(stages):
        smoothing = radii * scenario.target.radius
        gradient = partial(
            success_gradient,
            scenario,
            policy,
            tolerance=tolerance,
            arrival_smoothing=smoothing,
            guide=guide,
        )
        limits = {"maxiter": iterations, **(options or {})}
        x, message, objectives = _maximised(gradient, policy.parameters, method, limits, stage)
        rows += [(stage, smoothing, objective) for objective in objectives]
        policy = policy.with_parameters(x)
        messages.append(message)
    history = pd.DataFrame(rows, columns=["stage", "smoothing", "objective"])
    success = evaluate(scenario, policy, guide=guide).success
    return Training(scenario, policy, success, history, tuple(messages))


def _maximised(
    gradient: partial[SuccessGradient],
    parameters: FloatArray,
    method: str,
    options: Mapping[str, Any],
    stage: int,
) -> tuple[FloatArray, str, list[float]]:
    """Parameters of a stage's end, the optimiser's message, and every objective."""
    from scipy.optimize import minimize  # slow to import

    objectives: list[float] = []

    def loss(x: FloatArray) -> tuple[float, FloatArray]:
        found = gradient(x)
        if not objectives and not found.gradient.any():
            warnings.warn(
                f"stage {stage} of the training begins with the objective {found.objective:g} and "
                "a gradient of zeros, which moves nothing: reduce its tolerance "
                f"({gradient.keywords['tolerance']:g}), which may be above the success there, "
                "smooth arrivals more, or start elsewhere",
                CasswarmWarning,
                stacklevel=2,
            )
        objectives.append(found.objective)
        return -found.objective, -found.gradient

    result = minimize(loss, parameters, jac=True, method=method, options=options)
    return result.x, str(result.message), objectives


def _require_stages(stages: Sequence[tuple[float, float, int]]) -> None:
    if not len(stages):
        raise ValueError("stages is empty; expected at least one (radii, tolerance, iterations)")
    for stage in stages:
        valid = len(stage) == 3 and all(map(math.isfinite, stage))
        if not (valid and 0 <= stage[0] <= 1 and 0 <= stage[1] < 1 and stage[2] >= 1):
            raise ValueError(
                f"stage {stage!r}; expected (radii from 0 to 1, tolerance from 0 and below 1, "
                "iterations from 1)"
            )
