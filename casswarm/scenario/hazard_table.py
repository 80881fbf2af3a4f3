"""The table ``[hazard]`` of a scenario file: kinds, radars, zones, constants, users' functions."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from pkgutil import resolve_name
from typing import TYPE_CHECKING, Annotated, Any

from pydantic import Field, PlainValidator, WithJsonSchema, model_validator

from .._util.text import counted, suggestion
from ..errors import ScenarioError
from .radars import MOST_RADARS, Radar
from .validation import (
    LARGEST,
    Allowed,
    NotNegative,
    Point,
    Positive,
    Problem,
    Table,
    allowed,
    as_text,
    fields,
    invalid,
    require_none,
)
from .zones import MOST_ZONES, ZoneTable

if TYPE_CHECKING:
    from ..hazard import Hazard, Zone


ALPHAS = ("alpha_1", "alpha_2", "alpha_3")
BETAS = ("beta_1", "beta_2")
CONSTANTS = {"saturation": ALPHAS, "saturation+collision": ALPHAS + BETAS}
"""Constants that each built-in kind needs."""

KINDS = "'saturation', 'saturation+collision', or 'module:function'"
PARAMETERS = "a table of numbers, texts, true or false, or lists of these"

_NAME = re.compile(r"[^\W\d]\w*(\.[^\W\d]\w*)*:[^\W\d]\w*(\.[^\W\d]\w*)*")
_RESERVED = ("positions", "alive", "radars")  # arguments that every custom hazard gets


MOST_CASES = 100
"""Largest number of tables `[[hazard.case]]`."""


class FunctionName(str):
    """Name ``module:function`` of a function that a caller passed: its code is trusted."""

    __slots__ = ()


def importable_name(function: Callable[..., Any]) -> str:
    """Name ``module:function`` under which `function` can be imported again, or ScenarioError."""
    module, name = getattr(function, "__module__", None), getattr(function, "__qualname__", None)
    if not isinstance(module, str) or not isinstance(name, str):
        raise ScenarioError(f"{as_text(function)} has no name", function=as_text(function))
    full_name = f"{module}:{name}"
    if module == "__main__":
        reason, name_or_full = "is defined in a script or notebook, not in a module", name
    elif not _NAME.fullmatch(full_name):
        reason, name_or_full = "is defined inside a function, or is a lambda", name
    else:
        try:
            if resolve_name(full_name) is function:
                return full_name
            reason, name_or_full = "is not this function", full_name
        except (ImportError, AttributeError) as error:
            reason, name_or_full = f"cannot be imported: {error}", full_name
    raise ScenarioError(f"'{name_or_full}' {reason}", function=name_or_full)


def _checked_kind(value: object) -> str | Callable[..., Any]:
    """Kind as a name, or as the function itself if it cannot be imported by a name."""
    if isinstance(value, str):
        if value in CONSTANTS or _NAME.fullmatch(value):
            return value
        hint = suggestion(value, CONSTANTS)
        message = f"hazard.kind is {as_text(value)}; it must be {KINDS}{hint}"
        raise invalid([Problem(message, "hazard.kind", value, KINDS)])
    if callable(value):
        try:
            return FunctionName(importable_name(value))  # equal, then, to the name in a file
        except ScenarioError:
            return value
    raise ValueError


def _checked_parameters(value: object) -> dict[str, Any]:
    """Keyword arguments of a custom hazard, with lists as tuples."""
    if not isinstance(value, Mapping):
        raise ValueError
    names = [f"hazard.parameters.{key}" for key in value if key in _RESERVED]
    problems = [Problem(f"{name} is reserved; choose another name", name) for name in names]
    problems += [
        Problem(
            f"hazard.parameters.{key} is {as_text(item)}; hazard.parameters must be {PARAMETERS}",
            f"hazard.parameters.{key}",
            item,
            PARAMETERS,
        )
        for key, item in value.items()
        if not (isinstance(key, str) and _is_parameter(item))
    ]
    if problems:
        raise invalid(problems)
    return {key: _frozen(item) for key, item in value.items()}


def _is_parameter(value: object) -> bool:
    if isinstance(value, list | tuple):
        return all(_is_parameter(item) for item in value)
    if isinstance(value, int | float):
        return abs(value) < math.inf and (isinstance(value, float) or abs(value) < 2**63)
    return isinstance(value, str)


def _frozen(value: Any) -> Any:
    return tuple(_frozen(item) for item in value) if isinstance(value, list | tuple) else value


_KIND = (
    "'saturation' (Scenario I of the paper), 'saturation+collision' (Scenario II), or "
    "'module:function', your own function (or class derived from Hazard) in a module beside the "
    "scenario file, which is run only with --allow-code or allow_code=True."
)
Kind = Annotated[
    str | Callable[..., Any],
    PlainValidator(_checked_kind),
    WithJsonSchema({"type": "string"}),
    Allowed(KINDS),
]


class HazardKeys(Table):
    """Keys that describe destruction rates: of a hazard, and of one of its cases."""

    kind: Kind | None = Field(None, examples=["saturation"], description=_KIND)
    radars: Annotated[
        tuple[Point, ...], Allowed("a list of [x, y] pairs of numbers, one for each radar")
    ] = Field(
        (),
        examples=[[[3.0, 4.0]]],
        description="Positions [x, y] of the k radars, in units of length.",
    )
    strengths: (
        Annotated[
            tuple[Positive, ...],
            Allowed(f"a list of numbers above 0 (at most {LARGEST:g}), one for each radar"),
        ]
        | None
    ) = Field(
        None,
        examples=[[1.0, 2.0]],
        description="Factors of the radars' rates, one for each radar; all 1 by default.",
    )
    radar: Annotated[
        tuple[Radar, ...],
        Field(max_length=MOST_RADARS),
        Allowed(f"at most {MOST_RADARS} tables [[hazard.radar]]"),
    ] = Field(
        (),
        examples=[
            [{"position": [3.0, 4.0], "velocity": [0.1, 0.0], "active": [[0.0, 2.0], [4.0, 6.0]]}]
        ],
        description="Radars that move or switch, a table for each, beside those of `radars`; times "
        "are those of the clock, from 0.",
    )
    zone: Annotated[
        tuple[ZoneTable, ...],
        Field(max_length=MOST_ZONES),
        Allowed(f"at most {MOST_ZONES} tables [[hazard.zone]]"),
    ] = Field(
        (),
        examples=[[{"center": [5.0, 1.0], "radius": 0.5, "rate": 20.0, "edge": 0.2}]],
        description="Discs and convex polygons that should not be entered, a table for each.",
    )
    core_radius: Positive | None = Field(
        None,
        examples=[0.01],
        description="Distance to a radar, and between members that collide, below which the rates "
        "are continued smoothly to finite values, in units of length; target.radius / 50 by "
        "default.",
    )
    alpha_1: Positive | None = Field(
        None,
        examples=[4.0],
        description="Rate of a radar at distance 1, in squared length per time.",
    )
    alpha_2: NotNegative | None = Field(
        None,
        examples=[3.0],
        description="Strength of the mutual protection of near members; 0 is none.",
    )
    alpha_3: Positive | None = Field(
        None,
        examples=[4.0],
        description="Range of the mutual protection: half the effect at distance "
        "1 / sqrt(alpha_3). In units of 1 / length^2.",
    )
    beta_1: Positive | None = Field(
        None,
        examples=[0.1],
        description="Distance of two members at which they collide at rate 1, in units of length; "
        "'saturation+collision' only.",
    )
    beta_2: Positive | None = Field(
        None,
        examples=[4.0],
        description="Exponent of the collision rate (beta_1 / distance)^beta_2; "
        "'saturation+collision' only.",
    )
    parameters: Annotated[
        Mapping[str, Any],
        PlainValidator(_checked_parameters),
        WithJsonSchema({"type": "object"}),
        Allowed(PARAMETERS),
    ] = Field(
        default_factory=dict,
        examples=[{"strength": 0.8}],
        description="Keyword arguments of a 'module:function'; lists arrive there as tuples.",
    )

    def __hash__(self) -> int:
        """Hash of all but the parameters, which are a mapping."""
        return hash(
            tuple(getattr(self, key) for key in type(self).model_fields if key != "parameters")
        )

    @property
    def given(self) -> dict[str, Any]:
        """Values of the keys of `HazardKeys` that have one."""
        values = {key: getattr(self, key) for key in HazardKeys.model_fields}
        return {key: value for key, value in values.items() if value not in (None, (), {})}


class HazardCase(HazardKeys):
    """A hazard that may be the true one: keys that differ from those of ``[hazard]``."""

    weight: NotNegative = Field(
        1.0, description="Prior weight of the case; weights are normalised."
    )


class HazardTable(HazardKeys):
    """Destruction rates of members: their kind, radars and constants."""

    kind: Kind = Field(description=_KIND)
    case: Annotated[
        tuple[HazardCase, ...],
        Field(max_length=MOST_CASES),
        Allowed(f"2 to {MOST_CASES} tables [[hazard.case]]"),
    ] = Field(
        (),
        examples=[[{"radars": [[2.0, 3.0]]}, {"radars": [[-2.0, 3.0]], "weight": 2.0}]],
        description="Hazards of which one is the true one, and nobody knows which, a table for "
        "each: its weight, and the keys of [hazard] that differ.",
    )

    @property
    def cases(self) -> tuple[HazardTable, ...]:
        """The table of every case; itself without cases."""
        if not self.case:
            return (self,)
        return tuple(HazardTable.model_construct(**self.given | one.given) for one in self.case)

    @property
    def is_custom(self) -> bool:
        """True if the rates are a function of the user."""
        return not isinstance(self.kind, str) or self.kind not in CONSTANTS

    @property
    def is_named_by_file(self) -> bool:
        """True if the rates are a function that a file names, not one that a caller passed."""
        named = isinstance(self.kind, str) and not isinstance(self.kind, FunctionName)
        return named and self.is_custom

    @property
    def starts(self) -> tuple[tuple[float, float], ...]:
        """Positions of all radars at time 0."""
        return (*self.radars, *(radar.start for radar in self.radar))

    @property
    def regions(self) -> tuple[Zone, ...]:
        """The zones as hazards take them."""
        return tuple(table.zone for table in self.zone)

    def build(self, core_radius: float, folder: Path | None = None, dt: float = 1.0) -> Hazard:
        """Hazard that the table describes; a ``module:function`` lies in `folder`.

        `dt` is the length of a step.
        """
        # imported here, since importing CasADi is slow and listing scenarios needs no hazards
        from ..hazard import CustomHazard, HazardInTime, Saturation, SaturationCollision
        from ..hazard.custom import user_hazard

        if not isinstance(self.kind, str) or self.is_custom:
            beside = None if isinstance(self.kind, FunctionName) else folder
            rates = user_hazard(self.kind, beside, self.radars, dict(self.parameters))
            if not isinstance(rates, CustomHazard) or "time" in self.parameters:
                return rates
            return HazardInTime(rates, (), dt) if "time" in dict(rates.parameters) else rates
        constants = {key: getattr(self, key) for key in CONSTANTS[self.kind]}
        constants |= {"core_radius": core_radius, "zones": self.regions}
        hazard = SaturationCollision if self.kind == "saturation+collision" else Saturation
        if not self.radar:
            return hazard(radars=self.radars, strengths=self.strengths, **constants)
        moving = tuple(radar.track for radar in self.radar if radar.changes)
        still = [radar for radar in self.radar if not radar.changes]
        radars = *self.radars, *(radar.start for radar in still)
        own = self.strengths or (1.0,) * len(self.radars)
        strengths = *own, *(radar.strength for radar in still)
        if not moving:
            return hazard(radars=radars, strengths=strengths, **constants)
        base = hazard(
            radars=(*radars, *(track.position_at(0.0) for track in moving)),
            strengths=(*strengths, *(track.strength for track in moving)),
            **constants,
        )
        return HazardInTime(base, moving, dt)

    @model_validator(mode="after")
    def _fits_its_kind(self) -> HazardTable:
        require_none(of_cases(self, lambda table: table._problems()))
        require_none(self._weight_problems())
        return self

    def _problems(self) -> Iterator[str]:
        return self._misplaced_keys() if self.is_custom else self._kernel_problems()

    def _weight_problems(self) -> Iterator[str]:
        if len(self.case) == 1:
            yield "hazard.case is a single table, so nothing is unknown: write its keys in [hazard]"
        elif self.case and not sum(case.weight for case in self.case) > 0:
            yield "hazard.case has weights that are all 0; give one of them a positive weight"

    def _misplaced_keys(self) -> Iterator[str]:
        if self.zone:
            yield (
                "hazard.zone is not a key of a 'module:function' kind; add the rates of zones in "
                "the function"
            )
        if self.radar:
            yield (
                "hazard.radar is not a key of a 'module:function' kind; give the function an "
                "argument time, and write radars at rest as hazard.radars"
            )
        for key in ("strengths", "core_radius", *ALPHAS, *BETAS):
            if getattr(self, key) is not None:
                hint = f"hazard.parameters.{key} if your function takes it, else remove it"
                yield f"hazard.{key} is not a key of a 'module:function' kind; write it as {hint}"

    def _kernel_problems(self) -> Iterator[str]:
        kind, k = str(self.kind), len(self.radars)
        for key in CONSTANTS[kind]:
            if getattr(self, key) is None:
                needed = allowed(fields(type(self))[key])
                yield f"hazard.{key} is missing; kind '{kind}' needs it: {needed}"
        for key in BETAS:
            if key not in CONSTANTS[kind] and getattr(self, key) is not None:
                yield (
                    f"hazard.{key} is not a key of kind '{kind}'; remove it, "
                    "or choose kind 'saturation+collision'"
                )
        if self.parameters:
            yield (
                f"hazard.parameters is not a key of kind '{kind}'; "
                "remove it, or give the name of your function as the kind"
            )
        for index, radar in enumerate(self.radar):
            yield from radar.problems(f"hazard.radar[{index}]")
        for index, zone in enumerate(self.zone):
            yield from zone.problems(f"hazard.zone[{index}]")
        if not (k or self.radar or self.zone):
            yield (
                f"hazard.radars is missing or empty; kind '{kind}' needs [x, y] pairs, at least one"
            )
        elif self.strengths is not None and len(self.strengths) != k:
            yield (
                f"hazard.strengths has {counted(len(self.strengths), 'number')} for "
                f"{counted(k, 'radar')}; give one for each radar, or omit it"
            )


def of_cases(
    hazard: HazardTable, problems: Callable[[HazardTable], Iterator[str]]
) -> Iterator[str]:
    """Problems of the table of every case, each once, with the names of the keys of the case."""
    seen = set()
    for index, table in enumerate(hazard.cases):
        own = "|".join(hazard.case[index].given) if hazard.case else ""
        for message in problems(table):
            name = rf"hazard.case[{index}].\1"
            text = re.sub(rf"\bhazard\.({own})\b", name, message) if own else message
            if text not in seen:
                seen.add(text)
                yield text
