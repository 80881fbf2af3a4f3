"""Derivatives of solutions by parameters: known answers, differences, what is flagged."""

from __future__ import annotations

import runpy
from dataclasses import replace
from pathlib import Path

import casadi as ca
import numpy as np
import pytest
from hock_schittkowski import published
from known_problems import INF

from casswarm.errors import SolverError
from casswarm.nlp import Instances, Nlp
from casswarm.solvers import FilterInteriorPoint, Slsqp, layer, sensitivities

EXAMPLE = Path(__file__).parents[2] / "docs/examples/learned_weights.py"
TIGHT = FilterInteriorPoint(tolerance=1e-12, constraint_tolerance=1e-12)


def shifted(number: int) -> Nlp:
    """A published problem with the linear term of f and shifts of the rows as parameters."""
    nlp = published(number).nlp
    n, _, m = nlp.sizes
    x, p = ca.SX.sym("x", n), ca.SX.sym("p", n + m)
    f, g = nlp.evaluate.expand()(x, ca.SX(0, 1))
    rows = g + p[n:] if m else ca.SX(0, 1)
    return Nlp.from_expressions(nlp.name, x, p, f + ca.dot(p[:n], x), rows)


def batch_of(nlp: Nlp, number: int, batch: int) -> Instances:
    p = 1e-2 * np.random.default_rng(number).normal(size=(batch, nlp.sizes[1]))
    return replace(published(number).instance[np.zeros(batch, int)], p=p)


def projection() -> tuple[Nlp, Instances]:
    """The point nearest to p in a box, whose sum is at most 1."""
    x, p = ca.SX.sym("x", 2), ca.SX.sym("p", 2)
    nlp = Nlp.from_expressions("projection", x, p, ca.sumsqr(x - p) / 2, ca.sum1(x))
    points = np.array([[0.2, 0.3], [2.0, 0.2], [0.7, 0.9], [-1.0, 0.5], [0.5, 0.0]])
    return nlp, Instances(np.full((5, 2), 0.3), points, [0.0, 0.0], [2.0, 2.0], [-INF], [1.0])


DX = [
    [[1, 0], [0, 1]],  # inside
    [[0, 0], [0, 0]],  # at the corner (1, 0)
    [[0.5, -0.5], [-0.5, 0.5]],  # on the edge x + y = 1
    [[0, 0], [0, 1]],  # at the bound x = 0
]


@pytest.mark.parametrize("solver", [FilterInteriorPoint(), Slsqp()], ids=lambda s: s.name)
def test_sensitivities_of_projection_are_known(solver) -> None:
    nlp, instances = projection()
    solution = solver.solve_batch(nlp, instances, sensitivities=True)
    found = solution.sensitivities
    assert found.regular.all()
    assert found.weakly_active.any(axis=1).tolist() == [False] * 4 + [True]
    assert found.weakly_active[4].tolist() == [False, True, False]
    np.testing.assert_allclose(found.dx_dp[:4], DX, atol=1e-7)
    np.testing.assert_allclose(found.value_gradient, instances.p - solution.x, atol=1e-7)
    np.testing.assert_allclose(found.dlam_dp[2, 2], [0.5, 0.5], atol=1e-7)
    assert "5 of 5 regular, 1 with weakly active rows" in repr(found)


@pytest.mark.parametrize("number", [6, 10, 43, 71, 76, 100, 113])
def test_sensitivities_equal_central_differences_and_their_adjoint(number: int) -> None:
    nlp = shifted(number)
    instances = batch_of(nlp, number, 4)
    solution = TIGHT.solve_batch(nlp, instances, sensitivities=True)
    found, step = solution.sensitivities, 1e-4
    assert found.regular.all()
    for k in range(nlp.sizes[1]):
        change = step * np.eye(nlp.sizes[1])[k]
        after, before = (
            TIGHT.solve_batch(nlp, replace(instances, p=instances.p + sign * change))
            for sign in (1, -1)
        )
        slopes = (after.x - before.x) / (2 * step)
        np.testing.assert_allclose(found.dx_dp[:, :, k], slopes, rtol=1e-6, atol=1e-6)
        slope = (after.objective - before.objective) / (2 * step)
        np.testing.assert_allclose(found.value_gradient[:, k], slope, rtol=1e-6, atol=1e-6)
    generator = np.random.default_rng(1)
    bar_x, bar_lam = (
        generator.normal(size=part.shape[:2]) for part in (found.dx_dp, found.dlam_dp)
    )
    expected = np.einsum("bi,bik->bk", bar_x, found.dx_dp)
    np.testing.assert_allclose(found.adjoint(bar_x), expected, rtol=1e-8, atol=1e-8)
    expected += np.einsum("bi,bik->bk", bar_lam, found.dlam_dp)
    np.testing.assert_allclose(found.adjoint(bar_x, bar_lam), expected, rtol=1e-8, atol=1e-8)


