"""Tables of a scenario file: every key with its unit and limits, the hazard table, their text."""

from __future__ import annotations

import math
import re
import textwrap
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from pkgutil import resolve_name
from typing import TYPE_CHECKING, Annotated, Any, Literal, TypedDict

import numpy as np
import tomli_w
from numpy.typing import NDArray
from pydantic import (
    BaseModel,
    Field,
    PlainValidator,
    WithJsonSchema,
    model_validator,
)
from pydantic.fields import FieldInfo

from .._util.text import counted, suggestion
from ..errors import ScenarioError
from ..typing import LeaderSelection
from .radars import MOST_RADARS, Radar
from .validation import (
    LARGEST,
    Allowed,
    Boolean,
    Count,
    NotNegative,
    Number,
    Point,
    Positive,
    Problem,
    Table,
    allowed,
    as_text,
    element_table,
    field_of,
    fields,
    invalid,
    require_none,
    subtable,
)

if TYPE_CHECKING:
    from ..hazard import Hazard


_STEP_TOLERANCE = 2.0**-50  # relative: t_f = 1.0 holds ten steps of dt = 0.1 despite rounding
_TIE_TOLERANCE = 1e-9  # relative: members equally far from the centroid up to rounding


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
    a_max: Positive = Field(
        description="Bound on the change of velocity in a step, ||V(t) - V(t-1)||^2, in squared "
        "units of velocity."
    )

    @property
    def central_member(self) -> int:
        """Index of the member nearest to the centroid; ties go to the lowest index."""
        positions = np.array(self.positions)
        offsets = positions - positions.mean(axis=0)
        distances = np.hypot(offsets[:, 0], offsets[:, 1])
        tolerance = _TIE_TOLERANCE * (distances.max() + np.abs(positions).max())
        return int(np.argmax(distances <= distances.min() + tolerance))


