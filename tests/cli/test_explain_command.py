"""casswarm explain: names of a file's rows, a feasible point, and exit codes."""

import casadi as ca
from commands import casswarm

import casswarm as csw


def write(path, limit):
    """Write x + y >= 2, x - y = 0 and x <= limit, for 0 <= x, y."""
    x = ca.SX.sym("x", 2)
    rows = ca.vertcat(x[0] + x[1], x[0] - x[1], x[0])
    problem = csw.Problem.from_casadi(
        {"x": x, "f": x[0], "g": rows}, lbx=0, lbg=[2, 0, -9], ubg=[9, 0, limit]
    )
    problem.to_nl(path)


def test_explain_names_rows_of_an_infeasible_file_and_finds_points_of_feasible_ones(tmp_path):
    write(tmp_path / "model.nl", 0.5)
    (tmp_path / "model.row").write_text("demand\nbalance\ncapacity\n")
    error = casswarm(tmp_path, "explain", "model.nl", code=1).stderr
    assert "2 <= demand <= 9, balance = 0, -9 <= capacity <= 0.5 contradict each other" in error
    assert "Traceback" not in error
    write(tmp_path / "model.nl", 1.5)
    assert "is feasible" in casswarm(tmp_path, "explain", "model.nl").stdout
