"""Diagonal blocks of the formation objective's Hessian, which precondition large swarms."""

import casadi as ca
import numba
import numpy as np
import pytest

import casswarm as csw
from casswarm.formation import CompiledObjective, formation_program
from casswarm.formation.spectral_kernels import LARGE_SWARM

RADARS = ((4.4, 4.6), (4.5, 3.0))
HAZARDS = [csw.Saturation(RADARS, (0.5, 2.0)), csw.SaturationCollision(RADARS)]


@pytest.mark.parametrize("hazard", HAZARDS, ids=["plain", "collision"])
def test_blocks_equal_those_of_casadis_hessian(hazard):
    n, rng = LARGE_SWARM + 1, np.random.default_rng(0)
    nlp = formation_program(hazard, n, False)
    compiled = nlp.attached(CompiledObjective)
    alive = rng.random(n) < 0.8
    weights = alive * rng.uniform(0.5, 2.0, n) * (rng.random(n) < 0.8)
    p = nlp.pack_parameters(
        positions=rng.normal(0.0, 1.0, (n, 2)),
        previous_velocities=np.zeros((n, 2)),
        alive=alive[:, None],
        weights=weights[:, None],
        goal=np.zeros((1, 2)),
        dt=0.33,
        v_max=2.0,
    )
    p = np.asarray(p, float).ravel()
    x, found, evaluate = rng.normal(0.0, 0.5, 2 * n), np.empty(5 * n), compiled.evaluate
    called = numba.njit(lambda *arguments: evaluate(*arguments))  # noqa: PLW0108  (a CFunc)
    value = called(x, p, compiled.constants, found, np.empty(n * (n + 8)))
    symbols = ca.MX.sym("x", 2 * n)
    hessian, _ = ca.hessian(nlp.evaluate(symbols, p)[0], symbols)
    hessian = np.asarray(ca.Function("hessian", [symbols], [hessian])(x))
    blocks = hessian.reshape(n, 2, n, 2)[np.arange(n), :, np.arange(n)]
    expected = np.where(alive[:, None], blocks[:, [0, 0, 1], [0, 1, 1]], 0.0)
    np.testing.assert_allclose(
        found[2 * n :].reshape(n, 3), expected, rtol=1e-9, atol=1e-12 * np.abs(expected).max()
    )
    objective, gradient = nlp.gradient(x, p)
    assert value == pytest.approx(float(objective), rel=1e-12)
    np.testing.assert_allclose(found[: 2 * n], np.asarray(gradient).ravel(), rtol=1e-9, atol=1e-12)
