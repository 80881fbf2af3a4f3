"""Values that the shell completes: names of scenarios, policies and solvers, results folders."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

from click import Context, Parameter
from click.shell_completion import CompletionItem

import casswarm as csw

_FILE, _FOLDER = "file", "dir"  # kinds of paths that shells complete themselves


def scenarios(_: Context, __: Parameter, incomplete: str) -> list[CompletionItem]:
    """Built-in scenarios, and files."""
    return [*_matching(csw.builtin_scenarios(), incomplete), CompletionItem(incomplete, _FILE)]


def policies(_: Context, __: Parameter, incomplete: str) -> list[CompletionItem]:
    """Policies by name."""
    from ..policies.named import POLICIES

    return _matching(POLICIES, incomplete)


def solvers(_: Context, __: Parameter, incomplete: str) -> list[CompletionItem]:
    """Solvers by name."""
    return _matching(csw.solvers.SOLVERS, incomplete)


def results(_: Context, __: Parameter, incomplete: str) -> list[CompletionItem]:
    """Results folders below results/, and other folders."""
    records = sorted(Path("results").glob("*/run.json"))
    found = _matching((record.parent.as_posix() for record in records), incomplete)
    return [*found, CompletionItem(incomplete, _FOLDER)]


def _matching(names: Iterable[str], incomplete: str) -> list[CompletionItem]:
    return [CompletionItem(name) for name in names if name.startswith(incomplete)]
