"""Sets of priors: closed forms against linear programs, games of known value, wrong values."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.optimize import linprog

from casswarm.errors import PlanningError
from casswarm.guide import Ambiguity

SETS = ["mean", "worst", ("cvar", 0.3), ("cvar", 1.0), ("tv", 0.5), ("tv", 2.0), ("tv", 0.0)]


def random_game(seed: int, cases: int) -> tuple[Any, Any]:
    rng = np.random.default_rng(seed)
    return rng.uniform(0, 1, (6, cases)), rng.dirichlet(np.ones(cases))


def least_by_program(chosen: Ambiguity, values: Any, prior: Any) -> float:
    """The least mean over Q by a linear program in (q, u), stated for every set by itself."""
    k = len(values)
    cost = np.append(values, np.zeros(k))
    upper = np.full(2 * k, np.inf)
    rows, limits = np.zeros((0, 2 * k)), np.zeros(0)
    if chosen.name == "cvar":
        upper[:k] = prior / chosen.parameter
    if chosen.name == "mean":
        upper[:k] = prior
    if chosen.name == "tv":
        unit = np.eye(k)
        rows = np.vstack([np.hstack([unit, -unit]), np.hstack([-unit, -unit])])
        rows = np.vstack([rows, np.append(np.zeros(k), np.ones(k))])
        limits = np.concatenate([prior, -prior, [chosen.parameter]])
    answer = linprog(
        cost,
        A_ub=rows,
        b_ub=limits,
        A_eq=np.append(np.ones(k), np.zeros(k))[None],
        b_eq=[1.0],
        bounds=list(zip(np.zeros(2 * k), upper, strict=True)),
    )
    return float(answer.fun)


@given(st.integers(0, 10**6), st.integers(1, 5), st.sampled_from(SETS))
def test_least_mean_is_that_of_the_program(seed: int, cases: int, name: Any) -> None:
    values, prior = random_game(seed, cases)
    chosen = Ambiguity.of(name)
    worst = chosen.worst_prior(values[0], prior)
    assert chosen.least(values[0], prior) == pytest.approx(
        least_by_program(chosen, values[0], prior), abs=1e-9
    )
    assert worst.min() >= 0
    assert worst.sum() == pytest.approx(1.0, abs=1e-12)


@given(st.integers(0, 10**6), st.integers(2, 5), st.sampled_from(SETS))
def test_mixture_and_prior_are_a_saddle_point(seed: int, cases: int, name: Any) -> None:
    survivals, prior = random_game(seed, cases)
    chosen = Ambiguity.of(name)
    weights, worst = chosen.game(survivals, prior)
    assert chosen.contains(worst, prior)
    low = chosen.least(weights @ survivals, prior)
    high = float((survivals @ worst).max())  # what the best path has against this prior
    assert low <= high + 1e-12
    assert low == pytest.approx(high, abs=1e-7)


def test_sets_grow_from_the_mean_to_the_worst_case() -> None:
    survivals, prior = random_game(5, 4)
    for nested in (
        ["mean", ("cvar", 0.8), ("cvar", 0.4), "worst"],
        ["mean", ("tv", 0.2), ("tv", 0.9), "worst"],
    ):
        values = []
        for name in nested:
            chosen = Ambiguity.of(name)  # type: ignore[arg-type]
            weights, _ = chosen.game(survivals, prior)
            values.append(chosen.least(weights @ survivals, prior))
        assert values == sorted(values, reverse=True)
        assert values[0] > values[-1] + 0.01


def test_matching_pennies() -> None:
    """Survival 0.8 if the guess is right, else 0.2."""
    weights, worst = Ambiguity.of("worst").game(
        np.array([[0.8, 0.2], [0.2, 0.8]]), np.array([0.9, 0.1])
    )
    np.testing.assert_allclose(weights, [0.5, 0.5], atol=1e-9)
    np.testing.assert_allclose(worst, [0.5, 0.5], atol=1e-9)


@pytest.mark.parametrize(
    "value",
    [
        *("best", ("cvar", 0.0), ("cvar", 1.5), ("tv", -0.1), ("tv", 3.0), ("mean", 1.0), None, 3),
        *(("cvar", float("nan")), ("cvar", True), ("cvar",)),
    ],
)
def test_wrong_sets_are_refused(value: Any) -> None:
    with pytest.raises(PlanningError, match=r"ambiguity = .*allowed: 'mean', 'worst'"):
        Ambiguity.of(value)
