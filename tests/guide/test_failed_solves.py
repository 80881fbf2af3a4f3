"""A plan of which every solve failed says so."""

from __future__ import annotations

import casadi as ca
import pytest
from small_scenarios import small

import casswarm as csw

REASON = "the derivative of the objective with respect to positions[0] is nan"


def rooted(positions, _alive):
    """The rate 1, with derivatives that are not a number."""
    return 1.0 + ca.sqrt(ca.fmax(-1.0 - positions[:, 0] ** 2, 0.0))


def test_plan_of_which_every_solve_failed_warns_with_the_reason():
    scenario = small([(0.0, 0.0)], (2.0, 0.0), [(1.0, 0.8)], 6).with_hazard(rooted)
    with pytest.warns(csw.CasswarmWarning, match="not a minimum: no solve succeeded") as warned:
        guide = csw.plan(scenario)
    assert guide.failed
    assert guide.arrives
    assert guide.certificate is None
    assert str(warned[0].message) == guide.note
    assert REASON in guide.note
    assert guide.note in str(guide)
    assert guide.as_dict()["note"] == guide.note
