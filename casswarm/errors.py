"""What casswarm raises, so that a caller can catch one base class."""

from __future__ import annotations

from collections.abc import Iterable
from difflib import get_close_matches


class CasswarmError(Exception):
    """Base of every error that casswarm raises on purpose."""


class ScenarioError(CasswarmError, ValueError):
    """A scenario that is wrong: the message names the file, the key and what is allowed."""


class HazardError(CasswarmError, ValueError):
    """A hazard whose rates are of the wrong shape, negative or not finite."""


class PolicyError(CasswarmError, ValueError):
    """A policy that is unknown, or whose velocities are of the wrong shape or not finite."""


class SolverError(CasswarmError, ValueError):
    """A solver that is unknown, misconfigured, or cannot take the problem it was given."""


class PlanningError(CasswarmError, RuntimeError):
    """No guide was found; the message tells the outcome of every start."""


class ComparisonError(CasswarmError, ValueError):
    """A comparison of solvers that is misconfigured, or a folder that holds another one."""


class CheckpointError(CasswarmError, RuntimeError):
    """A results folder that is in use, was made with other inputs, or holds unfinished work."""


class WorkerError(CasswarmError, RuntimeError):
    """Processes that were to do the work died again and again; what was done before is kept."""


def did_you_mean(word: str, known: Iterable[str]) -> str:
    """The end of a message about an unknown word: the known word nearest to it, and all of them."""
    words = list(known)
    close = get_close_matches(word, words, 1)
    hint = f"; did you mean {close[0]!r}?" if close else ""
    return f"{hint} (known: {', '.join(words)})"
