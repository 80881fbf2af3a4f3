"""The scenario: everything that a plan or a simulation starts from."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray
from pydantic import Field, PrivateAttr, ValidationError, ValidationInfo, model_validator

from ..errors import ScenarioError
from . import consistency
from .fields import Allowed, Text, plain
from .hazard_section import HazardTable
from .sections import FormationOptions, GuideOptions, Swarm, Table, Target, Time
from .toml import annotated, toml_text
from .validation import known_keys, problems, report, shown, unknown_key, wrong

if TYPE_CHECKING:
    from ..hazard import Hazard

_LONE_MARGIN = 1e-6  # of the radius: rounding must not leave the last step outside the zone
_PARAMETERS = "hazard.parameters."


class Scenario(Table):
    """A swarm, its target, the clock, the hazard, and the options of the paper's two problems.

    Immutable; `with_values` and `with_hazard` return changed copies. Equal scenarios have equal
    values, wherever they came from. Scenarios pickle.

    Raises
    ------
    ScenarioError
        Keys that are missing, unknown or wrong, or that contradict each other; a line for each.
    """

    name: Annotated[
        str,
        Field(strict=True, max_length=100, pattern=r"^\w[^\x00-\x1f\x7f-\x9f/\\]*$"),
        Allowed(
            "a text of 1 to 100 characters, without slashes, that starts with a letter or digit"
        ),
    ] = Field(description="Name of the scenario, used in tables and for folders.")
    description: Text = Field("", description="What the scenario shows, in a line.")
    swarm: Swarm = Field(description="The members.")
    target: Target = Field(description="The target zone.")
    time: Time = Field(description="The clock.")
    hazard_table: HazardTable = Field(
        alias="hazard", description="The rates at which members are destroyed."
    )
    guide: GuideOptions = Field(
        default_factory=GuideOptions, description="How the guide is searched for."
    )
    formation: FormationOptions = Field(
        default_factory=FormationOptions,
        description="How the formation around the guide is searched for.",
    )

    _folder: Path | None = PrivateAttr(None)

    @model_validator(mode="after")
    def _fits_together(self, info: ValidationInfo) -> Scenario:
        self._folder = (info.context or {}).get("folder")
        lines = [
            *consistency.start_problems(self.swarm, self.target, self.hazard_table),
            *consistency.way_problems(self.swarm, self.target, self.time),
            *consistency.margin_problems(self.guide, self.target),
            *consistency.custom_hazard_problems(self.swarm, self.hazard_table, self._folder),
        ]
        if lines:
            raise wrong(lines)
        return self

    @classmethod
    def from_data(
        cls, data: Mapping[str, object], *, source: str = "scenario", folder: Path | None = None
    ) -> Scenario:
        """Scenario of nested tables, as a file holds them.

        Parameters
        ----------
        data : mapping
            Keys and tables, named as in a scenario file.
        source : str
            What error messages call the scenario, for example its file.
        folder : Path, optional
            Where the module of a ``module:function`` hazard is looked for first.

        Raises
        ------
        ScenarioError
            A line for everything that is wrong.
        """
        try:
            return cls.model_validate(plain(data), context={"folder": folder})
        except ValidationError as error:
            raise ScenarioError(report(f"{source} is wrong", problems(error, cls))) from None

    @property
    def n(self) -> int:
        """Number of members."""
        return len(self.swarm.positions)

    @property
    def n_steps(self) -> int:
        """Number of whole steps until t_f, floor(t_f / dt)."""
        return self.time.steps

    @cached_property
    def positions(self) -> NDArray[np.float64]:
        """Initial positions of the members, shape (n, 2), read-only."""
        return _read_only(self.swarm.positions)

    @cached_property
    def guide_start(self) -> NDArray[np.float64]:
        """Where the guide starts, shape (2,), read-only: at the member nearest to the centroid."""
        return _read_only(self.swarm.positions[self.swarm.central_member])

    @property
    def guide_a_max(self) -> float:
        """Bound on the guide's ||V(t) - V(t-1)||^2; infinite if it need not be acceleration_limited."""
        if not self.guide.acceleration_limited:
            return math.inf
        return self.swarm.a_max if self.guide.a_max is None else self.guide.a_max

    @property
    def arrival_margin(self) -> float:
        """How deep inside the target zone the guide must arrive."""
        if self.guide.margin is not None:
            return self.guide.margin
        if self.n == 1:
            return _LONE_MARGIN * self.target.radius
        return min(math.sqrt(self.formation.rho), self.target.radius / 2)

    @cached_property
    def hazard(self) -> Hazard:
        """The rates at which members are destroyed."""
        return self.hazard_table.build(self._folder)

    def with_values(self, values: Mapping[str, object]) -> Scenario:
        """Copy of the scenario with other values, checked again.

        Parameters
        ----------
        values : mapping
            New values by dotted key, for example ``{"formation.rho": 0.1, "swarm.a_max": 1.0}``,
            or whole tables, ``{"target": {...}}``. None leaves a key out.

        Raises
        ------
        ScenarioError
            Unknown keys, or values that are wrong, alone or together.

        Examples
        --------
        >>> import casswarm as csw
        >>> wide = csw.load_scenario("paper-1").with_values({"formation.rho": 0.1})
        >>> wide.formation.rho
        0.1
        """
        known = known_keys(type(self))
        unknown = [key for key in values if key not in known and not key.startswith(_PARAMETERS)]
        if unknown:
            lines = [unknown_key(key, type(self)) for key in unknown]
            raise ScenarioError(report(f"scenario '{self.name}' has no such key", lines))
        data = self._data()
        for key, value in values.items():
            _set(data, key, plain(value))
        source = f"scenario '{self.name}' with new values"
        return self.from_data(data, source=source, folder=self._folder)

    def with_hazard(
        self,
        function: str | Callable[..., Any],
        /,
        *,
        radars: ArrayLike | Sequence[tuple[float, float]] = (),
        **parameters: object,
    ) -> Scenario:
        """Copy of the scenario with a hazard of the user's own.

        Parameters
        ----------
        function : callable, or str ``module:function``
            The rates, as `casswarm.hazard.CustomHazard` takes them; or a class derived from
            `casswarm.hazard.Hazard`, made of the radars and parameters.
        radars : k pairs (x, y), optional
            Drawn on maps, and handed to the function as ``radars=`` if given.
        **parameters
            Further keyword arguments of the function.

        Raises
        ------
        ScenarioError
            The function fails at the initial state.

        Notes
        -----
        A function that can be imported again is stored by its name. Any other, such as a lambda,
        works too, but its scenario cannot be saved, and pickles only if the function does.
        """
        table = {"kind": function, "radars": radars, "parameters": parameters}
        return self.from_data(
            {**self._data(), "hazard": table},
            source=f"scenario '{self.name}' with a new hazard",
            folder=self._folder,
        )

    def to_toml(self, comments: bool = False) -> str:
        """Text of a scenario file; loading it gives an equal scenario.

        Parameters
        ----------
        comments : bool
            Whether to say above every key what it means.

        Raises
        ------
        ScenarioError
            The hazard is a function that no file can name.
        """
        text = toml_text(self._data())
        return annotated(text, type(self)) if comments else text

    def model_copy(
        self, *, update: Mapping[str, Any] | None = None, deep: bool = False
    ) -> Scenario:
        """Copy with other fields; unlike pydantic's, the copy is checked and derives all anew."""
        if not update:
            return super().model_copy(deep=deep)
        fields = {name: getattr(self, name) for name in type(self).model_fields} | dict(update)
        fields["hazard"] = fields.pop("hazard_table")
        return self.from_data(fields, folder=self._folder)

    def _data(self) -> dict[str, Any]:
        data = self.model_dump(by_alias=True, exclude_none=True)
        data["hazard"] = {
            key: value for key, value in data["hazard"].items() if value not in ((), {})
        }
        return data

    def _values(self) -> tuple[object, ...]:
        return tuple(getattr(self, name) for name in type(self).model_fields)

    def __eq__(self, other: object) -> bool:
        """Equality of all values; the folder a scenario came from is none of them."""
        return self._values() == other._values() if isinstance(other, Scenario) else NotImplemented

    def __hash__(self) -> int:
        return hash(self._values())

    def __getstate__(self) -> dict[Any, Any]:
        # what is derived is derived again: a hazard may hold what does not pickle
        state = super().__getstate__()
        values = {name: state["__dict__"][name] for name in type(self).model_fields}
        return {**state, "__dict__": values}

    def __repr__(self) -> str:
        kind = self.hazard_table.kind
        return (
            f"<Scenario '{self.name}': {self.n} members, {len(self.hazard_table.radars)} radars, "
            f"{kind if isinstance(kind, str) else 'custom'} hazard, {self.n_steps} steps>"
        )

    __str__ = __repr__


def _read_only(values: object) -> NDArray[np.float64]:
    array = np.array(values, dtype=float)
    array.flags.writeable = False
    return array


def _set(data: dict[str, Any], key: str, value: object) -> None:
    """Put a value at a dotted key of nested tables; None takes the key away."""
    if key.startswith(_PARAMETERS):  # whose names may hold dots
        tables, leaf = ["hazard", "parameters"], key.removeprefix(_PARAMETERS)
    else:
        *tables, leaf = key.split(".")
    table = data
    for name in tables:
        table = table.setdefault(name, {})
        if not isinstance(table, dict):
            line = (
                f"{key} cannot be set: {name} was given as {shown(table)}, not as a table of keys"
            )
            raise ScenarioError(report("values that do not fit together", [line]))
    table.pop(leaf, None)
    if value is not None:
        table[leaf] = value
