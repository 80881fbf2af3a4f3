"""What the documentation says is true: examples run, links lead somewhere, docstrings are whole."""

from __future__ import annotations

import doctest
import inspect
import re
from pathlib import Path

import pytest
from doc_blocks import blocks, near, run, said

import casswarm

ROOT = Path(__file__).resolve().parents[2]
MADE = {"_build", "notebooks"}  # by sphinx-build
PAGES = [
    ROOT / "README.md",
    ROOT / "CHANGELOG.md",
    *sorted(
        page
        for page in (ROOT / "docs").rglob("*.md")
        if not MADE & set(page.relative_to(ROOT).parts)
    ),
]
PUBLIC = {name: getattr(casswarm, name) for name in casswarm.__all__}


# --- pages


@pytest.mark.parametrize("page", [p for p in PAGES if blocks(p)], ids=lambda page: page.stem)
def test_marked_examples_of_a_page_run(page: Path, tmp_path: Path) -> None:
    run(page, tmp_path)


def test_pages_on_how_to_add_have_no_python_that_is_not_run() -> None:
    for name in ("own-rates", "own-policies", "own-solvers", "quickstart"):
        page = ROOT / "docs" / f"{name}.md"
        shown = page.read_text(encoding="utf-8").count("\n```python\n")
        assert shown == sum(block.language == "python" for block in blocks(page)) > 0


def test_told_lines_are_compared_with_their_numbers() -> None:
    assert said("leader  0.71", "policy\nleader  0.7101\n")
    assert not said("leader  0.71", "leader  0.75\n")
    assert not said("leader  0.71", "naive  0.71\n")
    assert not said("leader 7", "leader 8\n")
    assert near([1e-9], [2e-9])


def slug(heading: str) -> str:
    """Anchor of a heading, as GitHub and MyST make it."""
    plain = re.sub(r"\[([^\]]*)\]\([^)]*\)", r"\1", heading).strip().lower()
    return re.sub(r"[^\w\- ]", "", plain).replace(" ", "-")


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_links_within_the_repository_lead_somewhere(page: Path) -> None:
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


# --- docstrings


@pytest.mark.parametrize("name", PUBLIC)
def test_docstring_of_a_public_name_tells_every_parameter(name: str) -> None:
    value = PUBLIC[name]
    text = inspect.getdoc(value) or ""
    assert missing(value, text) == []
    for member, method in inspect.getmembers(value, inspect.isfunction):
        if not member.startswith("_") and method.__module__.startswith("casswarm"):
            assert inspect.getdoc(method), f"{name}.{member} says nothing"


def missing(value: object, text: str) -> list[str]:
    """Parameters that a docstring does not mention as such."""
    if inspect.isclass(value) and not hasattr(value, "__dataclass_fields__"):
        return []  # made by casswarm, not by users
    told = set(re.findall(r"\w+", " ".join(re.findall(r"^\**([\w*, ]+?)(?: : .*)?$", text, re.M))))
    inherited = " ".join(inspect.getdoc(base) or "" for base in getattr(value, "__mro__", ()))
    given = inspect.signature(value).parameters  # type: ignore[arg-type]
    return [name for name in given if name not in told and name not in inherited]


@pytest.mark.parametrize(
    "test",
    [
        test
        for name in PUBLIC
        for test in doctest.DocTestFinder().find(PUBLIC[name], name)
        if test.examples
    ],
    ids=lambda test: test.name,
)
def test_examples_in_docstrings_run(test: doctest.DocTest) -> None:
    results = doctest.DocTestRunner(optionflags=doctest.NORMALIZE_WHITESPACE).run(test)
    assert results.attempted
    assert not results.failed


def test_the_functions_that_users_begin_with_have_examples() -> None:
    begin = ("load_scenario", "plan", "make_policy", "make_solver", "simulate", "evaluate")
    for name in begin:
        assert doctest.DocTestFinder(recurse=False).find(PUBLIC[name])[0].examples, name
