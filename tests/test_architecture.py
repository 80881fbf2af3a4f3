"""The house of design.md section 4: who may import whom, and what an import costs."""

from __future__ import annotations

import ast
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

import pytest

import casswarm

ROOT = Path(__file__).parents[1]
FOLDERS = {"casswarm": ROOT / "casswarm", "casswarm.problems": ROOT / "problems"}
FOLDERS["casswarm.cli"] = ROOT / "cli"

LAYERS = (
    ("errors", "constants", "arrays", "compiling", "planar_core", "subsets", "templates"),
    ("path_core", "barrier_core", "barrier_batch_core"),
    ("sets", "paths", "hazard"),
    ("scenario",),
    ("parameters",),
    ("nlp", "solution", "residuals"),
    ("solvers",),
    ("problems",),
    ("guide", "starts", "certificate"),
    ("search", "planning"),
    ("swarm",),
    ("policies",),
    ("statistics", "store", "workers"),
    ("chain",),
    ("shares", "study", "pilot", "evaluation", "tables", "figures", "comparison"),
    ("cells", "sweeping", "gallery", "restoring", "saved", "reporting"),
    ("reproduction",),
    ("cli",),
)
"""Each imports from its own row and the rows above. A new module finds its row here."""

NEVER = {
    "nlp": ("scenario", "hazard"),
    "solution": ("scenario", "hazard"),
    "residuals": ("scenario", "hazard"),
    "solvers": ("scenario", "hazard", "problems", "policies"),  # know nlp, never a swarm
    "problems": ("solvers",),  # build and solve are two things
    "figures": ("study", "planning", "solvers", "comparison"),  # data in, Figure out
}
"""What the rows alone would allow."""


@dataclass(frozen=True)
class Import:
    """An import of `target` in `source`, both without the leading ``casswarm.``."""

    source: str
    target: str
    line: int
    lazy: bool
    """In a function, so not when the module is imported."""
    typing: bool
    """For type checkers alone."""

    def __str__(self) -> str:
        return f"{self.source}:{self.line} imports {self.target}"


@cache
def modules() -> dict[str, Path]:
    """Files by module, named without the leading ``casswarm.``; the root package is ''."""
    found = {}
    for package, folder in FOLDERS.items():
        for path in folder.rglob("*.py"):
            parts = path.relative_to(folder).with_suffix("").parts
            parts = parts[:-1] if parts[-1] == "__init__" else parts
            name = ".".join((*package.split(".")[1:], *parts))
            found[name] = path
    return found


def is_typing(node: ast.AST) -> bool:
    return isinstance(node, ast.If) and ast.unparse(node.test) in (
        "TYPE_CHECKING",
        "typing.TYPE_CHECKING",
    )


def imports_in(source: str, path: Path) -> Iterator[Import]:
    package = source if path.name == "__init__.py" else source.rpartition(".")[0]

    def targets(node: ast.AST) -> Iterator[str]:
        if isinstance(node, ast.Import):
            names = [alias.name for alias in node.names]
            yield from (n.removeprefix("casswarm.") for n in names if n.startswith("casswarm."))
        elif isinstance(node, ast.ImportFrom):
            base = node.module or ""
            if node.level:
                parts = package.split(".") if package else []
                kept = parts[: len(parts) - node.level + 1]
                base = ".".join([*kept, *filter(None, [base])])
            elif base == "casswarm" or base.startswith("casswarm."):
                base = base.removeprefix("casswarm").lstrip(".")
            else:
                return
            for alias in node.names:
                inner = f"{base}.{alias.name}".lstrip(".")
                yield inner if inner in modules() else base

    def walk(node: ast.AST, lazy: bool, typing: bool) -> Iterator[Import]:
        for target in targets(node):
            yield Import(source, target, getattr(node, "lineno", 0), lazy, typing)
        inside = isinstance(node, (ast.FunctionDef, ast.AsyncFunctionDef, ast.Lambda))
        for child in ast.iter_child_nodes(node):
            checked = is_typing(node) and child in node.body
            yield from walk(child, lazy or inside, typing or checked)

    yield from walk(ast.parse(path.read_text()), False, False)


@cache
def imports() -> tuple[Import, ...]:
    return tuple(found for name, path in modules().items() for found in imports_in(name, path))


def row_of(module: str) -> int:
    return next(row for row, names in enumerate(LAYERS) if module.split(".")[0] in names)


def told(bad: list[Import]) -> str:
    return "\n".join(map(str, bad))


# --- direction


