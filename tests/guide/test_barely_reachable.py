"""A target that can only just be reached leaves a thin feasible set."""

from __future__ import annotations

import tomllib

import numpy as np
import pytest
from small_scenarios import image

from casswarm import Scenario, plan
from casswarm.guide.multistart import solve_by

# the straight line reaches this target with a millionth of its length to spare
SCENARIO = """
name = "barely"
[swarm]
positions = [[0.03903560220905538, -0.6126665726024624]]
velocity = [-3.4372342054833513, 0.24367052758716778]
v_max = 3.82873384437479
a_max = 141.23266869742716
[target]
center = [-40.06913673215996, 3.7728671200867163]
radius = 0.0032493753424275846
[time]
dt = 1.4963909924186694
t_f = 10.474736946930685
[hazard]
kind = "saturation+collision"
radars = [
  [-6.398061721000219, 0.6341671629169763], [-10.543683035764962, 0.7474570117852748],
  [-5.072444087748411, -3.871620034093187], [-15.160992462808895, 9.004821466222142],
]
alpha_1 = 0.627693051944591
alpha_2 = 4.955424997610369
alpha_3 = 0.2339301586854201
beta_1 = 1.009384842793144
beta_2 = 1.5310368364088704
[guide]
search = "local"
arrival = "horizon"
acceleration_limited = false
[formation]
rho = 0.4104000962485832
"""
TURNS = np.eye(2), np.array([[0.0, -1.0], [1.0, 0.0]])


def test_ipopt_is_not_believed_in_any_axes_that_feasible_guess_is_infeasible(monkeypatch):
    statuses = []

    def recorded(deadline, solver, nlp, instance):
        statuses.append(str(solver.solve(nlp, instance)[0].status))
        return solve_by(deadline, solver, nlp, instance)

    monkeypatch.setattr("casswarm.guide.multistart.solve_by", recorded)
    scenario = Scenario.from_data(tomllib.loads(SCENARIO))
    guides = [plan(image(scenario, turn), certify=False) for turn in TURNS]
    assert statuses == ["infeasible"] * 2
    assert all(guide.solution.status.success for guide in guides)
    assert guides[0].survival == pytest.approx(guides[1].survival, abs=1e-6)
    assert guides[0].survival > 0.925
