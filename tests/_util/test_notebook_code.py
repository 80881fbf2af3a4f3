"""Policies, rates and solvers of a notebook's cell in other processes."""

import pytest
from commands import python

HEAD = """
import casadi as ca
import numpy as np
import casswarm as csw
from dataclasses import dataclass

scenario = csw.load_scenario("single-agent")
"""
CELLS = {
    "policy": """
def onward(step, positions, previous_velocities, alive):
    return np.broadcast_to(DIRECTION, positions.shape)

DIRECTION = np.array([0.5, 0.2])
tables = [csw.simulate(scenario, [onward], 20, workers=w).runs for w in (1, 2)]
assert tables[0].equals(tables[1])
""",
    "rates": """
def rates(positions, alive):
    return SCALE * alive / (1 + ca.sum2(positions**2))

SCALE = 0.1
changed = scenario.with_hazard(rates)
tables = [csw.simulate(changed, ["naive"], 20, workers=w).runs for w in (1, 2)]
assert tables[0].equals(tables[1])
""",
    "solver": """
@dataclass(frozen=True)
class Renamed(csw.solvers.Ipopt):
    name = "renamed"

table = csw.compare("quick", [Renamed()], count=1).runs
assert set(table["solver"]) == {"renamed"} and table["solved"].all(), table
""",
}


@pytest.mark.slow
@pytest.mark.parametrize("name", CELLS)
def test_code_of_a_cell_runs_in_other_processes(name, tmp_path):
    python("-c", HEAD + CELLS[name], folder=tmp_path)
