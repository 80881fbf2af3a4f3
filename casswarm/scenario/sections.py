"""Tables of a scenario file but for the hazard's: every key with its unit and limits."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from functools import cached_property
from typing import Annotated, Literal, TypedDict

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from ..typing import LeaderSelection
from .members import MemberKind, member_kinds
from .validation import Allowed, Boolean, Count, NotNegative, Number, Point, Positive, Table

MOST_STEPS = 100_000
"""Largest number of steps until t_f, and of parts of these."""

_MOST_TARGETS = 100
_MOST_KINDS = 100
_STEP_TOLERANCE = 2.0**-50  # relative: t_f = 1.0 holds ten steps of dt = 0.1 despite rounding
_TIE_TOLERANCE = 1e-9  # relative: members equally far from the centroid up to rounding

KindName = Annotated[
    str,
    Field(strict=True, max_length=40, pattern=r"^[A-Za-z0-9_]+$"),
    Allowed("a name of up to 40 letters, digits and underscores, in quotes"),
]


class Swarm(Table):
    """Members: their initial positions and how they can move."""

    positions: Annotated[
        tuple[Point, ...],
        Field(min_length=1),
        Allowed("a list of [x, y] pairs of numbers, one for each member, at least one"),
    ] = Field(description="Initial positions [x, y] of members 0 to n - 1, in units of length.")
    velocity: Annotated[
        Literal["guide"] | tuple[Number, Number],
        Allowed("'guide', or [vx, vy], two numbers"),
    ] = Field(
        "guide",
        description="Velocity of every member before the first step, V(-1), [vx, vy] in units of "
        "length per time; 'guide' is the first velocity of the guide: a swarm already in motion.",
    )
    v_max: Positive = Field(
        description="Bound on the absolute value of each velocity component, length per time."
    )
    speed: Annotated[Literal["box", "disc"], Allowed("'box' or 'disc'")] = Field(
        "box",
        description="'box' bounds each component of a velocity by v_max, as the paper does; 'disc' "
        "bounds the speed in every direction.",
    )
    a_max: Positive = Field(
        description="Bound on the change of velocity in a step, ||V(t) - V(t-1)||^2, in squared "
        "units of velocity."
    )
    kind: (
        Annotated[tuple[KindName, ...], Allowed("a list of names, one for each member")] | None
    ) = Field(
        None,
        examples=[["carrier", "carrier", "companion"]],
        description="Kind of each member; all equal by default. A name without a table "
        "[swarm.kinds.name] has the values of [swarm] and the defaults of the others.",
    )
    kinds: Annotated[
        dict[KindName, MemberKind],
        Field(max_length=_MOST_KINDS),
        Allowed(
            f"a table for each name, at most {_MOST_KINDS}; names have up to 40 letters, digits "
            "and underscores"
        ),
    ] = Field(
        {},
        examples=[{"companion": {"exposure": 2.0, "density": 3.0, "counts": False}}],
        description="Kinds of members, a table for each name in `kind` that differs.",
    )

    def __hash__(self) -> int:
        """Hash of all values; kinds are a mapping."""
        values = {key: getattr(self, key) for key in type(self).model_fields}
        return hash(tuple((values | {"kinds": tuple(self.kinds.items())}).values()))

    @cached_property
    def member_kinds(self) -> tuple[MemberKind, ...]:
        """The kind of every member, with the limits of motion of the swarm where it has none."""
        return member_kinds(self)

    def of_rows(self, rows: Sequence[int]) -> Swarm:
        """The swarm with some of its members, in a given order; not validated."""
        values = {name: getattr(self, name) for name in type(self).model_fields}
        values["positions"] = tuple(self.positions[row] for row in rows)
        if self.kind is not None:
            kind = values["kind"] = tuple(self.kind[row] for row in rows)
            values["kinds"] = {name: each for name, each in self.kinds.items() if name in kind}
        return type(self).model_construct(**values)

    @property
    def initial_velocity(self) -> tuple[float, float] | None:
        """V(-1) of every member; None if it is the first velocity of the guide."""
        return None if self.velocity == "guide" else self.velocity

    @property
    def counting(self) -> NDArray[np.bool_]:
        """Whether the arrival of each member counts, (n,)."""
        return np.array([kind.counts for kind in self.member_kinds])

    def counted(self, flags: NDArray[np.bool_]) -> NDArray[np.bool_]:
        """Flags (..., n) of members that count; those of others are False.

        All of them where members are equal, also flags of some of the members.
        """
        return flags if self.kind is None else flags & self.counting

    @property
    def central_member(self) -> int:
        """Index of the member nearest to the centroid; ties go to the lowest index.

        Of those that count, and to their centroid.
        """
        rows = np.flatnonzero(self.counting)
        positions = np.array(self.positions)[rows]
        offsets = positions - positions.mean(axis=0)
        distances = np.hypot(offsets[:, 0], offsets[:, 1])
        tolerance = _TIE_TOLERANCE * (distances.max() + np.abs(positions).max())
        return int(rows[np.argmax(distances <= distances.min() + tolerance)])


class Disc(Table):
    """A closed disc."""

    center: Point = Field(description="Centre [x, y], in units of length.")
    radius: Positive = Field(description="Radius, in units of length.")

    def distances(self, positions: NDArray[np.float64]) -> NDArray[np.float64]:
        """Distances of positions (..., 2) from the centre, shape (...)."""
        offsets = positions - np.array(self.center)
        return np.asarray(np.hypot(offsets[..., 0], offsets[..., 1]))

    def contains(self, positions: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Test if positions (..., 2) lie in the disc, shape (...)."""
        return np.asarray(self.distances(positions) <= self.radius)


