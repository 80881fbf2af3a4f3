"""The joint plan's derivatives, ours and compiled ones, agree with CasADi's in every form."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

import casswarm as csw
from casswarm.compiled import parallel as kernel_threads
from casswarm.joint.numeric import joint_program
from casswarm.nlp import Instances, LagrangianHessian, Nlp
from casswarm.problems import JointForm, JointTask, joint_instances, joint_nlp
from casswarm.solvers.interior_point.derivatives import (
    Condensation,
    FunctionLinearisation,
    Functions,
    NumericDerivatives,
    numeric_problems,
)

STEPS = 5
NEAR_RADARS = np.array([6.0, 2.5])


def posed(
    name: str,
    n: int,
    objective: str,
    separated: bool,
    seed: int,
    differ: bool = False,
    cases: int = 1,
) -> tuple[Nlp, Instances]:
    """Two instances of n members of a scenario, which may differ, at random velocities.

    With several cases, the hazard is not known: their strengths differ, and where radars are at
    rest their positions do.
    """
    rng = np.random.default_rng(seed)
    near = {
        "swarm.positions": (NEAR_RADARS + rng.uniform(-0.6, 0.6, (n, 2))).tolist(),
        "target.center": (NEAR_RADARS + 1.5).tolist(),
        "time.t_f": 0.33 * STEPS + 0.1,
    }
    if differ:
        kinds = rng.uniform([0.3, 0.3, 4.0, 0.3], [3.0, 3.0, 7.0, 3.0], (n, 4))
        names = ("exposure", "density", "v_max", "a_max")
        tables = {str(k): dict(zip(names, kind, strict=True)) for k, kind in enumerate(kinds)}
        near |= {"swarm.kind": list(tables), "swarm.kinds": tables}
    scenario = csw.load_scenario(name).with_values(near)
    if cases > 1:
        table = scenario.hazard_table
        others: list[dict[str, object]] = [
            {"alpha_1": float(rng.uniform(1.0, 6.0)), "weight": float(rng.uniform(0.1, 1.0))}
            for _ in range(cases)
        ]
        for other in others if table.radars else ():
            other["radars"] = (np.array(table.radars) + rng.normal(0, 0.3, 2)).tolist()
        scenario = scenario.with_values({"hazard.case": others})
    hazards = tuple(case.scenario.hazard for case in scenario.cases)
    first = 2 if hazards[0].changes else 0
    form = JointForm(n, STEPS, True, objective, separated, first)
    nlp = joint_program(hazards if cases > 1 else hazards[0], form)
    task = JointTask.from_scenario(scenario, rng.normal(size=(n, 2)), 0.1 * separated)
    arrivals = [rng.integers(3, STEPS + 1, n), np.full(n, STEPS - 1)]
    guesses = [rng.uniform(-0.5, 1.5, (STEPS, n, 2)) for _ in arrivals]
    return nlp, joint_instances(nlp, form, task, arrivals, guesses)


def compiled(nlp: Nlp, batch: Instances):  # type: ignore[no-untyped-def]
    """The compiled derivatives."""
    numeric = nlp.attached(NumericDerivatives)
    assert numeric is not None
    return numeric.problems(batch.p)


def casadis(nlp: Nlp, batch: Instances) -> FunctionLinearisation:
    """Derivatives at the initial guesses, by CasADi."""
    return FunctionLinearisation(Functions.calls(nlp), batch.x0.T.copy(), batch.p.T.copy())


@pytest.mark.slow
@pytest.mark.parametrize(
    "name", ["paper-1", "paper-2", pytest.param("patrol", marks=pytest.mark.slow)]
)
@pytest.mark.parametrize(
    "objective",
    [
        "success",
        *(pytest.param(name, marks=pytest.mark.slow) for name in ("arrivals", "survivors")),
    ],
)
@given(
    n=st.integers(1, 4),
    separated=st.booleans(),
    differ=st.booleans(),
    cases=st.integers(1, 3),
    seed=st.integers(0, 2**32 - 1),
)
def test_values_and_derivatives_equal_casadis(
    name: str, objective: str, n: int, separated: bool, differ: bool, cases: int, seed: int
) -> None:
    nlp, batch = posed(name, n, objective, separated, seed, differ, cases)
    assert nlp.attached(NumericDerivatives) is not None
    compiled = numeric_problems(nlp, batch.p)
    rows, rng = np.arange(len(batch)), np.random.default_rng(seed)
    x, p = batch.x0.T.copy(), batch.p.T.copy()
    ours, theirs = compiled.evaluate(rows, x), Functions.calls(nlp).values(x, p)
    assume(abs(ours[0]).max() < 10)  # else 1 - F is rounding error
    np.testing.assert_allclose(ours[0], theirs[0][0], rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(ours[1], theirs[1], rtol=1e-9, atol=1e-9)
    one, other = compiled.linearise(rows, x), casadis(nlp, batch)
    close(one.gradient, other.gradient)
    variables = rng.normal(size=x.shape)
    multipliers, weights = rng.normal(size=(2, *batch.lbg.T.shape))
    close(one.times(variables), other.times(variables))
    close(one.transposed_times(multipliers), other.transposed_times(multipliers))
    # Newton's equations, made positive definite by weights of the variables
    plain = Condensation(multipliers, np.vstack([np.zeros_like(x), weights]))
    largest = abs(other.condensed(plain)).sum(axis=2).max(axis=1)
    of_all = np.vstack([largest * rng.uniform(0.5, 2.0, variables.shape), weights])
    terms, none = Condensation(multipliers, of_all), np.zeros(len(batch))
    close(*(at.factors(terms, none).solve(variables) for at in (one, other)))


@given(n=st.integers(1, 3), seed=st.integers(0, 2**32 - 1))
@settings(max_examples=10)
def test_factors_need_the_shifts_of_dense_matrices(n: int, seed: int) -> None:
    nlp, batch = posed("paper-2", n, "success", False, seed)
    rows, rng = np.arange(len(batch)), np.random.default_rng(seed)
    multipliers, none = rng.normal(size=batch.lbg.shape), np.zeros_like(batch.lbg)
    weights = np.hstack([np.zeros_like(batch.x0), none])
    terms = Condensation(multipliers.T.copy(), weights.T.copy())
    odds = compiled(nlp, batch).evaluate(rows, batch.x0.T.copy())[0]
    assume(abs(odds).max() < 10)  # else 1 - F is rounding error
    eigenvalues = np.linalg.eigvalsh(casadis(nlp, batch).condensed(terms))
    assume((abs(eigenvalues) > 1e-6).all())
    for margin, positive in ((1e-3, True), (-1e-3, False)):
        of_x = -eigenvalues[:, :1] + margin * abs(eigenvalues).max(axis=1, keepdims=True)
        weights[:, : batch.x0.shape[1]] = of_x
        ours = compiled(nlp, batch).linearise(rows, batch.x0.T.copy())
        terms = Condensation(multipliers.T.copy(), weights.T.copy())
        shifts = ours.factors(terms, np.zeros(len(batch))).shifts  # none is the first that is tried
        assert ((shifts == 0.0) == positive).all()


@pytest.mark.parametrize("name", ["paper-1", "paper-2", "patrol"])
@pytest.mark.parametrize("objective", ["success", "arrivals", "survivors"])
@pytest.mark.parametrize("separated", [False, True])
def test_hessian_matches_automatic_differentiation(
    name: str, objective: str, separated: bool
) -> None:
    nlp, batch = posed(name, 3, objective, separated, 2)
    weight, multipliers = ca.MX.sym("f"), ca.MX.sym("g", nlp.g.shape[0])
    lagrangian = weight * nlp.objective + ca.dot(multipliers, nlp.g)
    symbols = [nlp.x, nlp.p, weight, multipliers]
    second = ca.Function("second", symbols, [ca.hessian(lagrangian, nlp.x)[0]])
    arguments = (batch.x0[0], batch.p[0], 0.7, np.linspace(-1.0, 2.0, nlp.g.shape[0]))
    expected = np.triu(np.array(second(*arguments)))
    assert np.abs(expected).max() > 1e-3
    found = np.array(nlp.attached(LagrangianHessian)(*arguments))
    np.testing.assert_allclose(found, expected, rtol=1e-9, atol=1e-11)


def test_hessian_of_large_swarm_or_mean_field_is_none() -> None:
    hazard = csw.load_scenario("paper-1").hazard
    for form in (JointForm(7, 2), JointForm(3, 2, exact=False)):
        assert joint_nlp(hazard, form).attached(LagrangianHessian) is None


def close(ours: np.ndarray, theirs: np.ndarray) -> None:
    np.testing.assert_allclose(ours, theirs, rtol=1e-7, atol=1e-9 * (1 + abs(theirs).max()))


def test_instances_are_independent() -> None:
    nlp, batch = posed("paper-2", 3, "success", True, 7)
    problems, x = compiled(nlp, batch), batch.x0.T.copy()
    together = problems.linearise(np.arange(2), x)
    for row in range(2):
        alone = problems.linearise(np.array([row]), x[:, row : row + 1])
        assert (alone.gradient == together.gradient[:, row : row + 1]).all()


def test_threads_compute_as_one_does(monkeypatch: pytest.MonkeyPatch) -> None:
    nlp, batch = posed("paper-2", 4, "success", True, 11)
    rows = np.arange(900) % 2
    x, multipliers = batch.x0[rows].T.copy(), np.ones((batch.lbg.shape[1], 900))
    terms = Condensation(multipliers, np.full((len(x) + len(multipliers), 900), 1e3))
    results = []
    for cores in (1, 3):
        monkeypatch.setattr(kernel_threads, "_cores", lambda cores=cores: cores)
        at = compiled(nlp, batch).linearise(rows, x)
        factors = at.factors(terms, np.zeros(900))
        assert (factors.shifts == 0.0).all()
        values = compiled(nlp, batch).evaluate(rows, x)[0]
        results.append((values, at.gradient, factors.solve(x)))
    for one, other in zip(*results, strict=True):
        np.testing.assert_array_equal(one, other)
