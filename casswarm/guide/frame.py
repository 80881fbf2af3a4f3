"""The frame in which swarms and guides are planned, so that images of a scenario have equal plans.

Limits of speed are squares along the axes. So quarter turns, mirrors and permutations of members
map scenarios to equivalent ones. Solves are local, proofs stop at a gap, and their results may
depend on a direction or on an order; every scenario is therefore planned in a frame that its own
geometry defines, and the plan is mapped back. Both maps only swap and negate coordinates, and are
exact.
"""

from __future__ import annotations

import itertools
import math
import re
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, cast

import numpy as np
from numpy.typing import ArrayLike

from ..scenario import Scenario
from ..scenario.hazard_table import CONSTANTS
from ..typing import FloatArray, IntArray, Progress

if TYPE_CHECKING:
    from ..hazard import KernelHazard
    from ..scenario.hazard_table import HazardKeys
    from ..scenario.zones import ZoneTable
    from .guide import Candidate, Guide

_TURN, _MIRROR = np.array([[0.0, -1.0], [1.0, 0.0]]), np.diag([1.0, -1.0])

SYMMETRIES = tuple(
    np.linalg.matrix_power(_TURN, quarters) @ mirror + 0.0
    for mirror in (np.eye(2), _MIRROR)
    for quarters in range(4)
)
"""The eight orthogonal matrices (2, 2) that map the axes to each other; the identity first."""

_DIGITS = 9  # of lengths relative to the scenario's, and
_DIGITS_SPEED = 6  # of speeds relative to v_max, which a solver computes: equal up to rounding
_SIDES = re.compile(r"\b[LR]+\b")
_MIRRORED = str.maketrans("LR", "RL")


@dataclass(frozen=True, eq=False)
class Frame:
    """Axes and an order of members.

    Parameters
    ----------
    matrix : (2, 2)
        One of `SYMMETRIES`, from the scenario's axes to those of the frame.
    order : (n,) int
        Member of the scenario for every member in the frame.
    """

    matrix: FloatArray
    order: IntArray

    @classmethod
    def of_scenario(cls, scenario: Scenario, velocity: FloatArray) -> Frame:
        """The frame that a scenario and the V(-1) of its members, (2,), define.

        Of the eight, it is the one with the greatest key in lexicographic order. Scenarios with the
        same key in two frames are equal in them. The rates of users may depend on directions and
        members; their scenarios keep theirs.
        """
        if scenario.hazard_table.kind not in CONSTANTS:
            return cls(np.eye(2), np.arange(scenario.n))
        matrix = max(SYMMETRIES, key=lambda each: _key(scenario, velocity, each))
        reach = np.round(_reach(scenario) / scenario.target.radius, _DIGITS)
        return cls(matrix, _sorting(np.column_stack([reach, _members(scenario, matrix)])))

    @classmethod
    def of_agent(cls, scenario: Scenario, start: FloatArray, velocity: FloatArray) -> Frame:
        """Frame of a single agent at `start` (2,), with the scenario's order of members."""
        if scenario.hazard_table.kind not in CONSTANTS:
            return cls(SYMMETRIES[0], np.arange(scenario.n))
        offset = _offsets(scenario, start)

        def key(matrix: FloatArray) -> list[float]:
            return [*_key(scenario, velocity, matrix), *(offset @ matrix.T)]

        return cls(max(SYMMETRIES, key=key), np.arange(scenario.n))

    @property
    def is_identity(self) -> bool:
        """True if the frame is the scenario's own."""
        in_order = bool((np.diff(self.order) > 0).all())
        return in_order and np.array_equal(self.matrix, SYMMETRIES[0])

    @property
    def inverse(self) -> Frame:
        """Inverse frame, which maps the frame to the scenario."""
        return Frame(self.matrix.T, np.argsort(self.order))

    def members_to(self, vectors: FloatArray) -> FloatArray:
        """Vectors (..., n, 2) of the scenario's members in the frame."""
        return self.points_to(vectors[..., self.order, :])

    def members_from(self, vectors: FloatArray) -> FloatArray:
        """Vectors (..., n, 2) of the frame's members in the scenario."""
        return self.inverse.members_to(vectors)

    def scenario_in(self, scenario: Scenario) -> Scenario:
        """The scenario in the frame; its radars keep their order."""
        if self.is_identity:
            return scenario
        values: dict[str, object] = {
            "swarm.positions": self.members_to(scenario.positions),
            "target.center": self.points_to(scenario.target.center),
        }
        table = scenario.hazard_table
        values |= {f"hazard.{key}": each for key, each in self._sources_in(table).items()}
        if table.case:
            values["hazard.case"] = [
                case.given | {"weight": case.weight} | self._sources_in(case) for case in table.case
            ]
        if scenario.swarm.kind is not None:
            values["swarm.kind"] = [scenario.swarm.kind[row] for row in self.order]
        if scenario.swarm.velocity != "guide":
            values["swarm.velocity"] = self.points_to(scenario.swarm.velocity)
        return scenario.with_values(values)

    def _sources_in(self, table: HazardKeys) -> dict[str, object]:
        """Radars and zones in the frame, by key."""
        values: dict[str, object] = {"radars": self.points_to(table.radars)} if table.radars else {}
        if table.radar:
            values["radar"] = [radar.mapped(self.points_to) for radar in table.radar]
        if table.zone:
            values["zone"] = [zone.mapped(self.points_to) for zone in table.zone]
        return values

    def guide_to(self, guide: Guide) -> Guide:
        """Positions and candidates of a guide of the scenario in the frame."""
        candidates = tuple(map(self.candidate_to, guide.candidates))
        return replace(guide, positions=self.points_to(guide.positions), candidates=candidates)

    def candidate_to(self, candidate: Candidate) -> Candidate:
        """A candidate of a guide of the scenario, with its solution, in the frame."""
        x = self.points_to(candidate.solution.x.reshape(-1, 2)).ravel()
        return replace(
            candidate,
            start=self.renamed(candidate.start),
            homotopy=self.renamed(candidate.homotopy),
            velocities=self.points_to(candidate.velocities),
            solution=replace(candidate.solution, x=x),
        )

    def renamed(self, text: str) -> str:
        """A text with homotopy signatures of the scenario, with those of the frame."""
        if np.linalg.det(self.matrix) > 0:
            return text
        return _SIDES.sub(lambda sides: sides.group().translate(_MIRRORED), text)

    def reported(self, progress: Progress | None) -> Progress | None:
        """Progress callback for a search in the frame, with texts in signatures of the scenario."""
        if progress is None:
            return None
        return lambda text, done, total: progress(self.renamed(text), done, total)

    def points_to(self, points: ArrayLike) -> FloatArray:
        """Points or vectors (..., 2) of the scenario in the frame."""
        vectors = np.asarray(points, float)
        if not vectors.size:
            return vectors
        axes, signs = np.abs(self.matrix).argmax(axis=1), self.matrix.sum(axis=1)
        return np.asarray(vectors[..., axes] * signs + 0.0)