class Target(Disc):
    """Target zone Z, a closed disc or several; a member that is in one alive has arrived."""

    center: Point = Field(description="Centre [x, y] of the target zone, in units of length.")
    radius: Positive = Field(description="Radius of the target zone, in units of length.")
    other: Annotated[
        tuple[Disc, ...],
        Field(max_length=_MOST_TARGETS),
        Allowed(f"at most {_MOST_TARGETS} tables [[target.other]]"),
    ] = Field(
        (),
        examples=[[{"center": [8.0, 6.0], "radius": 0.5}]],
        description="Further target zones, a table for each: a member may arrive in any of them. "
        "They may also be written as [[target]] more than once.",
    )

    @property
    def discs(self) -> tuple[Disc, ...]:
        """All target zones, the first one included."""
        return Disc(center=self.center, radius=self.radius), *self.other

    def contains(self, positions: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Test if positions (..., 2) lie in any of the target zones, shape (...)."""
        inside = super().contains(positions)
        for disc in self.other:
            inside |= disc.contains(positions)
        return inside

    def outside(self, positions: NDArray[np.float64]) -> NDArray[np.float64]:
        """Distances of positions (..., 2) from the nearest target zone, 0 inside, shape (...)."""
        distances = [disc.distances(positions) - disc.radius for disc in self.discs]
        return np.asarray(np.maximum(np.min(distances, axis=0), 0.0))


class Success(Table):
    """Condition for the success of a run."""

    arrivals: Count = Field(
        1,
        description="Number of living members that must be in the target zone after the same step, "
        "at least.",
    )


class Information(Table):
    """What members know, and when."""

    delay: Annotated[
        Annotated[int, Field(strict=True, ge=0, le=MOST_STEPS)] | Literal["never"],
        Allowed(f"a whole number of steps from 0 to {MOST_STEPS:g}, or 'never'"),
    ] = Field(
        0,
        description="Number of steps after which losses are known, or 'never'. A member that is "
        "lost and not known to be is a ghost: the others decide as if it were alive.",
    )


class Time(Table):
    """Clock with steps of dt until t_f."""

    dt: Positive = Field(description="Length of a step, in units of time.")
    t_f: Positive = Field(description="Time at which a run ends at the latest, in units of time.")
    substeps: Count = Field(
        1,
        description="Number of equal parts of a step, at whose ends the rates are evaluated: the "
        "risk of a step is their mean. Members fly straight within a step.",
    )

    @property
    def steps(self) -> int:
        """Number of whole steps until t_f, floor(t_f / dt) but for the rounding of both."""
        return self.steps_within(self.t_f)

    def steps_within(self, duration: float) -> int:
        """Number of whole steps within a duration, but for the rounding of both."""
        return math.floor(duration / self.dt * (1 + _STEP_TOLERANCE))


class GuideOptions(Table):
    """Options of the search for the guide, the path that the swarm follows."""

    search: Annotated[Literal["local", "global"], Allowed("'local' or 'global'")] = Field(
        "global",
        description="'local' improves the straight line, as the paper does; 'global' compares "
        "paths around the radars, one per homotopy class.",
    )
    arrival: Annotated[Literal["any", "horizon"], Allowed("'any' or 'horizon'")] = Field(
        "any",
        description="Candidates for the arrival step: 'any' step up to the horizon, of which the "
        "best is chosen, or only the 'horizon', as in the paper, whose path uses all the time.",
    )
    a_max: Positive | None = Field(
        None,
        examples=[0.3],
        description="The guide's own bound on ||V(t) - V(t-1)||^2, in squared units of velocity, "
        "below the members' so that they can follow it; by default the members'.",
    )
    acceleration_limited: Boolean = Field(
        True,
        description="Whether the guide respects the bound on the change of velocity; false gives "
        "the paper's version.",
    )
    margin: NotNegative | None = Field(
        None,
        examples=[0.1],
        description="Distance inside the target zone that the guide's last planned step must "
        "reach, in units of length, below the radius (the guide ends where it first enters the "
        "zone; from then on the swarm aims at the centre). By default min(sqrt(rho), radius / 2), "
        "so that members that follow the guide in its corridor arrive too; for a single member "
        "1e-6 radius.",
    )
    max_wait: NotNegative = Field(
        0.0,
        description="Time by which the guide waits at most for a leader that has fallen behind, in "
        "units of time, and no more than it has left until t_f; 0 gives the paper's version, whose "
        "guide flies ahead.",
    )
    gamma: Positive = Field(
        10.0,
        description="Weight of the distance to the target in the paper's penalised form, per unit "
        "of length.",
    )
    learning_rate: Positive = Field(
        0.05, description="Step size of the paper's projected gradient for the guide."
    )
    iterations: Count = Field(
        6000, description="Iterations of the paper's projected gradient for the guide."
    )


class FormationOptions(Table):
    """Options of the formation around the guide."""

    rho: Positive = Field(
        0.05,
        description="Bound on ||X_i - X*||^2, the squared half-width of the corridor around the "
        "guide, in squared units of length.",
    )
    learning_rate: Positive = Field(
        0.05, description="Step size of the paper's projected gradient for the formation."
    )
    iterations: Count = Field(
        2000, description="Iterations of the paper's projected gradient for the formation."
    )
    leader_selection: Annotated[LeaderSelection, Allowed("'nearest', 'first' or 'safest'")] = Field(
        "nearest",
        description="Which living member leads in leader protection: the one 'nearest' to the "
        "guide's present point, the 'first' by index, or the 'safest', of the lowest rate.",
    )
    follower_weight: NotNegative = Field(
        0.01,
        description="Weight of the followers' rates in leader protection, relative to the leader's "
        "rate; used only where distances alone do not determine the formation, as with collisions. "
        "0 is the paper's problem (6).",
    )
    belief: Annotated[Literal["prior", "bayes"], Allowed("'prior' or 'bayes'")] = Field(
        "prior",
        description="Weights of the cases of a hazard that is not known (hazard.case) by which "
        "formations average rates: the 'prior', or 'bayes', the posterior given who has survived "
        "every step so far.",
    )


class Changes(TypedDict, total=False):
    """New values of the tables of a scenario, by key."""

    swarm: Mapping[str, object]
    target: Mapping[str, object]
    time: Mapping[str, object]
    success: Mapping[str, object]
    information: Mapping[str, object]
    hazard: Mapping[str, object]
    guide: Mapping[str, object]
    formation: Mapping[str, object]
