"""The scenario, input of every plan and simulation."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from functools import cached_property
from numbers import Integral
from pathlib import Path
from typing import TYPE_CHECKING, Any, Unpack, cast

import numpy as np
from numpy.typing import ArrayLike
from pydantic import Field, PrivateAttr, ValidationError, ValidationInfo, model_validator

from .._util.display import Displayed
from .._util.text import counted, shown
from ..typing import FloatArray
from .cases import Case, cases_of, mean_table, radars_text, require_known, weighted
from .consistency import contradictions, core_radius, in_reach
from .hazard_table import HazardTable
from .members import most_favourable, with_accelerations, with_equal_members
from .sections import (
    Changes,
    Disc,
    FormationOptions,
    GuideOptions,
    Information,
    Success,
    Swarm,
    Target,
    Time,
)
from .toml_text import annotated, toml_text
from .validation import (
    KINDS_PREFIX,
    NO_SUCH_KEY,
    PARAMETER_PREFIX,
    Name,
    Table,
    Text,
    known_keys,
    problems_of,
    require_none,
    scenario_error,
    set_value,
    to_plain,
    unknown_key,
)

if TYPE_CHECKING:
    from ..hazard import Hazard

_MAP_PAD = 0.06  # of the larger side of a map, beyond the target's radius
_SINGLE_MARGIN = 1e-6  # of the radius: rounding must not leave the last step outside the zone


class Scenario(Displayed, Table):
    """A swarm, its target, the clock, the hazard, and the options of the paper's two problems.

    Immutable; `replace`, `with_values` and `with_hazard` return changed copies. Scenarios with the
    same values are equal. Scenarios can be pickled.

    Raises
    ------
    ScenarioError
        Keys that are missing, unknown or invalid, or that contradict each other; a line for each.
    """

    name: Name = Field(description="Name of the scenario, used in tables and for folders.")
    description: Text = Field("", description="What the scenario shows, in one line.")
    swarm: Swarm = Field(description="Members.")
    target: Target = Field(description="Target zone.")
    time: Time = Field(description="Clock.")
    success: Success = Field(default_factory=Success, description="When a run is a success.")
    information: Information = Field(
        default_factory=Information, description="When members learn of losses."
    )
    hazard_table: HazardTable = Field(alias="hazard", description="Destruction rates of members.")
    guide: GuideOptions = Field(
        default_factory=GuideOptions, description="Options of the guide problem."
    )
    formation: FormationOptions = Field(
        default_factory=FormationOptions, description="Options of the formation problem."
    )
    _context: dict[str, Any] = PrivateAttr({})  # folder and allow_code of `from_data`

    @model_validator(mode="before")
    @classmethod
    def _with_one_target(cls, data: Any) -> Any:
        """Several tables [[target]] as one with others."""
        targets = data.get("target") if isinstance(data, dict) else None
        if isinstance(targets, list) and targets and isinstance(targets[0], dict):
            data = data | {"target": {**targets[0], "other": targets[1:]}}
        return data

    @model_validator(mode="after")
    def _fits_together(self, info: ValidationInfo) -> Scenario:
        self._context = info.context or {}
        require_none(contradictions(self, **self._context))
        return self

    @classmethod
    def from_data(
        cls,
        data: Mapping[str, object],
        *,
        source: str = "scenario",
        folder: Path | None = None,
        allow_code: bool = False,
    ) -> Scenario:
        """Scenario from nested tables with the keys of a scenario file.

        Parameters
        ----------
        data : mapping
            Keys and tables.
        source : str
            Name of the scenario in error messages, for example its file.
        folder : Path, optional
            Folder of the scenario file, in which the module of a ``module:function`` lies.
        allow_code : bool
            Whether a ``module:function`` may be imported and called.

        Raises
        ------
        ScenarioError
            Invalid values, a line for each.
        """
        try:
            context = {"folder": folder, "allow_code": allow_code}
            return cls.model_validate(to_plain(data), context=context)
        except (ValidationError, RecursionError) as error:
            raise scenario_error(f"{source} is invalid", problems_of(error, cls)) from None

    @property
    def n(self) -> int:
        """Number of members."""
        return len(self.swarm.positions)

    @property
    def n_steps(self) -> int:
        """Number of whole steps until t_f, floor(t_f / dt)."""
        return self.time.steps

    @property
    def delay(self) -> int | None:
        """Number of steps after which losses are known; None if they are never known in a run."""
        delay = self.information.delay
        return None if delay == "never" or delay >= self.n_steps else delay

    @cached_property
    def positions(self) -> FloatArray:
        """Initial positions of the members, shape (n, 2), read-only."""
        return _read_only(self.swarm.positions)

    @cached_property
    def guide_start(self) -> FloatArray:
        """Start of the guide, shape (2,), read-only: the member nearest to the centroid."""
        return _read_only(self.swarm.positions[self.swarm.central_member])

    def of_members(self, rows: Sequence[int]) -> Scenario:
        """The scenario with some of its members, in a given order, as if there were no others.

        Whether they can arrive, and are enough for a success, is not checked.
        """
        return self._constructed(swarm=self.swarm.of_rows(rows))

    def _constructed(self, **tables: Table) -> Scenario:
        """A copy with other tables, which is not validated."""
        fields = {name: getattr(self, name) for name in type(self).model_fields}
        other = type(self).model_construct(**fields | tables)
        other._context = self._context
        return other

    @cached_property
    def for_guide(self) -> Scenario:
        """The scenario with equal members for which guides are planned; itself without kinds.

        Its members are those that count, all of the kind of the member where the guide starts.
        """
        return self.with_kind_of(self.swarm.central_member)

    def with_kind_of(self, member: int) -> Scenario:
        """The scenario with its members that count, all of one's kind; itself without kinds."""
        if self.swarm.kind is None:
            return self
        rows = np.flatnonzero(self.swarm.counting)
        return with_equal_members(self, self.swarm.member_kinds[member], rows.tolist())

    @cached_property
    def most_favourable(self) -> Scenario:
        """The scenario with equal members that are as fast and safe as any; itself without kinds.

        They have the least exposure, and the largest density, speed and acceleration of all kinds,
        and all of them count. In the same state, no member's rate is below that of such a member:
        bounds of success that use lower bounds of the rates in all states hold for both.
        """
        if self.swarm.kind is None:
            return self
        return with_equal_members(self, most_favourable(self.swarm.member_kinds), range(self.n))

    @property
    def guide_a_max(self) -> float:
        """Bound on the guide's ||V(t) - V(t-1)||^2; infinite without acceleration limits."""
        if not self.guide.acceleration_limited:
            return math.inf
        own = self.swarm.member_kinds[self.swarm.central_member].a_max or self.swarm.a_max
        return own if self.guide.a_max is None else self.guide.a_max

    @property
    def arrival_margin(self) -> float:
        """Distance inside the target zone at which the guide must arrive."""
        if self.guide.margin is not None:
            return self.guide.margin
        if self.n == 1:
            return _SINGLE_MARGIN * self.target.radius
        return min(math.sqrt(self.formation.rho), self.target.radius / 2)

    @cached_property
    def hazard(self) -> Hazard:
        """Destruction rates of the members, those of the only case.

        Raises
        ------
        ScenarioError
            Several cases.
        """
        require_known(self)
        table = self.hazard_table.cases[0]
        apart = core_radius(self.target, table)
        hazard = table.build(apart, self._context.get("folder"), self.time.dt)
        factors = [kind.factors for kind in self.swarm.member_kinds]
        if all(each == (1.0, 1.0) for each in factors):
            return hazard
        exposures, densities = zip(*factors, strict=True)
        return hazard.with_members(exposures, densities)

    @cached_property
    def cases(self) -> tuple[Case, ...]:
        """The distinct cases of the hazard, of which one is the true one; itself if it is known."""
        return cases_of(self)

    def with_hazard_table(self, table: HazardTable) -> Scenario:
        """The scenario with another hazard, which is not checked against the rest."""
        return self._constructed(hazard_table=table)

    @cached_property
    def believed(self) -> Scenario:
        """The scenario as those see it who know only the prior; itself if the hazard is known.

        Its rates are the prior means of those of the cases: see `of_mean_rates`.
        """
        if len(self.cases) == 1:
            return self
        return self.of_mean_rates([case.weight for case in self.cases])

    def with_prior(self, weights: ArrayLike) -> Scenario:
        """The scenario with other prior weights (K,) of its cases; itself if it has one.

        Cases of weight 0 are left out.
        """
        return self if len(self.cases) == 1 else self.with_hazard_table(weighted(self, weights))

    def of_mean_rates(self, weights: ArrayLike) -> Scenario:
        """The scenario with the weighted mean (K,) of the rates of its cases.

        It is of their kind if they differ in radars, zones, strengths and alpha_1 only.
        """
        return self.with_hazard_table(mean_table(self, weights))

    def replace(self, **tables: Unpack[Changes]) -> Scenario:
        """Copy of the scenario with other values in its tables, validated again.

        Parameters
        ----------
        swarm, target, time, success, information, hazard, guide, formation : mapping
            New values by key; the other keys of the table keep theirs. None omits a key.

        Raises
        ------
        ScenarioError
            Unknown keys, or values that are invalid, alone or together.

        Examples
        --------
        >>> import casswarm as csw
        >>> csw.load_scenario("paper-1").replace(guide={"arrival": "any"}).guide.arrival
        'any'
        """
        changes = cast(dict[str, dict[str, object]], tables)
        return self.with_values(
            {f"{table}.{key}": changes[table][key] for table in changes for key in changes[table]}
        )

    def with_values(self, values: Mapping[str, object]) -> Scenario:
        """Copy of the scenario with other values, validated again.

        Parameters
        ----------
        values : mapping
            New values by dotted key, for example ``{"formation.rho": 0.1, "swarm.a_max": 1.0}``,
            or whole tables, ``{"target": {...}}``. None omits a key.

        Raises
        ------
        ScenarioError
            Unknown keys, or values that are invalid, alone or together.

        Examples
        --------
        >>> import casswarm as csw
        >>> csw.load_scenario("paper-1").with_values({"formation.rho": 0.1}).formation.rho
        0.1
        """
        known, free = known_keys(type(self)), (PARAMETER_PREFIX, KINDS_PREFIX)
        problems = [
            unknown_key(key, type(self))
            for key in values
            if key not in known and not key.startswith(free)
        ]
        if problems:
            raise scenario_error(f"scenario '{self.name}' {NO_SUCH_KEY}", problems)
        data, source = self._data(), f"scenario '{self.name}' with new values"
        for key, value in values.items():
            set_value(data, key, to_plain(value))
        return self.from_data(data, source=source, **self._context)

    def refined(self, k: int) -> Scenario:
        """Copy of the scenario with time steps that are k times as fine.

        The members are the same: rates and speeds are per unit of time and keep their values, and
        the bounds `a_max` on the squared change of velocity per step are divided by k^2, so that
        the acceleration has the same limit. It has k times as many steps, to which t_f is shortened
        where a further one would fit in.

        Parameters
        ----------
        k : int
            From 1, which changes nothing.

        Raises
        ------
        ValueError
            `k` is no whole number from 1.
        ScenarioError
            There are more steps than are allowed.

        Examples
        --------
        >>> import casswarm as csw
        >>> fine = csw.load_scenario("paper-1").refined(2)
        >>> fine.n_steps, fine.swarm.a_max
        (60, 0.125)
        """
        if not isinstance(k, Integral) or isinstance(k, bool) or k < 1:
            raise ValueError(f"k = {shown(k)}; allowed: whole numbers from 1")
        k = int(k)
        dt, steps = self.time.dt / k, self.n_steps * k
        values: dict[str, object] = {"time.dt": dt}
        values |= with_accelerations(self.swarm, lambda a_max: a_max / k**2)
        if self.guide.a_max is not None:
            values["guide.a_max"] = self.guide.a_max / k**2
        if Time(dt=dt, t_f=self.time.t_f).steps != steps:
            values["time.t_f"] = dt * (steps + 0.5)
        return self.with_values(values)

    @cached_property
    def by_parts(self) -> Scenario:
        """The scenario whose steps are the parts of its steps; itself without ``time.substeps``.

        Its members may change their velocities after every part, within any limit, so what no path
        or policy exceeds there, none exceeds here.
        """
        parts = self.time.substeps
        return self if parts == 1 else self.with_values({"time.substeps": 1}).refined(parts)

    @cached_property
    def by_target(self) -> tuple[Scenario, ...]:
        """The scenario with each of the target zones that the guide can reach; itself if one."""
        if not self.target.other:
            return (self,)
        discs = self.target.discs
        return tuple(self._toward(d) for d in discs if in_reach(self.swarm, self.time, d))

    def _toward(self, disc: Disc) -> Scenario:
        """The scenario with one of its target zones only."""
        values: dict[str, object] = {"target.center": disc.center, "target.radius": disc.radius}
        values["target.other"] = None
        if not self.hazard_table.is_custom:
            values["hazard.core_radius"] = core_radius(self.target, self.hazard_table)
        return self.with_values(values)

    def rates_along(self, positions: FloatArray, step: int = 0) -> FloatArray:
        """Single-agent rates (T, ...) of the steps of paths (T+1, ..., 2) that begin at a step.

        Those at the end of every step; with ``time.substeps``, their means over its parts.
        """
        from ..hazard import mean_rates_along

        return mean_rates_along(self.by_parts.hazard, positions, self.time.substeps, step)

    def with_hazard(
        self,
        function: str | Callable[..., Any],
        /,
        *,
        radars: ArrayLike | Sequence[tuple[float, float]] = (),
        **parameters: object,
    ) -> Scenario:
        """Copy of the scenario with a hazard of the user.

        Parameters
        ----------
        function : callable, or str ``module:function``
            Rates as in `casswarm.hazard.CustomHazard`, or a class derived from
            `casswarm.hazard.Hazard`, which is called with the radars and parameters. A name is
            searched for beside the scenario's file; without a file it is imported as usual.
        radars : k pairs (x, y), optional
            Drawn on maps, and passed to the function as ``radars=`` if given.
        **parameters
            Further keyword arguments of the function.

        Raises
        ------
        ScenarioError
            The function fails at the initial state.

        Notes
        -----
        A function that can be imported is stored by its name. Other functions, such as lambdas,
        work too, but their scenarios cannot be saved, and can be pickled only if the function can.
        """
        hazard = {"kind": function, "radars": radars, "parameters": parameters}
        data, context = self._data() | {"hazard": hazard}, self._context | {"allow_code": True}
        return self.from_data(data, source=f"scenario '{self.name}' with new rates", **context)

    def to_toml(self, comments: bool = False) -> str:
        """Text of a scenario file; loading it gives an equal scenario.

        Parameters
        ----------
        comments : bool
            Whether to describe every key in a comment.

        Raises
        ------
        ScenarioError
            The hazard is a function that cannot be named in a file.
        """
        text = toml_text(self._data())
        return annotated(text, type(self)) if comments else text

    def model_copy(
        self, *, update: Mapping[str, Any] | None = None, deep: bool = False
    ) -> Scenario:
        """Copy with other fields; unlike pydantic's, the copy is validated."""
        if not update:
            return super().model_copy(deep=deep)
        fields = {name: getattr(self, name) for name in type(self).model_fields} | dict(update)
        fields["hazard"] = fields.pop("hazard_table")
        return self.from_data(fields, **self._context)

    def extent(self, contents: Sequence[FloatArray] = ()) -> tuple[FloatArray, FloatArray]:
        """Corners (2,), low and high, of a map with the target, the radars and all `contents`.

        These are points (m, 2); the map has a margin around them.
        """
        center = np.array([disc.center for disc in self.target.discs])
        tables, scenarios = self.hazard_table.cases, [case.scenario for case in self.cases]
        zones = [zone.corners for table in tables for zone in table.zone]
        radars = [each.hazard.radar_positions.reshape(-1, 2) for each in scenarios]
        radars += [path for each in scenarios for path in each._radar_paths]
        points = np.vstack([*contents, center, *radars, *zones])
        low, high = points.min(axis=0), points.max(axis=0)
        pad = _MAP_PAD * float(np.max(high - low)) + self.target.radius
        return low - pad, high + pad

    @cached_property
    def _radar_paths(self) -> list[FloatArray]:
        """Positions of the radars after every step, where they move."""
        moves = self.hazard.changes and self.hazard_table.cases[0].radar
        steps = range(1, self.n_steps + 1) if moves else ()
        return [self.hazard.after(step).radar_positions for step in steps]

    def _data(self) -> dict[str, Any]:
        data = self.model_dump(by_alias=True, exclude_none=True)
        for name in ("swarm", "target", "hazard"):
            given = data[name].items()
            data[name] = {key: value for key, value in given if value not in ((), {})}
        for case in data["hazard"].get("case", ()):
            for key in [key for key, value in case.items() if value in ((), {})]:
                del case[key]
        return data

    def _values(self) -> tuple[object, ...]:
        return tuple(getattr(self, name) for name in type(self).model_fields)

    def __eq__(self, other: object) -> bool:
        """Equality of all values; the folder of the scenario's file does not count."""
        return self._values() == other._values() if isinstance(other, Scenario) else NotImplemented

    def __hash__(self) -> int:
        return hash(self._values())

    def __getstate__(self) -> dict[Any, Any]:
        # derived attributes are computed again: a hazard may not be picklable
        state = super().__getstate__()
        values = {name: state["__dict__"][name] for name in type(self).model_fields}
        return {**state, "__dict__": values}

    def __repr__(self) -> str:
        table = self.hazard_table
        kind = table.kind if isinstance(table.kind, str) else "custom"
        size = f"{counted(self.n, 'member')}, {radars_text(table)}, {kind} hazard"
        return f"<Scenario '{self.name}': {size}, {counted(self.n_steps, 'step')}>"

    __str__ = __repr__


def _read_only(values: object) -> FloatArray:
    array = np.array(values, dtype=float)
    array.flags.writeable = False
    return array