def _key(scenario: Scenario, velocity: FloatArray, matrix: FloatArray) -> list[float]:
    """Numbers that tell the images of a scenario apart, whatever the order of members and radars.

    The direction to the target comes first, and V(-1) last: a solver may have computed it.
    """
    offsets = _members(scenario, matrix)
    # exact sums do not depend on the order
    direction = [-round(math.fsum(column) / len(offsets), _DIGITS) for column in offsets[:, :2].T]
    speeds = np.round(velocity @ matrix.T / scenario.swarm.v_max, _DIGITS_SPEED)
    cases = sorted(
        [round(case.weight, _DIGITS), *_hazard_key(case.scenario, matrix)]
        for case in scenario.cases
    )
    members = offsets[_sorting(offsets)].ravel().tolist()
    return [*direction, *members, *itertools.chain(*cases), *speeds.tolist()]


def _hazard_key(scenario: Scenario, matrix: FloatArray) -> list[float]:
    """Numbers that tell images of a hazard apart, whatever the order of radars and zones."""
    table = scenario.hazard_table
    radars = _offsets(scenario, np.array(table.radars, float).reshape(-1, 2)) @ matrix.T
    weighted = np.column_stack([radars, table.strengths or np.ones(len(radars))])
    if table.radar:
        weighted = _radars_in_time(scenario, matrix)
    zones = sorted(_zone_key(scenario, zone, matrix) for zone in table.zone)
    return [*weighted[_sorting(weighted)].ravel().tolist(), *itertools.chain(*zones)]


def _zone_key(scenario: Scenario, zone: ZoneTable, matrix: FloatArray) -> list[float]:
    """Numbers that do not depend on the order of vertices."""
    vertices = _offsets(scenario, np.array(zone.vertices or (zone.center,))) @ matrix.T
    lengths = [(zone.radius or 0.0) / scenario.target.radius, zone.edge / scenario.target.radius]
    numbers = [*lengths, zone.rate * scenario.time.dt]
    return [*vertices[_sorting(vertices)].ravel().tolist(), *np.round(numbers, _DIGITS).tolist()]


def _radars_in_time(scenario: Scenario, matrix: FloatArray) -> FloatArray:
    """A row for every radar: offset and strength after every step."""
    columns = []
    for step in range(scenario.n_steps + 1):
        radars = cast("KernelHazard", scenario.hazard.after(step))
        offsets = _offsets(scenario, radars.radar_positions) @ matrix.T
        columns += [offsets, radars.radar_strengths[:, None]]
    return np.hstack(columns)


def _offsets(scenario: Scenario, points: FloatArray) -> FloatArray:
    """Offsets of points (m, 2) from the target's centre, scaled and rounded."""
    center = np.array(scenario.target.center)
    length = np.abs(scenario.positions - center).max() + scenario.target.radius
    return np.asarray(np.round((points - center) / length, _DIGITS))


def _members(scenario: Scenario, matrix: FloatArray) -> FloatArray:
    """Offsets (n, 2) of the members and, where they differ, the numbers of their kinds."""
    offsets = _offsets(scenario, scenario.positions) @ matrix.T
    if scenario.swarm.kind is None:
        return offsets
    kinds = [list(kind.model_dump().values()) for kind in scenario.swarm.member_kinds]
    return np.column_stack([offsets, np.array(kinds, float)])


def _reach(scenario: Scenario) -> FloatArray:
    """Distance (n,) along the axes that each member has to cover to arrive.

    The first of several central members is where the guide starts: it must be able to arrive.
    """
    radius = scenario.target.radius
    offsets = np.sort(np.abs(scenario.positions - np.array(scenario.target.center)), axis=1)
    difference, total = offsets[:, 1] - offsets[:, 0], offsets.sum(axis=1)
    corner = 0.5 * (total - np.sqrt(np.maximum(2 * radius**2 - difference**2, 0.0)))
    return np.where(difference >= radius, offsets[:, 1] - radius, corner)


def _sorting(rows: FloatArray) -> IntArray:
    """Order of rows that depends on their values only."""
    return np.asarray(np.lexsort(rows.T[::-1]))
