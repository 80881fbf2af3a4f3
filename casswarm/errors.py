"""What casswarm raises, so that a caller can catch one base class.

Every class declares the values that its messages are about. They are attributes of the error, None
where a message is not about them. Objects of users are kept as text, so that errors can be pickled.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

Shape = tuple[int, ...]

_LONG_WORD = re.compile(r"(\S{100})\S{400,}")  # longer than paths
_LONG_LINE = re.compile(r"(.{1000}).{1000,}")


def _bounded(message: str) -> str:
    """Message whose words and lines are cut where a text of somebody else makes them very long."""
    return _LONG_LINE.sub(r"\1...", _LONG_WORD.sub(r"\1...", message))


class CasswarmError(Exception):
    """Base of every error that casswarm raises on purpose.

    Parameters
    ----------
    message : str
        Words of more than 500 characters and lines of more than 2000 are cut.
    **values
        What the message is about, such as ``member=2``; each becomes an attribute of the error.

    Attributes
    ----------
    key : str or None
        Parameter, or dotted key of a scenario, that has a wrong value.
    value : object
        What was given.
    allowed : str or None
        What is allowed, in words.
    expected : object
        What was expected instead of `value`, `shape` or `members`.
    shape : tuple of int or None
        Shape of an array that has another one than expected.

    Examples
    --------
    >>> CasswarmError("n = 0; allowed: whole numbers from 1", key="n", value=0).key
    'n'
    """

    key: str | None = None
    value: Any = None
    allowed: str | None = None
    expected: Any = None
    shape: Shape | None = None

    def __init__(self, message: str, **values: Any) -> None:
        super().__init__(_bounded(message))
        self.__dict__.update(values)


class CasswarmWarning(UserWarning):
    """A result that holds less than was asked for; the message says why, and what would help."""


class ScenarioError(CasswarmError, ValueError):
    """An invalid scenario; the message names the file, every invalid key and its allowed values.

    The attributes `key`, `value` and `allowed` are those of the first problem, `problems` has them
    all, and `file` is the path of a scenario file. `function` is the name of a hazard's function,
    and `part` what does not treat the value of a key.
    """

    problems: tuple[Any, ...] = ()
    part: str | None = None
    file: Path | None = None
    function: str | None = None
    min_distance: float | None = None
    least_distance: float | None = None


class HazardError(CasswarmError, ValueError):
    """A hazard whose rates are of the wrong shape, negative or not finite.

    The attribute `hazard` describes it; `function` and `folder` are the name of a function and
    where it was searched for, `members` is the size of the swarm in which it failed, and
    `operation` is the one of CasADi that it cannot use. A wrong `rate` is that of `member` in
    `state` of a batch, at `position`; a lower `bound` was above it. A `part` of the package does
    not treat it.
    """

    hazard: str | None = None
    function: str | None = None
    folder: Path | None = None
    members: int | None = None
    operation: str | None = None
    part: str | None = None
    state: int | None = None
    member: int | None = None
    position: tuple[float, float] | None = None
    rate: float | None = None
    bound: float | None = None


class PolicyError(CasswarmError, ValueError):
    """A policy that is unknown, or whose velocities are of the wrong shape or not finite.

    The attribute `policy` is its name, and `step` the step of a run in which it failed.
    """

    policy: Any = None
    policies: Sequence[str] | None = None
    scenario: str | None = None
    step: int | None = None
    members: int | None = None
    max_members: int | None = None
    horizon: Any = None
    framework: str | None = None
    leader_selection: str | None = None
    dtype: Any = None
    shapes: Any = None
    index: tuple[int, ...] | None = None
    state: int | None = None


class PolicyCallError(PolicyError):
    """A policy that failed in a run: it raised an exception, took too long, or decided nonsense.

    The attributes `policy` and `step` say where; an exception that it raised is the cause. A
    `velocity` that is not finite is that of `member` in `state` of a batch.
    """

    member: int | None = None
    velocity: Any = None
    time_limit: float | None = None


class EnvError(CasswarmError, ValueError):
    """An environment for learning that is misconfigured, or stepped with actions it cannot take.

    The attributes `environment`, `member` (or `agent`, its name) and `action` say which action;
    `environments` are those that are over.
    """

    environment: int | None = None
    environments: Any = None
    member: int | None = None
    agent: str | None = None
    action: Any = None
    hazard: str | None = None
    dtype: Any = None
    render_mode: str | None = None
    autoreset_mode: Any = None


class SolverError(CasswarmError, ValueError):
    """A solver that is unknown, misconfigured, or cannot take the problem it was given.

    The attribute `solver` is its name, `option` that of a wrong option, `problem` that of the
    problem, and `constraints` are the names of those that it cannot take.
    """

    solver: Any = None
    option: str | None = None
    problem: str | None = None
    constraints: Sequence[str] | None = None
    search: Any = None
    objective: Any = None
    initial_guesses: Any = None


class ProblemError(CasswarmError, ValueError):
    """An optimisation problem that cannot be posed, or read from a file or written to one.

    The attribute `problem` is its name, `start` that of an initial guess, and `file` the path and
    `line` the number of its line, where there are such.
    """

    problem: str | None = None
    start: str | None = None
    file: Path | None = None
    line: int | None = None


class PlanningError(CasswarmError, RuntimeError):
    """No guide was found; the message counts the outcomes of all starts.

    The attribute `outcomes` has these counts. Of a problem that is too large, `nodes`, `max_nodes`,
    `steps` and `members` are its size and the limit. Of a hazard that is not known, `case` is the
    index of a case without a guide, and `ambiguity` is a set of priors that is not `allowed`.
    `remedies` are changes of keys (`casswarm.guide.remedies.Remedy`) of which each is enough.
    """

    outcomes: Mapping[str, int] | None = None
    remedies: tuple[object, ...] | None = None
    time_limit: float | None = None
    nodes: int | None = None
    max_nodes: int | None = None
    steps: int | None = None
    members: int | None = None
    case: int | None = None
    ambiguity: object = None
    allowed: str | None = None


class ComparisonError(CasswarmError, ValueError):
    """A comparison of solvers that is misconfigured, or a folder that holds another one.

    The attributes `family`, `scenario` and `policy` say which problems cannot be posed; `problem`,
    `start` and `solver` are names of what is unknown or repeated.
    """

    family: str | None = None
    problem: str | None = None
    start: str | None = None
    solver: str | None = None
    scenario: str | None = None
    policy: str | None = None
    folder: Path | None = None


class CheckpointError(CasswarmError, RuntimeError):
    """A results folder that is in use, was made with other inputs, or holds unfinished work.

    The attribute `folder` is its path, `keys` are the inputs that differ, and `figure` is the name
    of one that it lacks.
    """

    folder: Path | None = None
    figure: str | None = None
    keys: Any = None


class FolderError(CasswarmError, OSError):
    """A results folder or file that cannot be written; `path` is its path."""

    path: Path | None = None


class WorkerError(CasswarmError, RuntimeError):
    """Processes that were to do the work died again and again; what was done before is kept.

    Or they have another casswarm: `version` is that of this process, `worker_version` theirs.
    """

    version: str | None = None
    worker_version: str | None = None


class ExtraError(CasswarmError, ImportError):
    """A package that an extra installs is missing; the message names the command to install it.

    The attributes `package` and `extra` are their names.
    """

    package: str | None = None
    extra: str | None = None