def flat(x, p):
    """No curvature along x0 - x1."""
    return (x[0] + x[1] - p) ** 2, ca.SX(0, 1)


def repeated(x, p):
    """Two rows with the same gradient."""
    return ca.sumsqr(x), ca.vertcat(x[0] + x[1] - p, 2 * (x[0] + x[1] - p))


@pytest.mark.parametrize("make", [flat, repeated])
def test_singular_systems_are_flagged_and_nan(make) -> None:
    x, p = ca.SX.sym("x", 2), ca.SX.sym("p")
    nlp = Nlp.from_expressions(make.__name__, x, p, *make(x, p))
    zeros = np.zeros(nlp.sizes[2])
    free, p = np.full(2, INF), np.array([[1.0], [2.0]])
    instances = Instances(np.ones((2, 2)), p, -free, free, zeros, zeros)
    solution = FilterInteriorPoint().solve_batch(nlp, instances, sensitivities=True)
    assert solution.success.all()
    found = solution.sensitivities
    assert not found.regular.any()
    assert np.isnan(found.dx_dp).all()
    assert np.isnan(found.adjoint(np.ones((2, 2)))).all()
    assert np.isfinite(found.value_gradient).all()


def test_sensitivities_of_failed_and_none_are_nan_and_empty() -> None:
    nlp, instances = projection()
    instances = replace(instances, lbg=np.full((5, 1), 5.0), ubg=np.full((5, 1), 5.0))
    solution = FilterInteriorPoint().solve_batch(nlp, instances, sensitivities=True)
    assert not solution.success.any()
    assert not solution.sensitivities.regular.any()
    assert np.isnan(solution.sensitivities.value_gradient).all()
    for name in ("dx_dp", "dlam_dp", "value_gradient", "weakly_active"):
        theirs = getattr(solution.sensitivities, name)
        np.testing.assert_array_equal(getattr(solution, name), theirs)
    without = FilterInteriorPoint().solve_batch(nlp, instances)
    assert without.sensitivities is None
    with pytest.raises(SolverError, match="sensitivities=True"):
        _ = without.dx_dp
    with pytest.raises(SolverError, match="multipliers"):
        sensitivities(nlp, instances, solution, (np.zeros((5, 1)), np.zeros((5, 1))))


def test_layer_of_unknown_framework_is_refused() -> None:
    with pytest.raises(SolverError, match=r"framework = 'numpy'; allowed: torch, jax"):
        layer(*projection(), framework="numpy")


@pytest.mark.slow
def test_torch_layer_passes_the_check_of_gradients() -> None:
    torch = pytest.importorskip("torch")
    nlp, instances = projection()
    solve = layer(nlp, instances[:1], framework="torch")
    p = torch.tensor(instances.p[:4], requires_grad=True)
    assert torch.autograd.gradcheck(solve, p, eps=1e-4, atol=1e-6)


@pytest.mark.slow
def test_example_learns_the_weights_of_the_data() -> None:
    pytest.importorskip("torch")
    learned = runpy.run_path(str(EXAMPLE))["learn"]()
    np.testing.assert_allclose(learned, [3.0, 0.2], rtol=1e-2)


@pytest.mark.slow
def test_jax_layer_has_the_known_gradient() -> None:
    jax = pytest.importorskip("jax")
    nlp, instances = projection()
    with jax.enable_x64(True):
        solve = layer(nlp, instances[:1], framework="jax")
        gradient = jax.jit(jax.grad(lambda p: solve(p)[:, 0].sum()))(instances.p[:4])
    np.testing.assert_allclose(gradient, np.array(DX)[:, 0], atol=1e-6)
