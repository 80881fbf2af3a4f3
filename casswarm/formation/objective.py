"""The formation program, with the compiled objective that the batch solvers read."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from .._util.threads import locked_cache
from ..compiled.kernels import generated_module, objective
from ..hazard import Hazard, KernelHazard
from ..hazard.compiled_rates import rate_module
from ..nlp.program import Nlp
from ..problems.formation import formation_nlp
from ..typing import FloatArray
from .lane_objective_kernels import LANE_KERNELS
from .multistart_kernels import Shared
from .objective_kernels import FEW, MANY
from .spectral_kernels import LARGE_SWARM


@dataclass(frozen=True, eq=False)
class CompiledObjective:
    """An objective and its gradient as Python source, for solvers with a compiled inner loop.

    Attached to programs; see `casswarm.nlp.Nlp.attached`.

    Parameters
    ----------
    source : str
        Text of a module of kernels, of which ``evaluate_few`` or ``evaluate_many`` returns f(x; p)
        and writes the gradient. All problems of a kind have the same source, which is compiled
        once.
    constants : (s,) or (H, s)
        Numbers that all instances share, such as the positions of radars; of H steps, those of
        each, where they differ.
    large : bool
        Whether it is for `LARGE_SWARM` members (pairs of coordinates of x) or more. Where
        `gradient` has 5n entries, it then also writes the second derivatives (xx, xy, yy) of
        every member, which precondition Newton steps.
    starts : int
        Number of initial guesses that its problems are worth: see `StartCount`.
    lanes : str
        Text of a module whose ``evaluate_lanes`` evaluates several states at a time (see
        `casswarm.formation.lane_objective_kernels`); empty if there is none, or no need.
    """

    source: str
    constants: FloatArray
    large: bool
    starts: int = 1
    lanes: str = ""

    @property
    def evaluate(self) -> Any:
        """The compiled function, to be passed to kernels."""
        return _evaluate(self.source, self.large)

    @property
    def kernels(self) -> tuple[Any, Any, Shared]:
        """The compiled functions and constants, as `minimise_batch` takes them."""
        lanes = _evaluate_lanes(self.lanes) if self.lanes else self.evaluate
        return self.evaluate, lanes, Shared(bool(self.lanes), self.constants)


@locked_cache(maxsize=64)
def _evaluate(source: str, large: bool) -> Any:
    module = generated_module(source)
    return objective(module.evaluate_many if large else module.evaluate_few)


@locked_cache(maxsize=64)
def _evaluate_lanes(source: str) -> Any:
    return objective(generated_module(source).evaluate_lanes)


@dataclass(frozen=True)
class StartCount:
    """Number of initial guesses that batch solvers, for which they cost little, try by default.

    Attached to programs where local minima are common, whatever the form of their objective.
    """

    number: int


def start_count(nlp: Nlp) -> int:
    """The number of initial guesses that a program is worth: one, unless it says more."""
    attached = nlp.attached(StartCount)
    return 1 if attached is None else attached.number


MANY_HAZARDS = 512
"""Of caches: where rates depend on time, or on a belief, each step or belief has its own."""


@locked_cache(maxsize=MANY_HAZARDS)
def formation_program(
    hazard: Hazard,
    n: int,
    corridor: bool,
    horizon: int = 1,
    later: tuple[Hazard, ...] = (),
    disc: bool = False,
) -> Nlp:
    """The program of `formation_nlp` with what the batch solvers read."""
    nlp = formation_nlp(hazard, n, corridor, horizon, later, disc)
    compiled = formation_objective(hazard, n, corridor)
    if compiled is not None and later:
        each = [formation_objective(other, n, corridor) for other in later]
        constants = np.stack([compiled.constants, *(one.constants for one in each if one)])
        compiled = replace(compiled, constants=constants)
    if compiled is not None:
        nlp = nlp.with_attachments(compiled)
    starts = starts_for(hazard)
    return nlp if starts == 1 else nlp.with_attachments(StartCount(starts))


def starts_for(hazard: Hazard) -> int:
    """Number of initial guesses of formation programs: several where members collide."""
    return 1 if isinstance(hazard, KernelHazard) and not hazard.collides else 4


@locked_cache(maxsize=MANY_HAZARDS)
def formation_objective(hazard: Hazard, n: int, corridor: bool) -> CompiledObjective | None:
    """The compiled objective; its constants are the hazard's parameters, then its radars.

    None for hazards that are not made of kernels, or of such as have no counterpart in Python.
    Leader protection has a closed form where members gather, and no need for lanes.
    """
    large = n >= LARGE_SWARM
    found = rate_module(hazard, *(MANY if large else FEW), reordering=large)
    if found is None:
        return None
    assert isinstance(hazard, KernelHazard)
    closed = hazard.gathers and not corridor
    lanes = None if large or closed else rate_module(hazard, *LANE_KERNELS)
    return CompiledObjective(*found, large, starts_for(hazard), lanes[0] if lanes else "")
