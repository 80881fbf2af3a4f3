"""The documentation is correct: examples run, links resolve, docstrings are complete."""

from __future__ import annotations

import doctest
import inspect
import re
from pathlib import Path

import pytest
from doc_blocks import blocks, is_printed, near, run
from figure_cases import GUIDE, SCENARIO
from glossary import TERMS, unexplained

import casswarm
from casswarm import as_policy, simulate
from casswarm.figures import guide_map
from casswarm.policies import POLICIES

ROOT = Path(__file__).resolve().parents[2]
GENERATED = {"_build", "notebooks"}  # by sphinx-build
PAGES = [
    ROOT / "README.md",
    ROOT / "CHANGELOG.md",
    ROOT / "CONTRIBUTING.md",
    *sorted(
        page
        for page in (ROOT / "docs").rglob("*.md")
        if not GENERATED & set(page.relative_to(ROOT).parts)
    ),
]
PUBLIC = {name: getattr(casswarm, name) for name in casswarm.__all__}


# --- pages


@pytest.mark.slow
@pytest.mark.parametrize("page", list(filter(blocks, PAGES)), ids=lambda page: page.stem)
def test_page_with_marked_examples_runs(page: Path, tmp_path: Path) -> None:
    run(page, tmp_path)


def test_how_to_pages_have_only_tested_python() -> None:
    for name in ("own-rates", "own-policies", "own-solvers", "quickstart", "infeasible-problems"):
        page = ROOT / "docs" / f"{name}.md"
        shown = page.read_text(encoding="utf-8").count("\n```python\n")
        assert shown == sum(block.language == "python" for block in blocks(page)) > 0


def test_output_comparison_tolerates_last_digits_only() -> None:
    assert is_printed("leader  0.71", "policy\nleader  0.7101\n")
    assert not is_printed("leader  0.71", "leader  0.75\n")
    assert not is_printed("leader  0.71", "naive  0.71\n")
    assert not is_printed("leader 7", "leader 8\n")
    assert near([1e-9], [2e-9])


def test_quickstart_removes_the_title_and_prints_success(
    capsys: pytest.CaptureFixture[str],
) -> None:
    page = (ROOT / "docs" / "quickstart.md").read_text(encoding="utf-8")
    lines = [line for line in page.splitlines() if line.endswith("# the caption replaces it")]
    figure = guide_map(SCENARIO, GUIDE)
    assert figure.get_suptitle()
    exec("\n".join(lines), {"figure": figure})
    assert not figure.get_suptitle()
    policy = as_policy(lambda _, positions, *__: 0 * positions, name="waiting")
    study = simulate(SCENARIO, [policy], runs=2, guide=GUIDE)
    exec(next(line for line in page.splitlines() if line.startswith("print(")), {"study": study})
    assert "success" in capsys.readouterr().out


def slug(heading: str) -> str:
    """Anchor of a heading, as GitHub and MyST make it."""
    plain = re.sub(r"\[([^\]]*)\]\([^)]*\)", r"\1", heading).strip().lower()
    return re.sub(r"[^\w\- ]", "", plain).replace(" ", "-")


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_relative_links_of_page_resolve(page: Path) -> None:
    text = re.sub(r"^```.*?^```$", "", page.read_text(encoding="utf-8"), flags=re.M | re.S)
    for link in re.findall(r"\]\(([^)\s]+)\)", text):
        if link.startswith(("http:", "https:")):
            continue
        name, _, anchor = link.partition("#")
        target = (page.parent / name).resolve() if name else page
        assert target.exists(), f"{page.name} links {link}"
        if anchor:
            headings = re.findall(r"^#+ (.*)$", target.read_text(encoding="utf-8"), re.M)
            assert anchor in map(slug, headings), f"{page.name} links {link}"


