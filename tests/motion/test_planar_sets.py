"""Projection onto box and discs: independent solutions and the laws of projections."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import casadi as ca
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from planar_cases import INF, Array, random_cases, scale

from casswarm.motion import PlanarSets, planar_kernels
from casswarm.motion.planar_kernels import ROUNDING


def nested_search(sets: PlanarSets, points: Array) -> tuple[Array, Array, Array]:
    """Independent solution: min over x of the (closed-form) min over y, by shrinking intervals.

    For fixed x the set is an interval in y. Its gap is convex in x, and so is the distance where
    the gap is <= 0. Returns nearest points, distances and the gap there (> 0: empty set).
    """
    (cx, cy), r = np.moveaxis(sets.centers, -1, 0), sets.radii
    left = np.maximum(sets.lower[:, 0], (cx - r).max(axis=1))
    right = np.minimum(sets.upper[:, 0], (cx + r).min(axis=1))
    apart = np.maximum(left - right, 0)

    def slice_at(x: Array) -> tuple[Array, Array, Array]:
        half = np.sqrt(np.maximum(r**2 - (x[:, None] - cx) ** 2, 0))
        low = np.maximum(sets.lower[:, 1], (cy - half).max(axis=1))
        high = np.minimum(sets.upper[:, 1], (cy + half).min(axis=1))
        y = np.clip(points[:, 1], low, np.maximum(low, high))
        return low - high, np.hypot(x - points[:, 0], y - points[:, 1]), y

    for _ in range(150):
        x1, x2 = left + 0.4 * (right - left), left + 0.6 * (right - left)
        (gap1, far1, _), (gap2, far2, _) = slice_at(x1), slice_at(x2)
        go_left = np.where((gap1 > 0) | (gap2 > 0), gap1 < gap2, far1 < far2)
        left, right = np.where(go_left, left, x1), np.where(go_left, x2, right)
    x = (left + right) / 2
    gap, far, y = slice_at(x)
    return np.stack([x, y], axis=-1), far, np.maximum(gap, apart)


@pytest.fixture(scope="module")
def cases() -> tuple[PlanarSets, Array]:
    """Thousands of non-empty sets and a point for each."""
    sets, points = random_cases(np.random.default_rng(7), 60_000)
    some = ~sets.is_empty
    return sets[some], points[some]


def test_projection_equals_nested_search(cases: tuple[PlanarSets, Array]) -> None:
    sets, points = cases
    nearest, (expected, far, gap) = sets.project(points), nested_search(sets, points)
    thick = gap <= 0  # the search hits a single-point set only up to rounding
    assert np.count_nonzero(thick) > 8_000
    assert np.abs(nearest - expected)[thick].max() < 1e-6  # the search: sqrt(eps)
    assert np.abs(np.hypot(*(nearest - points).T) - far)[thick].max() < 1e-7
    assert np.hypot(*(nearest - points).T)[thick].max() > 3


def test_emptiness_equals_nested_search() -> None:
    sets, points = random_cases(np.random.default_rng(8), 60_000)
    gap = nested_search(sets, points)[2]
    clear = np.abs(gap) > 1e-9
    np.testing.assert_array_equal(sets.is_empty[clear], gap[clear] > 0)
    assert not sets.is_empty[~clear].any()  # touching, on the grid, in exact numbers


def test_projection_equals_ipopt(cases: tuple[PlanarSets, Array]) -> None:
    x, p, discs = ca.MX.sym("x", 2), ca.MX.sym("p", 2), ca.MX.sym("discs", 6)
    inside = [ca.sumsqr(x - discs[3 * k : 3 * k + 2]) - discs[3 * k + 2] ** 2 for k in range(2)]
    problem = {"x": x, "p": ca.vertcat(p, discs), "f": ca.sumsqr(x - p), "g": ca.vertcat(*inside)}
    options = {"print_time": False, "ipopt": {"print_level": 0, "sb": "yes", "tol": 1e-11}}
    options["ipopt"]["bound_relax_factor"] = 0.0
    solver = ca.nlpsol("solver", "ipopt", problem, options)
    sets, points = cases  # the first are in general position
    for i in range(40):
        table = np.column_stack([sets.centers[i], sets.radii[i]]).ravel()
        given = np.concatenate([points[i], table])
        box = {"lbx": sets.lower[i], "ubx": sets.upper[i]}
        answer = solver(x0=sets.centers[i].mean(axis=0), p=given, ubg=0.0, lbg=-INF, **box)
        assert solver.stats()["success"]
        np.testing.assert_allclose(
            np.asarray(answer["x"]).ravel(), sets[i].project(points[i]), atol=2e-5
        )


def with_interior(sets: PlanarSets, margin: float) -> NDArray[np.bool_]:
    """Which sets stay non-empty when all their constraints are tightened by a margin."""
    thick = (sets.upper - sets.lower > 2 * margin).all(axis=-1) & (sets.radii > margin).all(axis=-1)
    some = sets[thick]
    tight = (some.lower + margin, some.upper - margin, some.centers, some.radii - margin)
    thick[thick] = ~PlanarSets(*tight).is_empty
    return thick


@pytest.mark.parametrize("distance", [1.0, 1e3, 1e6, 1e9])
def test_projection_satisfies_variational_inequality(
    cases: tuple[PlanarSets, Array], distance: float
) -> None:
    sets, points = cases
    away, thick, rng = points * distance, with_interior(sets, 1e-6), np.random.default_rng(9)
    nearest = sets.project(away)
    normal = (away - nearest) / np.maximum(np.hypot(*(away - nearest).T), 1e-300)[:, None]
    for spread in (1e-6, 1e-2, 1.0, 100.0):
        other = sets.project(nearest + spread * rng.normal(size=points.shape))
        ahead = (normal * (other - nearest)).sum(axis=-1)
        assert ahead[thick].max() < 1e-13 + 1e-19 * distance
        assert ahead[~thick].max() < 1e-6  # touching boundaries: sqrt(rounding) wide


def test_no_feasible_sample_is_nearer(cases: tuple[PlanarSets, Array]) -> None:
    sets, points = cases
    far, rng = np.hypot(*(sets.project(points) - points).T), np.random.default_rng(10)
    seen = 0
    for _ in range(30):
        sample = sets.lower + rng.random(points.shape) * (sets.upper - sets.lower)
        feasible = sets.violation(sample) <= 0.0
        seen += np.count_nonzero(feasible)
        assert (np.hypot(*(sample - points).T) >= far - 1e-13)[feasible].all()
    assert seen > 50_000


def test_projection_holds_box_exactly_and_discs_up_to_rounding(
    cases: tuple[PlanarSets, Array],
) -> None:
    sets, points = cases
    for factor in (1e-9, 1e-3, 1.0, 1e5, 1e12):
        scaled = PlanarSets(
            *(factor * a for a in (sets.lower, sets.upper, sets.centers)), factor * sets.radii
        )
        nearest = scaled.project(factor * points)
        assert ((nearest >= scaled.lower) & (nearest <= scaled.upper)).all()
        assert (scaled.violation(nearest) <= ROUNDING * scale(scaled, nearest)).all()


def test_projection_is_idempotent(cases: tuple[PlanarSets, Array]) -> None:
    sets, points = cases
    nearest = sets.project(points)
    np.testing.assert_array_equal(sets.project(nearest), nearest)


def test_projection_is_nonexpansive(cases: tuple[PlanarSets, Array]) -> None:
    sets, points = cases
    rng = np.random.default_rng(11)
    for spread in (1e-3, 1.0, 10.0):
        other = points + spread * rng.normal(size=points.shape)
        moved = np.hypot(*(sets.project(points) - sets.project(other)).T)
        assert (moved - np.hypot(*(points - other).T)).max() < 1e-7


def test_points_inside_stay(cases: tuple[PlanarSets, Array]) -> None:
    sets, points = cases
    inside = sets.violation(points) <= 0.0
    assert inside.any()
    np.testing.assert_array_equal(sets.project(points)[inside], points[inside])


# --- Equivariance. Eighths make every shift exact, so tangency survives it. ---

eighths = st.integers(-32, 32).map(lambda i: i / 8)
pairs = st.tuples(eighths, eighths)
lengths = st.integers(0, 32).map(lambda i: i / 8)


@st.composite
def scenes(draw: st.DrawFn) -> tuple[PlanarSets, Array]:
    corner = np.array(draw(pairs))
    width = np.array(draw(st.tuples(lengths, lengths)))
    centers = np.array(draw(st.tuples(pairs, pairs)))
    return (
        PlanarSets(corner, corner + width, centers, np.array(draw(st.tuples(lengths, lengths)))),
        np.array(draw(pairs)),
    )


def assert_moves_along(
    sets: PlanarSets,
    point: Array,
    moved: PlanarSets,
    there: Array,
    back: Callable[[Array], Array] = lambda x: x,
) -> None:
    assert sets.is_empty == moved.is_empty
    if not sets.is_empty:
        np.testing.assert_allclose(back(moved.project(there)), sets.project(point), atol=1e-6)


@settings(max_examples=300, deadline=None, derandomize=True)
@given(scenes(), pairs)
def test_projection_commutes_with_translation(
    scene: tuple[PlanarSets, Array], by: tuple[float, float]
) -> None:
    sets, point = scene
    moved = PlanarSets(sets.lower + by, sets.upper + by, sets.centers + by, sets.radii)
    assert_moves_along(sets, point, moved, point + by, lambda x: x - by)


@settings(max_examples=300, deadline=None, derandomize=True)
@given(scenes())
def test_projection_commutes_with_quarter_turn(scene: tuple[PlanarSets, Array]) -> None:
    def turn(a: Array) -> Array:
        return np.stack([-a[..., 1], a[..., 0]], axis=-1)

    sets, point = scene
    low, high = turn(sets.lower), turn(sets.upper)
    moved = PlanarSets(np.minimum(low, high), np.maximum(low, high), turn(sets.centers), sets.radii)
    assert_moves_along(
        sets,
        point,
        moved,
        turn(point),
        lambda x: -turn(x),
    )


@settings(max_examples=300, deadline=None, derandomize=True)
@given(scenes(), st.integers(-200, 200))
def test_projection_commutes_exactly_with_powers_of_four(
    scene: tuple[PlanarSets, Array], power: int
) -> None:
    sets, point = scene
    f = 4.0**power  # exact even under the square root
    moved = PlanarSets(f * sets.lower, f * sets.upper, f * sets.centers, f * sets.radii)
    assert sets.is_empty == moved.is_empty
    if not sets.is_empty:
        np.testing.assert_array_equal(moved.project(f * point), f * sets.project(point))


@settings(max_examples=300, deadline=None, derandomize=True)
@given(scenes())
def test_order_of_discs_does_not_matter(scene: tuple[PlanarSets, Array]) -> None:
    sets, point = scene
    swapped = replace(sets, centers=sets.centers[::-1], radii=sets.radii[::-1])
    assert_moves_along(sets, point, swapped, point)


@pytest.mark.parametrize("discs", [0, 1, 2])
def test_compiled_projection_equals_python(discs: int) -> None:
    rng = np.random.default_rng(discs)
    half = rng.uniform(0.05, 2, (300, 2))
    radii = rng.uniform(0, 2, (300, discs))
    sets = PlanarSets(-half, half, rng.normal(size=(300, discs, 2)), radii)
    sets = sets[~sets.is_empty]
    points = rng.normal(scale=2, size=(*sets.shape, 2))
    plain = [
        planar_kernels.nearest.py_func(*point, sets.packed, i) for i, point in enumerate(points)
    ]
    np.testing.assert_allclose(sets.project(points), [p[:2] for p in plain], atol=1e-12)
    assert all(found for _, _, found in plain)
