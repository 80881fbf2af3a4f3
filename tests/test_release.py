"""What a release needs: one version everywhere, and workflows that outsiders cannot change."""

from __future__ import annotations

import json
import re
import tomllib
from pathlib import Path

import pytest
import yaml
from commands import casswarm
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

import casswarm as csw

ROOT = Path(__file__).resolve().parents[1]
WORKFLOWS = sorted((ROOT / ".github" / "workflows").glob("*.yml"))
PINNED = re.compile(r"uses: [\w./-]+@[0-9a-f]{40} # v\d+\.\d+\.\d+")


def test_version_is_the_same_everywhere(tmp_path: Path) -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]
    version = project["version"]
    citation = (ROOT / "CITATION.cff").read_text("utf-8")
    changelog = (ROOT / "CHANGELOG.md").read_text("utf-8")
    assert csw.__version__ == version
    assert casswarm(tmp_path, "--version").stdout == f"casswarm, version {version}\n"
    assert f"\nversion: {version}\n" in citation
    released = re.search(r"\ndate-released: (.+)\n", citation)
    assert released
    headings = re.findall(r"^## \[(.+?)\](?: - (.+))?$", changelog, re.MULTILINE)
    assert headings[:2] == [("Unreleased", ""), (version, released[1])]


@pytest.mark.parametrize("path", WORKFLOWS, ids=lambda path: path.stem)
def test_workflows_are_pinned_and_have_few_permissions(path: Path) -> None:
    text = path.read_text("utf-8")
    used = [line.strip(" -") for line in text.splitlines() if "uses:" in line]
    assert used
    assert all(PINNED.fullmatch(line) for line in used), used
    head = text.split("\njobs:")[0]
    assert "permissions: {}" in head or "permissions:\n  contents: read\n" in head
    assert "write-all" not in text
    assert "secrets." not in text


def test_lock_has_every_dependency_within_its_bounds() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]
    locked = {}
    for line in (ROOT / "results" / "requirements.lock").read_text("utf-8").splitlines():
        if not line.startswith("#"):
            name, version = line.split("==")
            locked[canonicalize_name(name)] = version
    for dependency in map(Requirement, project["dependencies"]):
        version = locked[canonicalize_name(dependency.name)]
        assert dependency.specifier.contains(version), dependency


def test_container_copies_what_exists_and_runs_a_command() -> None:
    lines = (ROOT / "docs" / "Containerfile").read_text("utf-8").splitlines()
    copied = [name for line in lines if line.startswith("COPY ") for name in line.split()[1:-1]]
    assert all((ROOT / name).exists() for name in copied)
    project = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))
    parts = project["tool"]["setuptools"]["package-dir"].values()
    assert {"casswarm", *parts} <= set(copied)
    command = json.loads(next(line for line in lines if line.startswith("CMD "))[4:])
    assert command[:3] == ["reproduce", "--only", "table-2"]


def test_conda_recipe_has_version_and_dependencies_of_project() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]
    recipe = yaml.safe_load((ROOT / "docs" / "conda-recipe.yaml").read_text("utf-8"))
    assert recipe["context"]["version"] == project["version"]
    assert f">={recipe['context']['python_min']}" == project["requires-python"]
    of_conda = {"matplotlib": "matplotlib-base"}  # without the bindings of a window system
    expected = {
        f"{of_conda.get(each.name, each.name)} {each.specifier}"
        for each in map(Requirement, project["dependencies"])
    }
    run = set(recipe["requirements"]["run"])
    assert run == expected | {"python >=${{ python_min }}"}
    assert recipe["about"]["summary"] == project["description"]