# --- glossary; the columns that commands write are in tests/cli/test_every_command.py


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_lines_of_page_are_short(page: Path) -> None:
    """At most 100 characters but in tables, examples, and what cannot be broken."""
    text = re.sub(
        r"^ *(```+).*?^ *\1$|^ *\$\$.*?\$\$|^ *\|.*?$",
        "",
        page.read_text("utf-8"),
        flags=re.M | re.S,
    )
    breakable = re.sub(r"`[^`\n]+`|\$[^$\n]+\$|\]\([^)\n]*\)", "", text)
    assert [line for line in breakable.splitlines() if len(line) > 100] == []


def toctree(caption: str) -> list[str]:
    """Pages of the site below a caption."""
    index = (ROOT / "docs" / "index.md").read_text(encoding="utf-8")
    (pages,) = re.findall(rf"^:caption: {caption}\n(?::.*\n)*\n((?:.+\n)*)```$", index, re.M)
    return [page for page in str(pages).split() if "*" not in page]


@pytest.mark.parametrize("name", toctree("Getting started") + toctree("Use"))
def test_page_of_use_is_read_in_minutes(name: str) -> None:
    """At most 800 words without headings, examples and tables: the rest is mathematics."""
    text = (ROOT / "docs" / f"{name}.md").read_text(encoding="utf-8")
    prose = re.sub(r"^ *(```+).*?^ *\1$|^ *\|.*?$|^#.*?$", "", text, flags=re.M | re.S)
    assert len(prose.split()) <= 800


def test_glossary_has_every_public_name() -> None:
    assert sorted(set(casswarm.__all__) - TERMS) == []


def test_glossary_has_every_policy() -> None:
    names = {re.sub(r"mpc-\d+", "mpc-H", name) for name in POLICIES}
    assert sorted(names - TERMS) == []


def test_glossary_has_every_column_of_kept_results() -> None:
    assert unexplained((ROOT / "results").glob("p*/*.csv")) == {}


# --- docstrings


@pytest.mark.parametrize("name", PUBLIC)
def test_docstring_of_public_name_has_every_parameter(name: str) -> None:
    value = PUBLIC[name]
    text = inspect.getdoc(value) or ""
    assert inspect.ismodule(value) or missing(value, text) == []
    for member, method in inspect.getmembers(value, inspect.isfunction):
        if not member.startswith("_") and method.__module__.startswith("casswarm"):
            assert inspect.getdoc(method), f"{name}.{member} has no docstring"


def missing(value: object, text: str) -> list[str]:
    """Parameters that a docstring does not mention as such."""
    if inspect.isclass(value) and not hasattr(value, "__dataclass_fields__"):
        return []  # constructed by casswarm, not by users
    documented = set(
        re.findall(r"\w+", " ".join(re.findall(r"^\**([\w*, ]+?)(?: : .*)?$", text, re.M)))
    )
    inherited = " ".join(inspect.getdoc(base) or "" for base in getattr(value, "__mro__", ()))
    parameters = inspect.signature(value).parameters  # type: ignore[arg-type]
    return [name for name in parameters if name not in documented and name not in inherited]


SLOW = "optimal_value", "value_of_information", "plan_swarm_mixture"


@pytest.mark.parametrize(
    "test",
    [
        pytest.param(test, marks=pytest.mark.slow if name in SLOW else ())
        for name in PUBLIC
        for test in doctest.DocTestFinder().find(PUBLIC[name], name)
        if test.examples
    ],
    ids=lambda test: test.name,
)
def test_docstring_examples_run(test: doctest.DocTest) -> None:
    results = doctest.DocTestRunner(optionflags=doctest.NORMALIZE_WHITESPACE).run(test)
    assert results.attempted
    assert not results.failed


def test_main_functions_have_examples() -> None:
    main_functions = ("load_scenario", "plan", "make_policy", "make_solver", "simulate", "evaluate")
    for name in main_functions:
        assert doctest.DocTestFinder(recurse=False).find(PUBLIC[name])[0].examples, name
