"""The batched interior point on more published problems: single ones, and with a fallback."""

from __future__ import annotations

import numpy as np
import pytest
from hock_schittkowski import MORE, published

from casswarm.nlp import Instances
from casswarm.solvers import FilterInteriorPoint, Ipopt

HIGH_ORDER = {46: 1e-5, 49: 1e-5}
"""Distance of objectives where the minimum is flat to the fourth order or more."""


@pytest.mark.parametrize("number", MORE)
def test_published_optimum_is_found(number: int) -> None:
    known = published(number)
    (solution,) = FilterInteriorPoint().solve(known.nlp, known.instance)
    optima = np.array([known.objective, *known.local])
    assert solution.status.success, solution
    digits = HIGH_ORDER.get(number, 1e-6) * np.maximum(1.0, abs(optima))
    assert (abs(solution.objective - optima) <= digits).any(), solution
    assert solution.residuals.violation <= 1e-7


@pytest.mark.parametrize("number", MORE)
def test_batch_from_random_starts_is_solved_with_fallback(number: int) -> None:
    known = published(number)
    one, rng = known.instance, np.random.default_rng(number)
    x0 = one.x0 + 0.02 * rng.normal(size=(8, one.x0.shape[1])) * np.maximum(0.1, abs(one.x0))
    x0 = np.clip(x0, one.lbx, one.ubx)
    batch = Instances(x0, one.p, one.lbx, one.ubx, one.lbg, one.ubg)
    solution = FilterInteriorPoint(fallback=Ipopt()).solve_batch(known.nlp, batch)
    assert solution.success.all(), solution.messages
    assert solution.violation.max() <= 1e-6
    least = min(known.objective, *known.local) if known.local else known.objective
    assert solution.objective.min() >= least - 1e-5 * max(1.0, abs(least))
