"""Helpers of commands: errors, work, scenarios with changed values, policies by name, executors."""

from __future__ import annotations

import tomllib
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import click

import casswarm as csw

from .._util.documents import json_text
from .._util.files import atomic_write
from .._util.parts import Part, PartFolder, PartSaved
from .._util.text import printable
from .._util.user_code import USER_ERRORS, failure_text, module_file
from .._util.user_code import load as load_code
from ..errors import (
    CasswarmError,
    FolderError,
    PlanningError,
    PolicyCallError,
    PolicyError,
    SolverError,
    WorkerError,
)
from .options import PolicyOptions, ResultOptions, ScenarioInput, StudyOptions
from .output import (
    ProgressReport,
    open_folder,
    print_result,
    progress_report,
    said_warnings,
    say,
)

if TYPE_CHECKING:
    from ..results.catalogue import FigureCatalogue
    from ..results.folder import ResultsFolder

T = TypeVar("T")


class Failure(click.ClickException):
    """The input was fine, the work failed: exit code 1."""

    exit_code = 1

    def __init__(self, message: str) -> None:
        super().__init__(printable(message))


class WrongInput(Failure):
    """The input is wrong: exit code 2."""

    exit_code = 2


PART_FILE = "part.json"
"""What a command writes in the folder of a part when it is finished: part, parts, arguments."""

ARGUMENTS = "casswarm.cli.arguments"
"""Key of a context's `meta` with the words of the command line after ``casswarm``."""

_PART_OPTIONS = {
    "--part": 1,
    "--out": 1,
    "--workers": 1,
    "--dask": 1,
    "--resume": 0,
    "--overwrite": 0,
}
"""Options in which parts may differ, and whether a value follows."""

_FREE = "free some space, then continue with --resume"


@dataclass
class SavedWork:
    """Work that a study has saved by the time it fails.

    Parameters
    ----------
    folder : Path, optional
        Folder of its results, once it is known.
    since : float
        Time of `time.time`; what was saved before is of an earlier study.
    """

    folder: Path | None = None
    since: float = 0.0

    def advice(self, text: str) -> str:
        """End of a message: that work is saved, and how to continue; empty if none is."""
        from .._util.checkpoint import has_records

        if self.folder is None or not has_records(self.folder, self.since):
            return ""
        return f"; finished work is saved in {self.folder}: {text}"


@contextmanager
def reported_errors(resume: str = "continue with --resume") -> Iterator[SavedWork]:
    """Turn the library's errors into messages and exit codes.

    Yields a record for a study that saves its work, which the messages then mention; `resume` says
    how it is continued.
    """
    saved = SavedWork()
    try:
        yield saved
    except KeyboardInterrupt as error:
        raise Failure(f"interrupted{saved.advice(resume)}") from error
    except FolderError as error:
        full = error.__cause__ is not None  # else it is not writable at all
        raise Failure(f"{error}{saved.advice(_FREE) if full else ''}") from error
    except (PlanningError, PolicyCallError, WorkerError) as error:
        raise Failure(str(error)) from error
    except CasswarmError as error:
        raise WrongInput(str(error)) from error
    except OSError as error:
        if error.filename is None and error.errno is None:
            raise
        raise Failure(f"{error}{saved.advice(_FREE)}") from error


class Work:
    """The work of a command: its folder, its progress, and its end.

    The tables are written first: what fails after them costs no results, and is reported when the
    result is printed.

    Parameters
    ----------
    output : ResultOptions
    saved : SavedWork
    progress : ProgressReport, optional
    """

    folder: ResultsFolder

    def __init__(
        self,
        output: ResultOptions,
        saved: SavedWork,
        progress: ProgressReport | None,
    ) -> None:
        self._output, self._saved, self.progress = output, saved, progress
        self.failures: list[str] = []
        self._interrupted, self._undrawn = False, True

    def open(
        self, command: str, scenario: csw.Scenario | None = None, since: float | None = None
    ) -> ResultsFolder:
        """Folder for the results; since a time of `time.time` on, what fails mentions it."""
        self.folder = open_folder(command, scenario, self._output.out, self._output)
        if since is not None:
            self._saved.folder, self._saved.since = self.folder.path, since
        return self.folder

    def checkpoint(self, part: Part | None) -> Path | PartFolder:
        """Where a study is saved, which may be a part of one."""
        if part is None:
            return self.folder.path
        if self._output.out is None:
            raise WrongInput("--part: give every part a folder of its own, with --out")
        return PartFolder(self.folder.path, part)

    def finish_part(self, part: Part) -> None:
        """Write what `casswarm merge` needs, and say so."""
        arguments = click.get_current_context().meta[ARGUMENTS]
        words = {"part": part.number, "parts": part.parts, "arguments": _without_part(arguments)}
        atomic_write(self.folder.path / PART_FILE, json_text(words))
        text = f"{part} is saved in {self.folder.path}; casswarm merge joins all parts"
        click.echo(json_text(words) if self._output.as_json else printable(text))

    def say(self, text: str) -> None:
        """Print a line of progress on standard error."""
        say(text, self._output.quiet)

    def prepare_figures(self) -> None:
        """Start the process that helps to draw, during the work that comes before."""
        if not self._output.no_figures:
            self.folder.prepare_figures()

    def attempt(self, what: str, compute: Callable[[], T]) -> T | None:
        """Result of a computation; None if it fails, and after Ctrl-C, which `finish` reports."""
        if self._interrupted:
            return None
        if self.progress is not None:
            self.progress.watch(what)
        try:
            return compute()
        except KeyboardInterrupt:
            self._interrupted = True
            self.failures.append(f"interrupted during {what}")
        except Exception as error:
            reason = " ".join(str(error).split())
            kind = type(error).__name__
            self.failures.append(f"{what} failed ({f'{kind}: {reason}' if reason else kind})")
        return None

    def draw(self, catalogue: Callable[[], FigureCatalogue] | None = None) -> None:
        """Draw the figures, after the record is written, and add their files to it.

        Does nothing with --no-figures.
        """
        if self._output.no_figures:
            return

        def drawn() -> bool:
            self.folder.write_figures(None if catalogue is None else catalogue(), self.progress)
            return True

        self._undrawn = self.attempt("drawing", drawn) is None
        self.folder.extend_record()

    def report(self) -> None:
        """Write the page of the results."""
        self.attempt("the report", self.folder.write_report)

    def finish(self, text: str) -> None:
        """Print the result, and raise a Failure if something failed after the work."""
        print_result(self.folder, text, self._output)
        if self.failures:
            advice = f"; casswarm plot {self.folder.path} draws the figures"
            raise Failure(
                f"{'; '.join(self.failures)}: the tables and run.json in {self.folder.path} are "
                f"complete{advice if self._undrawn else ''}"
            )


