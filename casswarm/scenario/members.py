"""Members that differ: the tables ``[swarm.kinds.name]`` of a scenario file, and equal members.

Proofs and guides are made for scenarios of equal members. From one whose members differ they follow
by `with_equal_members`: a member of exposure e that adds c to densities, alone or among others of
its kind, has the rate e S / (1 + c alpha_2 D) + C, which is that of constants e alpha_1 and
c alpha_2. A zone keeps its rate times e (1 + alpha_2) / (1 + c alpha_2), since its rate is that of
a single agent (`casswarm.hazard.Saturation`).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from typing import TYPE_CHECKING, Annotated

from pydantic import Field

from .._util.text import counted
from .validation import KINDS_PREFIX, LARGEST, SMALLEST, Allowed, Boolean, Positive, Table, as_text

if TYPE_CHECKING:
    from .model import Scenario
    from .sections import Swarm

_LARGEST_FACTOR = 1e6
Factor = Annotated[
    float,
    Field(strict=True, allow_inf_nan=False, ge=1 / _LARGEST_FACTOR, le=_LARGEST_FACTOR),
    Allowed(f"a number above 0 (from {1 / _LARGEST_FACTOR:g} to {_LARGEST_FACTOR:g})"),
]


class MemberKind(Table):
    """A kind of members: what distinguishes those that `swarm.kind` gives its name."""

    v_max: Positive | None = Field(
        None,
        examples=[2.5],
        description="Bound on their velocity, length per time; by default that of [swarm].",
    )
    a_max: Positive | None = Field(
        None,
        examples=[0.5],
        description="Bound on their change of velocity in a step, ||V(t) - V(t-1)||^2, in squared "
        "units of velocity; by default that of [swarm].",
    )
    exposure: Factor = Field(
        1.0, description="Factor of the rate that radars and zones have for such a member."
    )
    density: Factor = Field(
        1.0, description="What such a member adds to the density of others, and to its own."
    )
    counts: Boolean = Field(
        True, description="Whether its arrival in the target counts for a success, and it may lead."
    )

    @property
    def factors(self) -> tuple[float, float]:
        """Exposure and density."""
        return self.exposure, self.density


def member_kinds(swarm: Swarm) -> tuple[MemberKind, ...]:
    """The kind of every member, with the limits of motion of the swarm where it has none."""
    limits = {"v_max": swarm.v_max, "a_max": swarm.a_max}
    plain = MemberKind(**limits)
    complete = {
        name: MemberKind(**limits | kind.model_dump(exclude_none=True))
        for name, kind in swarm.kinds.items()
    }
    names = ("",) * len(swarm.positions) if swarm.kind is None else swarm.kind
    return tuple(complete.get(name, plain) for name in names)


def problems(scenario: Scenario) -> Iterator[str]:
    """Contradictions of kinds with the number of members, with each other, or with the hazard."""
    swarm, hazard = scenario.swarm, scenario.hazard_table
    if swarm.kind is not None and len(swarm.kind) != len(swarm.positions):
        yield (
            f"swarm.kind has {counted(len(swarm.kind), 'name')} and swarm.positions "
            f"{counted(len(swarm.positions), 'member')}; give every member a kind"
        )
        return
    for name, kind in swarm.kinds.items():
        key = f"swarm.kinds.{name}"
        if name not in (swarm.kind or ()):
            yield f"{key} is the kind of no member; name it in swarm.kind, or remove the table"
        if hazard.is_custom and kind.factors != (1.0, 1.0):
            factor = "exposure" if kind.exposure != 1.0 else "density"
            yield (
                f"{key}.{factor} is {getattr(kind, factor):g}, but hazard.kind is "
                f"{as_text(hazard.kind)}, whose rates are your own: write the factor into them"
            )
        for factor, constant in zip(("exposure", "density"), ("alpha_1", "alpha_2"), strict=True):
            product = getattr(kind, factor) * (getattr(hazard, constant) or 1.0)
            if not SMALLEST <= product <= LARGEST:
                yield (
                    f"{key}.{factor} times hazard.{constant} is {product:g}; it must be from "
                    f"{SMALLEST:g} to {LARGEST:g}"
                )
    if not swarm.counting.any():
        yield "swarm.kind has no member whose arrival counts; let one kind have counts = true"


def with_accelerations(swarm: Swarm, scale: Callable[[float], float]) -> dict[str, object]:
    """Values of the keys `a_max` of all members, scaled."""
    values: dict[str, object] = {"swarm.a_max": scale(swarm.a_max)}
    for name, kind in swarm.kinds.items():
        if kind.a_max is not None:
            values[f"{KINDS_PREFIX}{name}.a_max"] = scale(kind.a_max)
    return values


def most_favourable(kinds: Sequence[MemberKind]) -> MemberKind:
    """The kind with the least exposure and the largest density, speed and acceleration of all."""
    return MemberKind(
        v_max=max(kind.v_max or 0.0 for kind in kinds),
        a_max=max(kind.a_max or 0.0 for kind in kinds),
        exposure=min(kind.exposure for kind in kinds),
        density=max(kind.density for kind in kinds),
    )


def with_equal_members(scenario: Scenario, kind: MemberKind, rows: Sequence[int]) -> Scenario:
    """The scenario with some of its members, all of one kind that has limits of motion.

    Constants are rounded so that no rate is above the exact one.
    """
    table = scenario.hazard_table
    values: dict[str, object] = {
        "swarm.kind": None,
        "swarm.kinds": None,
        "swarm.positions": [scenario.swarm.positions[row] for row in rows],
        "swarm.v_max": kind.v_max,
        "swarm.a_max": kind.a_max,
        "guide.margin": scenario.arrival_margin,
        "success.arrivals": min(scenario.success.arrivals, len(rows)),
    }
    if kind.factors != (1.0, 1.0) and table.alpha_1 is not None and table.alpha_2 is not None:
        values["hazard.alpha_1"] = math.nextafter(kind.exposure * table.alpha_1, 0.0)
        if table.alpha_2 > 0:
            values["hazard.alpha_2"] = math.nextafter(kind.density * table.alpha_2, math.inf)
        share = kind.exposure * (1.0 + table.alpha_2) / (1.0 + kind.density * table.alpha_2)
        values["hazard.zone"] = [
            zone.model_dump(exclude_none=True) | {"rate": zone.rate * share * (1.0 - 2.0**-50)}
            for zone in table.zone
        ]
    return scenario.with_values(values)
