"""Second derivatives of the joint plan, against automatic differentiation and by pickling."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest

import casswarm as csw
from casswarm.motion import Motion
from casswarm.nlp import LagrangianHessian
from casswarm.problems import JointForm, JointTask, joint_instances, joint_nlp

SETTINGS = {
    "swarm.positions": [[0.0, 0.0], [0.5, 0.0], [0.0, 0.4]],
    "time.t_f": 1.4,
    "target.center": [2.0, 1.5],
}


@pytest.mark.parametrize("name", ["paper-1", "paper-2"])
@pytest.mark.parametrize("objective", ["success", "arrivals", "survivors"])
@pytest.mark.parametrize("separated", [False, True])
def test_hessian_matches_automatic_differentiation(
    name: str, objective: str, separated: bool
) -> None:
    scenario = csw.load_scenario(name).with_values(SETTINGS)
    form = JointForm(3, scenario.n_steps, True, objective, separated)
    nlp = joint_nlp(scenario.hazard, form)
    x, p = point(scenario, form)
    weight, multipliers = ca.MX.sym("f"), ca.MX.sym("g", nlp.g.shape[0])
    lagrangian = weight * nlp.objective + ca.dot(multipliers, nlp.g)
    second = ca.Function(
        "second", [nlp.x, nlp.p, weight, multipliers], [ca.hessian(lagrangian, nlp.x)[0]]
    )
    arguments = (x, p, 0.7, np.linspace(-1.0, 2.0, nlp.g.shape[0]))
    expected = np.triu(np.array(second(*arguments)))
    assert np.abs(expected).max() > 1e-3
    found = np.array(nlp.attached(LagrangianHessian)(*arguments))
    np.testing.assert_allclose(found, expected, rtol=1e-9, atol=1e-11)


def test_hessian_of_large_swarm_or_mean_field_is_none() -> None:
    hazard = csw.load_scenario("paper-1").hazard
    assert joint_nlp(hazard, JointForm(7, 2)).attached(LagrangianHessian) is None
    mean_field = joint_nlp(hazard, JointForm(3, 2, exact=False))
    assert mean_field.attached(LagrangianHessian) is None


def point(scenario: csw.Scenario, form: JointForm) -> tuple[np.ndarray, np.ndarray]:
    """Variables and parameters of a random instance."""
    draws = np.random.default_rng(2)
    task = JointTask(
        start=scenario.positions,
        initial_velocities=np.ones((3, 2)),
        center=np.array([2.0, 1.5]),
        radius=0.5,
        margin=1e-3,
        motion=Motion(v_max=2.0, a_max=0.5, dt=scenario.time.dt),
        steps=form.horizon,
        min_distance=0.01 if form.separated else 0.0,
    )
    velocities = draws.uniform(0.2, 1.6, (form.horizon, 3, 2))
    nlp = joint_nlp(scenario.hazard, form)
    instance = joint_instances(nlp, form, task, [np.array([3, 4, 4])], [velocities])
    return instance.x0[0], instance.p[0]
