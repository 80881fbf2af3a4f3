"""Batches of programs with thousands of variables: Ipopt's solutions, within memory."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from large_programs import elliptic_control, masses

from casswarm.nlp import Instances, Nlp
from casswarm.solvers import FilterInteriorPoint, Ipopt
from casswarm.solvers.interior_point import derivatives

HELPERS = Path(__file__).parents[1] / "helpers"
SOLVER = FilterInteriorPoint()
GIGABYTES = """
import resource
import sys

sys.path.insert(0, sys.argv[1])

import large_programs

from casswarm.solvers import FilterInteriorPoint

nlp, instances = getattr(large_programs, sys.argv[2])(100, int(sys.argv[3]))
assert nlp.sizes[0] >= 5000
solution = FilterInteriorPoint().solve_batch(nlp, instances)
print(int(solution.success.sum()), resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**20)
"""


@pytest.mark.slow
@pytest.mark.parametrize(("program", "size"), [(masses, 60), (elliptic_control, 20)])
def test_solutions_are_those_of_ipopt(
    program: Callable[..., tuple[Nlp, Instances]], size: int
) -> None:
    nlp, instances = program(3, size)
    found, expected = (each.solve_batch(nlp, instances) for each in (SOLVER, Ipopt()))
    assert found.success.all()
    assert expected.success.all()
    np.testing.assert_allclose(found.objective, expected.objective, rtol=1e-6)


def test_functions_that_are_called_have_sparse_factors(monkeypatch: pytest.MonkeyPatch) -> None:
    tapes, calls = masses(2, 30), masses(2, 30)
    expected = SOLVER.solve_batch(*tapes)
    monkeypatch.setattr(derivatives.Functions, "_tapes", derivatives.Functions.calls)
    assert derivatives.program_functions(calls[0]).system is not None
    found = SOLVER.solve_batch(*calls)
    np.testing.assert_allclose(found.x, expected.x, atol=1e-9)


def test_derivatives_of_solutions_are_differences() -> None:
    nlp, instances = masses(4, 40)
    solution = SOLVER.solve_batch(nlp, instances, sensitivities=True)
    exact = solution.sensitivities
    assert exact.regular.all()
    tight = FilterInteriorPoint(tolerance=1e-11, constraint_tolerance=1e-11)
    step = 1e-5 * np.eye(nlp.sizes[1])[3]
    after, before = (
        tight.solve_batch(nlp, replace(instances, x0=solution.x, p=instances.p + sign * step)).x
        for sign in (1, -1)
    )
    np.testing.assert_allclose(exact.dx_dp[..., 3], (after - before) / 2e-5, atol=1e-5)


@pytest.mark.slow
@pytest.mark.parametrize("program", [("masses", "334"), ("elliptic_control", "50")], ids=str)
def test_hundred_instances_of_5000_variables_take_less_than_2_gb(program: tuple[str, str]) -> None:
    command = [sys.executable, "-c", GIGABYTES, str(HELPERS), *program]
    output = subprocess.run(command, capture_output=True, text=True, check=True).stdout
    solved, gigabytes = output.split()
    assert int(solved) == 100
    assert float(gigabytes) < 2.0
