"""Programs, instances and solutions in an interactive session: one line each."""

from __future__ import annotations

import casadi as ca
import numpy as np

import casswarm as csw
from casswarm import nlp, solvers


def test_representations_are_a_line_with_sizes_and_residuals():
    x, p = ca.MX.sym("x", 2), ca.MX.sym("p", 1)
    program = nlp.Nlp.from_expressions("sums", x, p, ca.sumsqr(x - p), x[0] + x[1])
    bounds = (
        np.full((1, 2), -9.0),
        np.full((1, 2), 9.0),
        np.full((1, 1), -9.0),
        np.full((1, 1), 9.0),
    )
    instances = nlp.Instances(np.ones((3, 2)), np.zeros((3, 1)), *bounds)
    assert repr(program) == "Nlp('sums', 2 variables, 1 parameter, 1 constraint)"
    assert repr(instances) == "Instances(3 of 2 variables, 1 parameter, 1 constraint)"
    solver = solvers.make_solver("interior-point")
    found = repr(solver.solve(program, instances)[0])
    assert found.startswith("Solution('solved', solver='interior-point', objective=")
    assert found.endswith("x of shape (2,))")
    found = repr(solver.solve_batch(program, instances))
    assert found.startswith("BatchSolution(3 of 3 solved, 0 by the fallback, violation<=0.0e+00, ")
    assert "\n" not in found


def test_dir_of_scenario_has_its_keys_and_no_names_of_pydantic():
    names = dir(csw.load_scenario("paper-1"))
    assert {"hazard", "swarm", "n", "with_values", "to_toml", "plot"} <= set(names)
    assert not {"copy", "json", "schema", "parse_obj", "model_dump", "validate"} & set(names)
