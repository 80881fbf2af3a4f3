"""What casswarm raises, so that a caller can catch one base class."""

from __future__ import annotations

from typing import Any


class CasswarmError(Exception):
    """Base of every error that casswarm raises on purpose.

    Parameters
    ----------
    message : str
    **values
        What the message is about, such as ``member=2``; each becomes an attribute of the error.

    Examples
    --------
    >>> CasswarmError("member 2 has no position", member=2).member
    2
    """

    def __init__(self, message: str, **values: Any) -> None:
        super().__init__(message)
        self.__dict__.update(values)

    def __getattr__(self, name: str) -> Any:  # for type checkers: the values are dynamic
        raise AttributeError(f"{type(self).__name__!r} error has no value {name!r}")


class ScenarioError(CasswarmError, ValueError):
    """An invalid scenario; the message names the file, every invalid key and its allowed values.

    The attributes `key`, `value` and `allowed` are those of the first problem, `problems` has them
    all, and `file` is the path of a scenario file.
    """


class HazardError(CasswarmError, ValueError):
    """A hazard whose rates are of the wrong shape, negative or not finite."""


class PolicyError(CasswarmError, ValueError):
    """A policy that is unknown, or whose velocities are of the wrong shape or not finite."""


class PolicyCallError(PolicyError):
    """A policy that failed in a run: it raised an exception, took too long, or decided nonsense.

    The attributes `policy` and `step` say where; an exception that it raised is the cause.
    """


class EnvError(CasswarmError, ValueError):
    """An environment for learning that is misconfigured, or stepped with actions it cannot take."""


class SolverError(CasswarmError, ValueError):
    """A solver that is unknown, misconfigured, or cannot take the problem it was given."""


class ProblemError(CasswarmError, ValueError):
    """An optimisation problem that cannot be posed, or read from a file or written to one.

    The attribute `file` is the path, where there is one.
    """


class PlanningError(CasswarmError, RuntimeError):
    """No guide was found; the message counts the outcomes of all starts."""


class ComparisonError(CasswarmError, ValueError):
    """A comparison of solvers that is misconfigured, or a folder that holds another one."""


class CheckpointError(CasswarmError, RuntimeError):
    """A results folder that is in use, was made with other inputs, or holds unfinished work."""


class FolderError(CasswarmError, OSError):
    """A results folder or file that cannot be written."""


class WorkerError(CasswarmError, RuntimeError):
    """Processes that were to do the work died again and again; what was done before is kept."""


class ExtraError(CasswarmError, ImportError):
    """A package that an extra installs is missing; the message names the command to install it."""
