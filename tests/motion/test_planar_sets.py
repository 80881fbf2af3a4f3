"""Projection onto box and discs: independent solutions, laws of projections, known answers."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from planar_cases import INF, PLANE, Array, random_cases, scale, single

from casswarm.motion import PlanarSets, planar_kernels
from casswarm.motion.planar_kernels import ROUNDING

Case = tuple[PlanarSets, Array]  # sets, and a point for each


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


@pytest.fixture(scope="module", params=[2, 3])
def cases(request: pytest.FixtureRequest) -> Case:
    """Thousands of non-empty sets with two or three discs, and a point for each."""
    sets, points = random_cases(np.random.default_rng(7), 30_000 * request.param, request.param)
    some = ~sets.is_empty
    return sets[some], points[some]


def test_projection_equals_nested_search(cases: Case) -> None:
    sets, points = cases
    nearest, (expected, far, gap) = sets.project(points), nested_search(sets, points)
    thick = gap <= 0  # the search hits a single-point set only up to rounding
    assert np.count_nonzero(thick) > 8_000
    assert np.abs(nearest - expected)[thick].max() < 1e-6  # the search: sqrt(eps)
    assert np.abs(np.hypot(*(nearest - points).T) - far)[thick].max() < 1e-7
    assert np.hypot(*(nearest - points).T)[thick].max() > 3


@pytest.mark.slow
@pytest.mark.parametrize("discs", [2, 3])
def test_emptiness_equals_nested_search(discs: int) -> None:
    sets, points = random_cases(np.random.default_rng(8), 60_000, discs)
    gap = nested_search(sets, points)[2]
    clear = np.abs(gap) > 1e-9
    np.testing.assert_array_equal(sets.is_empty[clear], gap[clear] > 0)
    assert not sets.is_empty[~clear].any()  # touching, on the grid, in exact numbers


def with_interior(sets: PlanarSets, margin: float) -> NDArray[np.bool_]:
    """Which sets stay non-empty when all their constraints are tightened by a margin."""
    thick = (sets.upper - sets.lower > 2 * margin).all(axis=-1) & (sets.radii > margin).all(axis=-1)
    some = sets[thick]
    tight = (some.lower + margin, some.upper - margin, some.centers, some.radii - margin)
    thick[thick] = ~PlanarSets(*tight).is_empty
    return thick


@pytest.mark.parametrize("distance", [1.0, 1e3, 1e6, 1e9])
def test_projection_satisfies_variational_inequality(cases: Case, distance: float) -> None:
    sets, points = cases
    away, thick, rng = points * distance, with_interior(sets, 1e-6), np.random.default_rng(9)
    nearest = sets.project(away)
    normal = (away - nearest) / np.maximum(np.hypot(*(away - nearest).T), 1e-300)[:, None]
    for spread in (1e-6, 1e-2, 1.0, 100.0):
        other = sets.project(nearest + spread * rng.normal(size=points.shape))
        ahead = (normal * (other - nearest)).sum(axis=-1)
        assert ahead[thick].max() < 1e-13 + 1e-19 * distance
        assert ahead[~thick].max() < 1e-6  # touching boundaries: sqrt(rounding) wide


def test_no_feasible_sample_is_nearer(cases: Case) -> None:
    sets, points = cases
    far, rng = np.hypot(*(sets.project(points) - points).T), np.random.default_rng(10)
    seen = 0
    for _ in range(30):
        sample = sets.lower + rng.random(points.shape) * (sets.upper - sets.lower)
        feasible = sets.violation(sample) <= 0.0
        seen += np.count_nonzero(feasible)
        assert (np.hypot(*(sample - points).T) >= far - 1e-13)[feasible].all()
    assert seen > 50_000


def test_projection_holds_box_exactly_and_discs_up_to_rounding(cases: Case) -> None:
    sets, points = cases
    for factor in (1e-9, 1e-3, 1.0, 1e5, 1e12):
        scaled = PlanarSets(
            *(factor * a for a in (sets.lower, sets.upper, sets.centers)), factor * sets.radii
        )
        nearest = scaled.project(factor * points)
        assert ((nearest >= scaled.lower) & (nearest <= scaled.upper)).all()
        assert (scaled.violation(nearest) <= ROUNDING * scale(scaled, nearest)).all()


def test_projection_is_nonexpansive(cases: Case) -> None:
    sets, points = cases
    rng = np.random.default_rng(11)
    for spread in (1e-3, 1.0, 10.0):
        other = points + spread * rng.normal(size=points.shape)
        moved = np.hypot(*(sets.project(points) - sets.project(other)).T)
        assert (moved - np.hypot(*(points - other).T)).max() < 1e-7


def test_points_inside_and_nearest_points_stay(cases: Case) -> None:
    sets, points = cases
    nearest, inside = sets.project(points), sets.violation(points) <= 0.0
    assert inside.any()
    np.testing.assert_array_equal(nearest[inside], points[inside])
    np.testing.assert_array_equal(sets.project(nearest), nearest)


# --- Equivariance. Eighths make every shift exact, so tangency survives it. ---

eighths = st.integers(-32, 32).map(lambda i: i / 8)
pairs = st.tuples(eighths, eighths)
lengths = st.integers(0, 32).map(lambda i: i / 8)


@st.composite
def scenes(draw: st.DrawFn) -> Case:
    corner = np.array(draw(pairs))
    width = np.array(draw(st.tuples(lengths, lengths)))
    centers = np.array(draw(st.tuples(pairs, pairs)))
    return (
        PlanarSets(corner, corner + width, centers, np.array(draw(st.tuples(lengths, lengths)))),
        np.array(draw(pairs)),
    )


@pytest.mark.slow
@pytest.mark.parametrize("move", ["translation", "quarter turn", "power of four", "order of discs"])
@settings(max_examples=300, deadline=None, derandomize=True)
@given(scene=scenes(), by=pairs, power=st.integers(-200, 200))
def test_projection_commutes_with(
    move: str, scene: Case, by: tuple[float, float], power: int
) -> None:
    (sets, point), shift, order, tolerance = scene, np.zeros(2), 1, 1e-6
    turn, factor = np.eye(2), 1.0
    if move == "translation":
        shift = np.array(by)
    elif move == "quarter turn":
        turn = np.array([[0.0, 1.0], [-1.0, 0.0]])
    elif move == "power of four":
        factor, tolerance = 4.0**power, 0.0  # exact even under the square root
    else:
        order = -1
    edges = factor * sets.lower @ turn + shift, factor * sets.upper @ turn + shift
    centers = (factor * sets.centers @ turn + shift)[::order]
    moved = PlanarSets(
        np.minimum(*edges), np.maximum(*edges), centers, factor * sets.radii[::order]
    )
    assert sets.is_empty == moved.is_empty
    if not sets.is_empty:
        there = moved.project(factor * point @ turn + shift)
        back = (there - shift) @ turn.T / factor
        np.testing.assert_allclose(back, sets.project(point), atol=tolerance, rtol=tolerance / 10)


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


# --- Emptiness by exact reasoning. ---


def two_discs(
    rng: np.random.Generator, radii: Array, gap: Array | float, size: Array | float = 1.0
) -> tuple[PlanarSets, Array]:
    """Pairs of discs at random that are so far apart, and where the first ones are nearest."""
    angle = rng.uniform(0, 2 * np.pi, len(radii))
    towards = np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    first = size * rng.normal(size=(len(radii), 2))
    second = first + (radii.sum(axis=1) + gap)[:, None] * towards
    sets = PlanarSets(*PLANE, np.stack([first, second], axis=1), radii)
    return sets, first + radii[:, :1] * towards


def signed_gaps(rng: np.random.Generator, count: int, low: float, high: float) -> Array:
    """Distances between 10^low and 10^high, and as many overlaps."""
    return np.asarray(rng.choice([-1, 1], count) * 10.0 ** rng.uniform(low, high, count))


def test_emptiness_of_two_discs_follows_their_gap() -> None:
    rng = np.random.default_rng(12)
    radii = rng.exponential(size=(5_000, 2))
    gap = np.maximum(signed_gaps(rng, 5_000, -12, 0), -radii.min(axis=1))
    np.testing.assert_array_equal(two_discs(rng, radii, gap)[0].is_empty, gap > 0)


def test_disc_outside_box_is_empty() -> None:
    rng = np.random.default_rng(13)
    gap = signed_gaps(rng, 5_000, -12, -1)
    angle = rng.uniform(0, np.pi / 2, 5_000)  # off the corner (1, 1)
    center = 1 + (0.5 + gap)[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    sets = PlanarSets(-np.ones(2), np.ones(2), center[:, None], np.full(1, 0.5))
    np.testing.assert_array_equal(sets.is_empty, gap > 0)


def test_sets_that_meet_only_pairwise_are_empty() -> None:
    # The discs meet in the lens around the origin of half-height sqrt(0.75); the box is above it.
    top = np.sqrt(0.75)
    for gap, empty in ((1e-12, True), (-1e-12, False)):
        sets = single([-1, top + gap], [1, 3], (-0.5, 0, 1), (0.5, 0, 1))
        assert sets.is_empty == empty
    assert not single([-1, top + gap], [1, 3], (-0.5, 0, 1)).is_empty


# --- Known cases. ---

CASES = [
    ("no_discs", single([-1, -1], [1, 1]), (3, 0.5), (1, 0.5)),
    ("corner", single([-1, -1], [1, 1], (0, 0, 5)), (3, 4), (1, 1)),
    ("disc_inside_box", single([-9, -9], [9, 9], (1, 0, 2)), (1, 7), (1, 2)),
    ("whole_plane", single([-INF, -INF], [INF, INF], (0, 0, INF)), (1e9, -3), (1e9, -3)),
    ("half_plane", single([-INF, 0], [INF, INF], (0, 0, INF), (5, 5, INF)), (2, -3), (2, 0)),
    ("half_disc", single([0, -INF], [INF, INF], (0, 0, 1)), (-1, 4), (0, 1)),
    ("lens_tip", single([-9, -9], [9, 9], (-3, 0, 5), (3, 0, 5)), (0, 9), (0, 4)),
    ("lens_side", single([-9, -9], [9, 9], (-3, 0, 5), (3, 0, 5)), (7, 0), (2, 0)),
    ("tangent_outside", single([-9, -9], [9, 9], (-1, 0, 1), (2, 0, 2)), (4, 7), (0, 0)),
    ("tangent_inside", single([-9, -9], [9, 9], (0, 0, 2), (1, 0, 1)), (9, 0), (2, 0)),
    ("tangent_to_box", single([1, -1], [2, 1], (0, 0, 1)), (-3, 8), (1, 0)),
    ("touching_corner", single([3, 4], [9, 9], (0, 0, 5)), (8, 8), (3, 4)),
    ("concentric", single([-9, -9], [9, 9], (1, 1, 3), (1, 1, 2)), (1, 8), (1, 3)),
    ("coincident", single([-9, -9], [9, 9], (1, 1, 2), (1, 1, 2)), (1, 8), (1, 3)),
    ("coincident_cut", single([-9, -9], [9, 1], (1, 1, 2), (1, 1, 2)), (8, 8), (3, 1)),
    ("zero_radius", single([-9, -9], [9, 9], (1, 1, 0), (0, 0, 5)), (8, 3), (1, 1)),
    ("zero_radius_on_circle", single([-9, -9], [9, 9], (3, 4, 0), (0, 0, 5)), (8, 3), (3, 4)),
    ("zero_radius_at_its_centre", single([1, 1], [9, 9], (1, 1, 0)), (1, 1), (1, 1)),
    ("two_zero_radii", single([0, 0], [9, 9], (1, 1, 0), (1, 1, 0)), (8, 3), (1, 1)),
    ("segment", single([3, -9], [3, 9], (0, 0, 5)), (-7, 9), (3, 4)),
    ("single_point_box", single([3, 4], [3, 4], (0, 0, 5), (3, 4, 0)), (-7, 9), (3, 4)),
    ("at_centre_outside_box", single([3, -9], [9, 9], (0, 0, 5)), (0, 0), (3, 0)),
    ("at_centre_outside_disc", single([-9, -9], [9, 9], (0, 0, 5), (6, 0, 2)), (0, 0), (4, 0)),
    ("huge_disc", single([-9, -9], [9, 9], (0, 0, 1e300), (0, 0, 1)), (3, 4), (0.6, 0.8)),
    ("tiny_offset", single([-9, -9], [9, 9], (0, 0, 1), (5e-324, 0, 1)), (0, 4), (0, 1)),
]


@pytest.mark.parametrize(
    ("sets", "point", "expected"), [case[1:] for case in CASES], ids=[case[0] for case in CASES]
)
def test_projection_equals_known_answer(
    sets: PlanarSets, point: tuple[float, float], expected: tuple[float, float]
) -> None:
    assert not sets.is_empty
    np.testing.assert_allclose(sets.project(point), expected, rtol=1e-14, atol=1e-14)


def test_tangent_discs_meet_where_they_touch() -> None:
    rng = np.random.default_rng(14)
    factor = 10.0 ** rng.uniform(-8, 8, (5_000, 1))
    sets, touch = two_discs(rng, factor * rng.exponential(size=(5_000, 2)), 0.0, factor)
    assert not sets.is_empty.any()
    nearest = sets.project(factor * rng.normal(size=(5_000, 2)))
    # Ill-conditioned: a change e of the data moves the point by order sqrt(e).
    assert (np.abs(nearest - touch).max(axis=1) / scale(sets, touch)).max() < 1e-6
    assert (sets.violation(nearest) <= ROUNDING * scale(sets, nearest)).all()


def test_projection_onto_sliver_of_rounding_width_exists() -> None:
    rng = np.random.default_rng(15)
    radii = np.exp(2 * rng.normal(size=(20_000, 2)))
    sets, _ = two_discs(rng, radii, signed_gaps(rng, 20_000, -18, -12))
    sets = sets[~sets.is_empty]
    for spread in (1e-3, 1.0, 1e4):
        nearest = sets.project(spread * rng.normal(size=(*sets.shape, 2)))
        assert (sets.violation(nearest) <= ROUNDING * scale(sets, nearest)).all()


# --- Shapes, values, errors. ---


def test_points_and_sets_broadcast() -> None:
    sets = PlanarSets(-np.ones(2), np.ones((3, 1, 2)), np.zeros((1, 2)), np.full((4, 1), 0.5))
    assert sets.shape == (3, 4)
    assert sets.project(np.ones(2)).shape == (3, 4, 2)
    assert sets.project(np.ones((5, 1, 1, 2))).shape == (5, 3, 4, 2)
    assert sets.is_empty.shape == sets.violation([0.0, 0.0]).shape == (3, 4)
    indices = (0, np.s_[:, 1], np.eye(3, 4, dtype=bool), np.array([0, 0, 2]))
    assert [sets[index].shape for index in indices] == [(4,), (3,), (3,), (3, 4)]
    assert sets[0:0].project(np.ones(2)).shape == (0, 4, 2)
    with pytest.raises(IndexError):
        sets[0, 0, 0]
    with pytest.raises(ValueError, match="points must have shape"):
        single([-1, -1], [1, 1]).project(np.zeros(3))


def test_index_selects_sets(cases: Case) -> None:
    sets, points = cases
    chosen = points[:, 0] > 1
    np.testing.assert_array_equal(
        sets[chosen].project(points[chosen]), sets.project(points)[chosen]
    )
    np.testing.assert_array_equal(sets[3].project(points[3]), sets.project(points)[3])


def test_violation_is_largest_distance() -> None:
    sets = single([-1, -1], [1, 1], (0, 0, 1), (2, 0, INF))
    np.testing.assert_allclose(sets.violation([[0, 0], [0, 3], [4, 5]]), [0, 2, np.sqrt(41) - 1])
    assert sets.contains([[0, 0], [0, 3], [np.nan, 0]]).tolist() == [True, False, False]
    assert sets.contains([0, 3], tolerance=2.0)
    assert single([-1, -1], [1, 1]).violation([4.0, 5.0]) == 5
    assert sets.violation([0, 1.5]) <= 0.5
    assert not sets.violation([0, 1.5]) <= 0.4


@pytest.mark.parametrize("bad", [np.nan, INF, -INF])
def test_points_not_finite_give_nan(bad: float) -> None:
    sets = single([-1, -1], [1, 1], (0, 0, 1), (1, 0, 1))
    nearest = sets.project([[bad, 0], [0, bad], [3, 0]])
    assert np.isnan(nearest[:2]).all()
    np.testing.assert_allclose(nearest[2], [1, 0])
    assert np.isnan(sets.violation([bad, 0]))
    assert not sets.violation([bad, 0]) <= 1.0


def test_projection_onto_empty_sets_raises() -> None:
    sets = PlanarSets(
        -np.ones(2), np.ones(2), np.array([[[0.0, 0]], [[9, 9]], [[7, 0]]]), np.ones(1)
    )
    with pytest.raises(ValueError, match="2 of 3 points"):
        sets.project([0.0, 0.0])


def test_sets_are_immutable_copies() -> None:
    lower = -np.ones(2)
    sets = PlanarSets(lower, np.ones(2), np.zeros((1, 2)), np.ones(1))
    points = np.full((2, 2), 3.0)
    sets.project(points)
    assert (points == 3).all()
    assert (lower == -1).all()
    with pytest.raises(ValueError, match="read-only"):
        sets.lower[0] = 0


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"lower": [2.0, 0.0]}, "lower"),
        ({"lower": [np.nan, 0.0]}, "lower"),
        ({"lower": [INF, 0.0], "upper": [INF, 1.0]}, "lower"),
        ({"lower": [-INF, 0.0], "upper": [-INF, 1.0]}, "upper"),
        ({"centers": [[INF, 0.0]]}, "centers"),
        ({"radii": [-1.0]}, "radii"),
        ({"radii": [np.nan]}, "radii"),
        ({"radii": 1.0}, "shapes"),
        ({"radii": [1.0, 2.0]}, "shapes"),
        ({"lower": [0.0, 0.0, 0.0]}, "shapes"),
        ({"centers": np.zeros((4, 2)), "radii": np.ones(4)}, "K from 0 to 3"),
        ({"lower": np.zeros((3, 2)), "upper": np.ones((4, 2))}, "broadcast"),
    ],
)
def test_sets_of_wrong_shape_or_value_raise(changes: dict[str, object], message: str) -> None:
    right = {"lower": [-1.0, -1], "upper": [1.0, 1], "centers": [[0.0, 0]], "radii": [1.0]}
    with pytest.raises(ValueError, match=message):
        PlanarSets(**(right | changes))


# --- Wishes. ---


@pytest.mark.slow
def test_relax_infeasible_set_becomes_nearest_point() -> None:
    rng = np.random.default_rng(16)
    count = 300
    lower = -rng.exponential(size=(count, 2))
    upper = rng.exponential(size=(count, 2))
    centers = np.stack([0.3 * rng.normal(size=(count, 2)), 2 * rng.normal(size=(count, 2))], axis=1)
    radii = np.column_stack([1 + rng.random(count), 0.5 * rng.random(count)])
    sets = PlanarSets(lower, upper, centers, radii)
    relaxed, infeasible = sets.relax_infeasible()
    assert 100 < np.count_nonzero(infeasible) < 290
    assert not relaxed.is_empty.any()
    angles, shares = np.meshgrid(np.linspace(0, 2 * np.pi, 721), np.linspace(0, 1, 101))
    polar = np.stack([shares * np.cos(angles), shares * np.sin(angles)], axis=-1).reshape(-1, 2)
    for i in np.flatnonzero(infeasible):
        point = relaxed.lower[i]
        np.testing.assert_array_equal(point, relaxed.upper[i])
        np.testing.assert_array_equal(relaxed[i].project(rng.normal(size=2)), point)
        physical = PlanarSets(lower[i], upper[i], centers[i, :1], radii[i, :1])
        assert physical.violation(point) <= 1e-13
        tries = np.clip(centers[i, 0] + radii[i, 0] * polar, lower[i], upper[i])
        tries = tries[np.hypot(*(tries - centers[i, 0]).T) <= radii[i, 0]]
        best = np.hypot(*(tries - centers[i, 1]).T).min()
        reached = np.hypot(*(point - centers[i, 1]))
        assert best - 0.02 <= reached <= best + 1e-12
        assert reached > radii[i, 1]  # disc 1 indeed cannot be reached


def test_relax_keeps_feasible_sets_and_single_ones() -> None:
    sets = PlanarSets(
        -np.ones(2), np.ones(2), np.array([[[0.0, 0], [1, 0]], [[0, 0], [5, 0]]]), np.ones(2)
    )
    relaxed, infeasible = sets.relax_infeasible()
    np.testing.assert_array_equal(infeasible, [False, True])
    np.testing.assert_array_equal(relaxed.lower, [[-1, -1], [1, 0]])
    np.testing.assert_array_equal(relaxed.upper, [[1, 1], [1, 0]])
    np.testing.assert_array_equal(relaxed.centers, sets.centers)
    np.testing.assert_array_equal(relaxed.radii, [[1, 1], [INF, INF]])
    same, none = sets[:1].relax_infeasible()
    assert same.radii[0, 1] == 1
    assert not none.any()
    alone, short = single([-9, -9], [9, 9], (0, 0, 1), (5, 0, 1)).relax_infeasible()
    assert short.shape == alone.shape == ()
    np.testing.assert_allclose(alone.project([3, 3]), [1, 0])


def test_relax_empty_hard_constraints_raise() -> None:
    centers = np.array([[[0.0, 0], [1, 0]], [[9, 0], [1, 0]], [[0, 9], [1, 0]]])
    with pytest.raises(ValueError, match="2 of 3 sets"):
        PlanarSets(-np.ones(2), np.ones(2), centers, np.ones(2)).relax_infeasible()