class Target(Table):
    """Target zone Z, a closed disc; a member that is in it alive has arrived."""

    center: Point = Field(description="Centre [x, y] of the target zone, in units of length.")
    radius: Positive = Field(description="Radius of the target zone, in units of length.")

    def distances(self, positions: NDArray[np.float64]) -> NDArray[np.float64]:
        """Distances of positions (..., 2) from the centre, shape (...)."""
        offsets = positions - np.array(self.center)
        return np.asarray(np.hypot(offsets[..., 0], offsets[..., 1]))

    def contains(self, positions: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Test if positions (..., 2) lie in the zone, shape (...)."""
        return np.asarray(self.distances(positions) <= self.radius)


class Success(Table):
    """Condition for the success of a run."""

    arrivals: Count = Field(
        1,
        description="Number of living members that must be in the target zone after the same step, "
        "at least.",
    )


class Time(Table):
    """Clock with steps of dt until t_f."""

    dt: Positive = Field(description="Length of a step, in units of time.")
    t_f: Positive = Field(description="Time at which a run ends at the latest, in units of time.")

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


class Changes(TypedDict, total=False):
    """New values of the tables of a scenario, by key."""

    swarm: Mapping[str, object]
    target: Mapping[str, object]
    time: Mapping[str, object]
    success: Mapping[str, object]
    hazard: Mapping[str, object]
    guide: Mapping[str, object]
    formation: Mapping[str, object]


ALPHAS = ("alpha_1", "alpha_2", "alpha_3")
BETAS = ("beta_1", "beta_2")
CONSTANTS = {"saturation": ALPHAS, "saturation+collision": ALPHAS + BETAS}
"""Constants that each built-in kind needs."""

KINDS = "'saturation', 'saturation+collision', or 'module:function'"
PARAMETERS = "a table of numbers, texts, true or false, or lists of these"

_NAME = re.compile(r"[^\W\d]\w*(\.[^\W\d]\w*)*:[^\W\d]\w*(\.[^\W\d]\w*)*")
_RESERVED = ("positions", "alive", "radars")  # arguments that every custom hazard gets


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


class HazardTable(Table):
    """Destruction rates of members: their kind, radars and constants."""

    kind: Annotated[
        str | Callable[..., Any],
        PlainValidator(_checked_kind),
        WithJsonSchema({"type": "string"}),
        Allowed(KINDS),
    ] = Field(
        description="'saturation' (Scenario I of the paper), 'saturation+collision' (Scenario II), "
        "or 'module:function', your own function (or class derived from Hazard) in a module beside "
        "the scenario file, which is run only with --allow-code or allow_code=True."
    )
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
        constants["core_radius"] = core_radius
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
        require_none(self._misplaced_keys() if self.is_custom else self._kernel_problems())
        return self

    def _misplaced_keys(self) -> Iterator[str]:
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
        if not k and not self.radar:
            yield (
                f"hazard.radars is missing or empty; kind '{kind}' needs [x, y] pairs, at least one"
            )
        elif self.strengths is not None and len(self.strengths) != k:
            yield (
                f"hazard.strengths has {counted(len(self.strengths), 'number')} for "
                f"{counted(k, 'radar')}; give one for each radar, or omit it"
            )


# tomli_w escapes line breaks in texts, so that a bracket before a line break opens an array
_SCALARS = re.compile(r"\[\n((?: +[^\[\]\"{},\n]+,\n)+) *\]")


def toml_text(data: Mapping[str, Any]) -> str:
    """Text of a scenario file with these tables, with a point per line."""
    hazard = data["hazard"]
    if callable(hazard["kind"]):
        try:
            kind = importable_name(hazard["kind"])
        except ScenarioError as error:
            raise ScenarioError(
                f"scenario '{data['name']}' cannot be saved: hazard.kind is a function that a file "
                f"cannot name as 'module:function': {error}; move it into a module",
                key="hazard.kind",
                value=repr(hazard["kind"]),
            ) from None
        data = {**data, "hazard": {**hazard, "kind": kind}}
    return _escaped(_SCALARS.sub(_on_one_line, tomli_w.dumps(data)))


def _escaped(text: str) -> str:
    """TOML whose strings hold no character that a terminal or an editor does not show as itself."""
    return "".join(c if c.isprintable() or c == "\n" else f"\\U{ord(c):08x}" for c in text)


def _on_one_line(array: re.Match[str]) -> str:
    items = (line.strip().removesuffix(",") for line in array[1].splitlines())
    return f"[{', '.join(items)}]"


def annotated(text: str, model: type[BaseModel]) -> str:
    """Text of a scenario file with comments: what every key is, and the keys that it leaves out."""
    table, known, missing = "", fields(model), dict[str, FieldInfo]()
    lines: list[str] = []
    for line in text.removesuffix("\n").split("\n"):  # texts may hold other line separators
        header = re.fullmatch(r"\[([\w.]+)\]|\[\[([\w.]+)\]\]", line)
        key = re.match(r"(\w+) = ", line)
        description: str | None = None
        if header:
            name = header[1] or header[2]
            missing.pop(name.removeprefix(f"{table}."), None)
            lines = _with_optional(lines, table, missing)
            again, table, field = name == table, name, field_of(name, model)
            inner = field and (subtable(field) or element_table(field))
            known = fields(inner) if inner else {}  # others are the user's
            missing, description = dict(known), field.description if field else None
            if again:  # the keys of the next element of a list of tables
                known, missing, description = {}, {}, None
        elif key and key[1] in known:
            missing.pop(key[1], None)
            description = known[key[1]].description
        lines += [*_comment(description or ""), line]
    return "\n".join(_with_optional(lines, table, missing)) + "\n"


def _with_optional(lines: list[str], table: str, missing: Mapping[str, FieldInfo]) -> list[str]:
    """Lines of a table, and the keys that it could also have, commented out."""
    optional: list[str] = []
    tables: list[str] = []  # last, since the keys that follow are theirs
    for key, field in missing.items():
        for example in field.examples or ():
            listed = isinstance(example, list) and isinstance(example[0], dict)
            nested = listed or isinstance(example, dict)
            text = tomli_w.dumps({table: {key: example}} if nested else {key: example})
            shown = _SCALARS.sub(_on_one_line, text).strip().split("\n")
            part = tables if nested else optional
            part += [*_comment(field.description or ""), *(f"# {line}" for line in shown)]
    end = len(lines) - (lines[-1:] == [""])  # the blank line before the next table
    return [*lines[:end], *optional, *tables, *lines[end:]]


def _comment(text: str) -> list[str]:
    return [f"# {part}" for part in textwrap.wrap(text, 96)]
