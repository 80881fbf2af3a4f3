"""The hazard table of a scenario, and the hazard that it stands for."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from pydantic import Field, PlainValidator, WithJsonSchema, model_validator

from .._util.constants import CORE_RADIUS
from .fields import LARGEST, Allowed, NotNegative, Point, Positive
from .kinds import ALPHAS, BETAS, CONSTANTS, KINDS, PARAMETERS, checked_kind, checked_parameters
from .sections import Table
from .validation import allowed, fields, wrong

if TYPE_CHECKING:
    from ..hazard import Hazard

_LARGEST_DECADE = 150  # a rate's square is a double still


class HazardTable(Table):
    """The rates at which members are destroyed: their kind, its radars and its constants."""

    kind: Annotated[
        str | Callable[..., Any],
        PlainValidator(checked_kind),
        WithJsonSchema({"type": "string"}),
        Allowed(KINDS),
    ] = Field(
        description="'saturation' (Scenario I of the paper), 'saturation+collision' (Scenario II), "
        "or 'module:function', a function (or a class derived from Hazard) of your own; the "
        "module is looked for in the folder of the scenario file first."
    )
    radars: Annotated[
        tuple[Point, ...], Allowed("a list of [x, y] pairs of numbers, one for each radar")
    ] = Field((), description="Positions [x, y] of the k radars, in units of length.")
    strengths: (
        Annotated[
            tuple[Positive, ...],
            Allowed(f"a list of numbers above 0 (at most {LARGEST:g}), one for each radar"),
        ]
        | None
    ) = Field(
        None, description="Factors of the radars' rates, one for each radar; all 1 by default."
    )
    alpha_1: Positive | None = Field(
        None, description="Rate of a radar at distance 1, in squared length per time."
    )
    alpha_2: NotNegative | None = Field(
        None, description="How much near members protect each other; 0 is not at all."
    )
    alpha_3: Positive | None = Field(
        None,
        description="How near members must be to protect each other: half the effect at distance "
        "1 / sqrt(alpha_3). In units of 1 / length^2.",
    )
    beta_1: Positive | None = Field(
        None,
        description="Distance of two members at which they collide at rate 1, in units of length; "
        "'saturation+collision' only.",
    )
    beta_2: Positive | None = Field(
        None,
        description="Exponent of the collision rate (beta_1 / distance)^beta_2; "
        "'saturation+collision' only.",
    )
    parameters: Annotated[
        Mapping[str, Any],
        PlainValidator(checked_parameters),
        WithJsonSchema({"type": "object"}),
        Allowed(PARAMETERS),
    ] = Field(
        default_factory=dict,
        description="Keyword arguments of a 'module:function'; lists arrive there as tuples.",
    )

    def __hash__(self) -> int:
        """Hash of all but the parameters, which are a mapping."""
        return hash(
            tuple(getattr(self, key) for key in type(self).model_fields if key != "parameters")
        )

    @property
    def is_custom(self) -> bool:
        """Whether the rates are a function of the user's own."""
        return not isinstance(self.kind, str) or self.kind not in CONSTANTS

    def build(self, folder: Path | None = None) -> Hazard:
        """Hazard that the table stands for.

        Parameters
        ----------
        folder : Path, optional
            Where the module of a ``module:function`` is looked for first.

        Raises
        ------
        HazardError
            A function that cannot be imported, or that does not work.
        """
        # CasADi takes its time to import, and listing scenarios needs no hazards
        from ..hazard import Saturation, SaturationCollision
        from ..hazard.custom import user_hazard

        if not isinstance(self.kind, str) or self.is_custom:
            return user_hazard(self.kind, folder, self.radars, dict(self.parameters))
        constants = {key: getattr(self, key) for key in CONSTANTS[self.kind]}
        hazard = SaturationCollision if self.kind == "saturation+collision" else Saturation
        return hazard(radars=self.radars, strengths=self.strengths, **constants)

    @model_validator(mode="after")
    def _fits_its_kind(self) -> HazardTable:
        lines = self._misplaced_keys() if self.is_custom else self._kernel_problems()
        if lines:
            raise wrong(lines)
        return self

    def _misplaced_keys(self) -> list[str]:
        return [
            f"hazard.{key} is no key of a 'module:function' kind; "
            f"write it as hazard.parameters.{key}"
            for key in ("strengths", *ALPHAS, *BETAS)
            if getattr(self, key) is not None
        ]

    def _kernel_problems(self) -> list[str]:
        kind = str(self.kind)
        known = fields(type(self))
        lines = [
            f"hazard.{key} is missing; kind '{kind}' needs it: {allowed(known[key])}"
            for key in CONSTANTS[kind]
            if getattr(self, key) is None
        ]
        lines += [
            f"hazard.{key} is no key of kind '{kind}'; remove it, "
            "or choose kind 'saturation+collision'"
            for key in BETAS
            if key not in CONSTANTS[kind] and getattr(self, key) is not None
        ]
        if self.parameters:
            lines.append(
                f"hazard.parameters is no key of kind '{kind}'; "
                "remove it, or name a function of yours as the kind"
            )
        return lines + self._radar_problems() + self._overflow_problems()

    def _radar_problems(self) -> list[str]:
        k = len(self.radars)
        if not k:
            words = "[x, y] pairs, at least one"
            return [f"hazard.radars is missing or empty; kind '{self.kind}' needs {words}"]
        if self.strengths is not None and len(self.strengths) != k:
            given = f"{len(self.strengths)} numbers for {k} radars"
            return [f"hazard.strengths has {given}; give one for each radar, or leave it out"]
        return []

    def _overflow_problems(self) -> list[str]:
        if self.beta_1 is None or self.beta_2 is None:
            return []
        if self.beta_2 * math.log10(math.sqrt(2) * self.beta_1 / CORE_RADIUS) <= _LARGEST_DECADE:
            return []
        return [
            f"hazard.beta_2 is {self.beta_2:g} with beta_1 = {self.beta_1:g}: the rate of members "
            f"that touch exceeds 1e{_LARGEST_DECADE}; lower one of them"
        ]