@contextmanager
def work(output: ResultOptions, resume: str = "continue with --resume") -> Iterator[Work]:
    """Work with errors and progress reported; `resume` says how an interrupted study goes on."""
    with (
        reported_errors(resume) as saved,
        said_warnings(),
        progress_report(output.quiet) as progress,
    ):
        job = Work(output, saved, progress)
        try:
            yield job
        except PartSaved as saved_part:
            job.finish_part(saved_part.args[0])


def _without_part(words: Sequence[str]) -> list[str]:
    """Words of a command line without the options in which parts may differ."""
    kept, skipped = [], 0
    for word in words:
        name, equals, _ = word.partition("=")
        if skipped:
            skipped -= 1
        elif name in _PART_OPTIONS:
            skipped = 0 if equals else _PART_OPTIONS[name]
        else:
            kept.append(word)
    return kept


def load(common: ScenarioInput, values: Mapping[str, Any] | None = None) -> csw.Scenario:
    """The scenario, with the values of ``--set`` and of other options.

    `values` are by dotted key; None leaves the scenario's value.
    """
    changes = dict(map(_setting, common.settings))
    changes |= {key: value for key, value in (values or {}).items() if value is not None}
    scenario = csw.load_scenario(common.scenario, allow_code=common.allow_code)
    if not changes:
        return scenario
    from ..scenario.consistency import doubts
    from ..scenario.variations import with_parameters

    changed = with_parameters(scenario, changes)

    for text in doubts(changed):
        if text not in doubts(scenario):
            say(text, getattr(common, "quiet", False))
    return changed


def _setting(text: str) -> tuple[str, object]:
    key, equals, value = text.partition("=")
    if not equals or not key.strip():
        raise WrongInput(f"--set {text!r} is not of the form KEY=VALUE, such as formation.rho=0.1")
    try:
        return key.strip(), tomllib.loads(f"value = {value.strip()}")["value"]
    except (ValueError, RecursionError):
        return key.strip(), value.strip()  # a bare word, such as global


def named_policies(options: PolicyOptions) -> list[Any]:
    """Policies of the options, by default the paper's; their names and the solver's are known.

    The module of ``module:function`` lies in the current folder, or is installed.
    """
    from ..studies.inputs import policy_list
    from ..studies.simulation import PAPER_POLICIES

    csw.make_solver(options.solver)
    limit = options.policy_time_limit
    names = options.policies or PAPER_POLICIES
    return policy_list([_imported(name, limit) if ":" in name else name for name in names])


def _imported(name: str, time_limit: float | None) -> Any:
    try:
        policy = _user_object(name)
    except ImportError as error:
        raise PolicyError(f"policy {name!r}: {error}", policy=name) from error
    return csw.as_policy(policy, name=name.partition(":")[2], time_limit=time_limit)


def named_solver(name: str) -> csw.Solver:
    """Solver of a name, or of ``module:Class`` in the current folder or an installed module.

    An object of such a class, ``module:object``, is a solver with the options it was made with.
    """
    if ":" not in name:
        return csw.make_solver(name)
    try:
        found = _user_object(name)
        solver = found() if isinstance(found, type) else found
    except ImportError as error:
        raise SolverError(f"solver {name!r}: {error}", solver=name) from error
    except USER_ERRORS as error:
        raise SolverError(f"solver {name!r}: {failure_text(error)}", solver=name) from error
    if not isinstance(solver, csw.Solver):
        raise SolverError(f"solver {name!r} is not derived from casswarm.Solver", solver=name)
    return solver


def _user_object(name: str) -> Any:
    """Load ``module:name`` from a module in the current folder, or an installed one."""
    here = Path.cwd()
    return load_code(name, here if module_file(name, here) else None)


@contextmanager
def executor(execution: StudyOptions) -> Iterator[Any]:
    """Number of worker processes, or an executor of a Dask cluster."""
    if execution.dask is None:
        yield execution.workers
        return
    try:
        from dask.distributed import Client
        from distributed.comm.core import connect
    except ImportError as error:
        raise WrongInput("--dask needs Dask: pip install 'casswarm[dask]'") from error
    import asyncio

    async def answer() -> None:
        await (await connect(execution.dask, timeout=10)).close()

    try:
        asyncio.run(answer())  # a client that cannot connect says so at length
        client = Client(execution.dask, timeout=10, set_as_default=False)
    except (OSError, TimeoutError, ValueError) as error:
        raise Failure(f"no Dask scheduler answers at {execution.dask}: {error}") from error
    with client:
        yield client.get_executor(pure=False, retries=3)