def test_every_module_has_a_row() -> None:
    known = {name for names in LAYERS for name in names}
    assert {name.split(".")[0] for name in modules()} - {""} <= known
    assert known <= {name.split(".")[0] for name in modules()}


def test_the_parser_sees_imports_of_all_kinds() -> None:
    seen = {(i.source, i.target, i.lazy, i.typing) for i in imports()}
    assert ("planning", "problems.guide", False, False) in seen
    assert ("planning", "scenario", False, True) in seen
    assert ("scenario.hazards", "hazard", True, False) in seen
    assert ("problems.guide", "nlp", False, False) in seen
    assert ("scenario.model", "scenario.checks", False, False) in seen


@pytest.mark.parametrize("typing", [False, True], ids=["when run", "for type checkers"])
def test_modules_import_only_from_their_own_row_and_above(typing: bool) -> None:
    relevant = [i for i in imports() if i.source and i.target and i.typing == typing]
    bad = [i for i in relevant if row_of(i.target) > row_of(i.source)]
    assert not bad, told(bad)


@pytest.mark.parametrize("package", NEVER)
def test_module_never_imports_what_it_must_not_know(package: str) -> None:
    bad = [
        i
        for i in imports()
        if i.source.split(".")[0] == package and i.target.split(".")[0] in NEVER[package]
    ]
    assert not bad, told(bad)


def test_chain_knows_of_policies_their_one_verb_alone() -> None:
    known = {i.target for i in imports() if i.source.startswith("chain")}
    assert {target for target in known if target.startswith("policies")} == {"policies.base"}
    assert not {target for target in known if target.startswith(("planning", "solvers"))}


def test_scenarios_import_hazards_only_when_they_are_used() -> None:
    found = [i for i in imports() if i.source.startswith("scenario") and i.target == "hazard"]
    assert found
    assert all(i.lazy or i.typing for i in found), told(found)


def test_only_the_root_hands_everything_out() -> None:
    """Modules import from where a name lives, not from the package's front door."""
    bad = [i for i in imports() if i.target == "" and not i.source.startswith("cli")]
    assert not bad, told(bad)


def test_no_module_imports_itself_in_a_circle() -> None:
    graph: dict[str, set[str]] = {name: set() for name in modules()}
    for found in imports():
        if found.source and found.target and not found.typing:
            graph[found.source].add(found.target)
    try:
        TopologicalSorter(graph).prepare()
    except CycleError as error:
        pytest.fail(" -> ".join(error.args[1]))


# --- what imports cost

HEAVY = {"casadi", "pandas", "matplotlib", "scipy", "numba", "pydantic", "jinja2", "PIL"}


def loaded_after(code: str) -> set[str]:
    """Top-level packages that a fresh interpreter has imported after `code`."""
    report = f"{code}\nimport sys\nprint(*{{name.partition('.')[0] for name in sys.modules}})"
    command = [sys.executable, "-c", report]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return set(done.stdout.splitlines()[-1].split())


def test_import_casswarm_imports_nothing_heavy() -> None:
    loaded = loaded_after("import casswarm; dir(casswarm); casswarm.__version__")
    assert "casswarm" in loaded
    assert not loaded & (HEAVY | {"numpy"})


@pytest.mark.parametrize("arguments", [["--help"], ["--version"], ["plan", "--help"]])
def test_help_imports_nothing_heavy(arguments: list[str]) -> None:
    code = (
        "from casswarm.cli import main\n"
        f"try:\n    main({arguments!r}, prog_name='casswarm')\n"
        "except SystemExit as end:\n    assert end.code == 0\n"
    )
    assert not loaded_after(code) & (HEAVY | {"numpy"})


def test_planning_needs_neither_tables_nor_figures() -> None:
    code = "import casswarm; casswarm.plan(casswarm.load_scenario('paper-1'))"
    assert not loaded_after(code) & {"pandas", "matplotlib"}


# --- the front door, and size


@pytest.mark.parametrize("name", casswarm.__all__)
def test_public_name_resolves_to_what_its_home_calls_so(name: str) -> None:
    value = getattr(casswarm, name)
    assert value.__name__ == name
    assert value.__module__.startswith("casswarm.")
    assert name in dir(casswarm)


def test_unknown_name_is_an_attribute_error() -> None:
    with pytest.raises(AttributeError, match="has no attribute 'simulatte'"):
        casswarm.simulatte  # noqa: B018


def test_no_file_is_longer_than_four_hundred_lines() -> None:
    lengths = {name: len(path.read_text().splitlines()) for name, path in modules().items()}
    assert {name: length for name, length in lengths.items() if length > 400} == {}
