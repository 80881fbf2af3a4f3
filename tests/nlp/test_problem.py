"""The problem's layout: blocks in and out, names of rows, instances; and that it scales."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import casadi as ca
import numpy as np
import pytest

from casswarm import solvers
from casswarm.errors import SolverError
from casswarm.hazard import Saturation, SaturationCollision
from casswarm.motion import PlanarSets
from casswarm.nlp import Instances, Nlp
from casswarm.problems import formation_nlp

RADARS = ((4.4, 4.6), (4.5, 3.0))


def sample(unroll: bool = False) -> Nlp:
    """Three points, two angles; a center and a weight; two constraints."""
    points, angles = ca.MX.sym("points", 2, 3), ca.MX.sym("angles", 1, 2)
    center, weight = ca.MX.sym("center", 2), ca.MX.sym("weight")
    offsets = points - ca.repmat(center, 1, 3)
    return Nlp(
        name="sample",
        variables={"points": points, "angles": angles},
        parameters={"center": center, "weight": weight},
        objective=ca.sumsqr(offsets) + weight * ca.sum2(ca.sin(angles)),
        constraints={"radius": ca.sum1(offsets**2), "sum": points[:, 0] + angles.T},
        unroll=unroll,
    )


@pytest.fixture(params=[False, True], ids=["matrices", "unrolled"])
def nlp(request: pytest.FixtureRequest) -> Nlp:
    return sample(request.param)


def blocks(batch: int) -> dict[str, Any]:
    numbers = np.arange(8.0 * batch)
    return {
        "points": numbers[: 6 * batch].reshape(batch, 3, 2),
        "angles": numbers[6 * batch :].reshape(batch, 2, 1),
    }


# --- layout


def test_sizes_count_scalars_and_row_names_cover_all_constraints(nlp: Nlp) -> None:
    assert nlp.sizes == (8, 3, 5)
    assert nlp.row_names == ("radius[0]", "radius[1]", "radius[2]", "sum[0]", "sum[1]")


def test_pack_variables_inverts_variable(nlp: Nlp) -> None:
    given = blocks(4)
    x = nlp.pack_variables(**given)
    assert x.shape == (4, 8)
    for name, block in given.items():
        np.testing.assert_array_equal(nlp.variable(name, x), block)
        np.testing.assert_array_equal(nlp.variable(name, x[2]), block[2])
        np.testing.assert_array_equal(nlp.variable(name, x.reshape(2, 2, 8))[1, 0], block[2])


def test_pack_follows_layout_of_symbols(nlp: Nlp) -> None:
    given = blocks(1)
    x = nlp.pack_variables(**given)[0]
    split = ca.Function("split", [nlp.x], list(nlp.variables.values()))(x)
    for block, column in zip(given.values(), split, strict=True):
        np.testing.assert_array_equal(np.asarray(column), block[0].T)
    p = nlp.pack_parameters(center=[[7, 8]], weight=[[9]])
    assert p.tolist() == [[7, 8, 9]]
    bounds = nlp.pack_constraints(radius=[[1], [2], [3]], sum=[[4, 5]])
    assert bounds.tolist() == [[1, 2, 3, 4, 5]]


def test_nlp_derivatives_equal_formulas(nlp: Nlp) -> None:
    points, angles = np.array([[1.0, 2.0], [3.0, 5.0], [0.0, -1.0]]), np.array([0.5, 2.0])
    center, weight = np.array([1.0, 1.0]), 3.0
    x = nlp.pack_variables(points=points, angles=angles[:, None])[0]
    p = nlp.pack_parameters(center=center[None], weight=[[weight]])[0]
    f, g = (np.asarray(part).ravel() for part in nlp.evaluate(x, p))
    assert f == pytest.approx([((points - center) ** 2).sum() + weight * np.sin(angles).sum()])
    np.testing.assert_allclose(g, [1, 20, 5, 1.5, 4.0])
    value, gradient = nlp.gradient(x, p)
    assert float(value) == f[0]
    slope = [*(2 * (points - center)).ravel(), *(weight * np.cos(angles))]
    np.testing.assert_allclose(np.asarray(gradient).ravel(), slope)
    jacobian = np.asarray(nlp.jacobian(x, p))
    expected = np.zeros((5, 8))
    for i in range(3):
        expected[i, 2 * i : 2 * i + 2] = 2 * (points[i] - center)
    expected[3, [0, 6]] = expected[4, [1, 7]] = 1
    np.testing.assert_allclose(jacobian, expected)


def test_pack_broadcasts_block_over_batch(nlp: Nlp) -> None:
    given = blocks(3)
    x = nlp.pack_variables(points=given["points"], angles=given["angles"][0])
    assert x.shape == (3, 8)
    assert (nlp.variable("angles", x) == given["angles"][0]).all()
    assert nlp.pack_variables(points=0.0, angles=1.0).tolist() == [[0] * 6 + [1] * 2]
    assert nlp.pack_variables(**blocks(0)).shape == (0, 8)  # an empty batch


def test_pack_without_constraints_has_zero_width() -> None:
    nlp = replace(sample(), constraints={})
    assert nlp.sizes == (8, 3, 0)
    assert nlp.pack_constraints().shape == (1, 0)
    assert nlp.row_names == ()
    assert np.asarray(nlp.evaluate(np.ones(8), np.ones(3))[1]).size == 0


# --- wrong blocks


@pytest.mark.parametrize(
    ("names", "passed"),
    [(("points",), "['points']"), (("points", "angle"), "['angle', 'points']"), ((), "[]")],
)
def test_pack_wrong_block_names_are_listed(nlp: Nlp, names: tuple[str, ...], passed: str) -> None:
    with pytest.raises(SolverError) as caught:
        nlp.pack_variables(**dict.fromkeys(names, 0.0))
    assert str(caught.value) == f"blocks = {passed}; expected: ['angles', 'points']"


def test_pack_wrong_block_shape_raises(nlp: Nlp) -> None:
    with pytest.raises(SolverError) as caught:
        nlp.pack_variables(points=np.zeros((4, 2, 3)), angles=[[0], [0]])
    assert str(caught.value) == "block 'points' has shape (4, 2, 3); expected (4, 3, 2)"
    with pytest.raises(SolverError, match=r"block 'center' has shape \(3,\); expected \(1, 1, 2\)"):
        nlp.pack_parameters(center=[0, 0, 0], weight=0)


def test_nlp_unknown_variable_raises_key_error(nlp: Nlp) -> None:
    with pytest.raises(KeyError, match="weight"):
        nlp.variable("weight", np.zeros(8))


# --- instances


def batch(sets: PlanarSets | None = None) -> Instances:
    rows = np.arange(5.0)[:, None]
    return Instances(
        x0=np.hstack([rows, rows + 0.5]),
        p=rows * 10,
        lbx=np.array([-1.0, -2.0]),
        ubx=np.hstack([rows + 1, rows + 2]),
        lbg=np.full(3, -np.inf),
        ubg=np.hstack([rows + 3, rows + 4, rows + 5]),
        feasible_set=sets,
    )


@pytest.mark.parametrize(
    ("rows", "kept"),
    [
        (slice(1, 3), [1, 2]),
        (slice(None, None, 2), [0, 2, 4]),
        (np.array([True, False, False, False, True]), [0, 4]),
        (np.array([3, 3, 0]), [3, 3, 0]),
        (slice(5, None), []),
    ],
)
def test_instances_select_by_slice_mask_or_indices(rows: Any, kept: list[int]) -> None:
    sets = PlanarSets(
        np.full(2, -9), np.full(2, 9), np.zeros((5, 1, 1, 2)), np.arange(5.0).reshape(5, 1, 1)
    )
    some = batch(sets)[rows]
    assert len(some) == len(kept)
    assert some.x0[:, 0].tolist() == kept
    assert some.p[:, 0].tolist() == [10 * i for i in kept]
    assert some.ubx.tolist() == [[i + 1, i + 2] for i in kept]
    assert some.ubg.tolist() == [[i + 3, i + 4, i + 5] for i in kept]
    assert (some.lbx.shape, some.lbg.shape) == ((len(kept), 2), (len(kept), 3))
    assert isinstance(some.feasible_set, PlanarSets)
    assert some.feasible_set.radii[:, 0, 0].tolist() == kept
    assert batch()[rows].feasible_set is None


def test_instances_broadcast_common_bounds_and_keep_arrays_with_other_x0() -> None:
    some, start = batch(), np.zeros((5, 2))
    assert len(some) == 5
    assert some.lbx.tolist() == [[-1, -2]] * 5
    assert some.lbg.tolist() == [[-np.inf] * 3] * 5
    other = some.with_x0(start)
    assert other.x0 is start
    for name in ("p", "lbx", "ubx", "lbg", "ubg"):
        np.testing.assert_array_equal(getattr(other, name), getattr(some, name))
    assert some.x0[1, 1] == 1.5


# --- a thousand members


def test_matrix_form_size_is_independent_of_members() -> None:
    counts = []
    for n in (3, 1000):
        nlp = formation_nlp(SaturationCollision(RADARS), n, corridor=True)
        parts = [nlp.objective, ca.gradient(nlp.objective, nlp.x)]
        counts.append(ca.Function("f", [nlp.x, nlp.p], parts).n_nodes())
    assert counts[0] == counts[1] < 500


def test_formation_of_thousand_members_has_gradient() -> None:
    n, hazard = 1000, Saturation(RADARS)
    rng = np.random.default_rng(0)
    positions, alive = rng.uniform(-3, 3, (n, 2)), rng.random(n) < 0.9
    x = ca.MX.sym("x", 2, n)
    rates = hazard.expression(x, ca.DM(alive.astype(float)).T)
    total = ca.dot(rates, ca.DM(alive.astype(float)).T)
    gradient = ca.Function("gradient", [x], [rates, ca.gradient(total, x)])
    symbolic, slope = (np.asarray(part) for part in gradient(positions.T))
    numeric = hazard.rates(positions, alive)
    np.testing.assert_allclose(numeric, np.where(alive, symbolic[0], 0), rtol=1e-12)
    direction = rng.normal(size=(n, 2))
    ahead, behind = (hazard.rates(positions + d * direction, alive) for d in (1e-6, -1e-6))
    assert (ahead - behind).sum() / 2e-6 == pytest.approx((slope.T * direction).sum(), rel=1e-6)


# --- arrays that do not fit

X, P = ca.MX.sym("x", 2), ca.MX.sym("p", 3)
PROGRAM = Nlp.from_expressions("sums", X, P, ca.sumsqr(X - P[:2]), X[0] + X[1] - P[2])
ARRAYS = {
    "x0": np.ones((4, 2)),
    "p": np.ones((4, 3)),
    "lbx": np.full((4, 2), -9.0),
    "ubx": np.full((4, 2), 9.0),
    "lbg": np.full((4, 1), -9.0),
    "ubg": np.full((4, 1), 9.0),
    "scale": np.ones((4, 2)),
}


def with_shape(name: str, shape: tuple[int, ...]) -> dict[str, Any]:
    return ARRAYS | {name: np.ones(shape)}


@pytest.mark.parametrize("solver", ["interior-point", "ipopt", "sqp", "auto", "slsqp", "sleqp"])
@pytest.mark.parametrize("name", list(ARRAYS))
@pytest.mark.parametrize("surplus", [-1, 1])
def test_array_of_wrong_width_is_refused(solver: str, name: str, surplus: int) -> None:
    width = ARRAYS[name].shape[1] + surplus
    instances = Instances(**with_shape(name, (4, width)))
    chosen = solvers.make_solver(solver)
    for solve in (chosen.solve, chosen.solve_batch):
        with pytest.raises(SolverError) as caught:
            solve(PROGRAM, instances)
        expected = f"expected: (4, {ARRAYS[name].shape[1]}) for the program 'sums'"
        assert str(caught.value) == f"{name} of the instances has shape (4, {width}); {expected}"
        assert (caught.value.key, caught.value.shape) == (name, (4, width))


@pytest.mark.parametrize(
    ("name", "shape"),
    [
        *(("p", (3, 3)), ("lbx", (4, 1, 2)), ("ubg", ()), ("p", (5, 3)), ("scale", (3, 2))),
        *(("x0", ()), ("x0", (2,))),
    ],
)
def test_array_without_a_row_for_each_instance_is_refused(name: str, shape: Any) -> None:
    with pytest.raises(SolverError, match=rf"{name} of the instances has shape .*; expected: "):
        Instances(**with_shape(name, shape))


# --- in an interactive session


def test_representations_are_a_line_with_sizes_and_residuals():
    x, p = ca.MX.sym("x", 2), ca.MX.sym("p", 1)
    program = Nlp.from_expressions("sums", x, p, ca.sumsqr(x - p), x[0] + x[1])
    bounds = (
        np.full((1, 2), -9.0),
        np.full((1, 2), 9.0),
        np.full((1, 1), -9.0),
        np.full((1, 1), 9.0),
    )
    instances = Instances(np.ones((3, 2)), np.zeros((3, 1)), *bounds)
    assert repr(program) == "Nlp('sums', 2 variables, 1 parameter, 1 constraint)"
    assert repr(instances) == "Instances(3 of 2 variables, 1 parameter, 1 constraint)"
    solver = solvers.make_solver("interior-point")
    found = repr(solver.solve(program, instances)[0])
    assert found.startswith("Solution('solved', solver='interior-point', objective=")
    assert found.endswith("x of shape (2,))")
    found = repr(solver.solve_batch(program, instances))
    assert found.startswith("BatchSolution(3 of 3 solved, 0 by the fallback, violation<=0.0e+00, ")
    assert "\n" not in found
