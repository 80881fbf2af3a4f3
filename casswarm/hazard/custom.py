"""Custom rates: any CasADi function of all positions, and hazards that a scenario names."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from importlib.metadata import EntryPoint, entry_points
from inspect import signature
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np

from .._util.text import counted, shown
from .._util.threads import locked_cache
from .._util.user_code import USER_ERRORS, failure_text, is_defined_in, load, module_file
from ..errors import HazardError
from ..typing import BoolArray, Expr, FloatArray
from .base import Hazard, checked_radars

_CHUNK = 256  # states a call of the mapped function takes
_CHECKED_BOXES, _CHECKED_POINTS = 128, 1024  # at which a user's lower bounds are checked


@dataclass(frozen=True)
class CustomHazard(Hazard):
    """Rates from a user's function.

    Parameters
    ----------
    function : callable
        ``function(positions, alive, **parameters)`` with CasADi expressions: `positions` (n, 2),
        `alive` (n, 1), 1 for the living; returns n rates per unit time, shape (n, 1) or (1, n).
        It must work for every n >= 1 and be smooth where it is optimised: squared distances
        rather than ``norm_2``, whose derivative at zero is NaN.
    radars : k pairs (x, y), optional
        Drawn on maps and used to find paths; passed to the function as ``radars=`` if given.
    parameters : mapping, optional
        Further keyword arguments; lists become tuples.
    lower_bound : callable, optional
        ``lower_bound(lower, upper, **parameters)`` with NumPy arrays, the corners (..., 2) of
        boxes: lower bounds (...) of a single member's rate over them, the tighter the better.
        Guides are certified only with it. By default the function's attribute ``lower_bound``, if
        it has one, which is how the functions of scenario files provide it.

    Raises
    ------
    HazardError
        The function fails, or returns another number of rates than members; at evaluation, rates
        that are negative or not finite.
    """

    function: Callable[..., Expr]
    radars: tuple[tuple[float, float], ...] = ()
    parameters: Mapping[str, Any] | tuple[tuple[str, Any], ...] = ()
    lower_bound: Callable[..., FloatArray] | None = None

    def __post_init__(self) -> None:
        if not callable(self.function):
            raise HazardError(
                f"{self.function!r} is not a function of (positions, alive)",
                function=repr(self.function),
            )
        object.__setattr__(self, "radars", checked_radars(self.radars))
        object.__setattr__(self, "parameters", _frozen(dict(self.parameters)))
        for key, value in dict(self.parameters).items():
            try:
                hash(value)
            except (TypeError, NotImplementedError):  # the latter is CasADi's
                raise HazardError(
                    f"parameter {key!r} is {shown(value)}; allowed: numbers, texts, lists of these",
                    key=key,
                    value=repr(value),
                ) from None
        for n in (1, 2):
            rate_function(self, n)

    @property
    def radar_positions(self) -> FloatArray:
        """Positions of the radars, shape (k, 2)."""
        return np.array(self.radars, dtype=float).reshape(-1, 2)

    def expression(self, positions: Expr, alive: Expr) -> Expr:
        """The user's function as an MX call: (2, n), (1, n) to (1, n)."""
        return rate_function(self, positions.shape[1])(positions, alive)

    def single_agent_expression(self, points: Expr) -> Expr:
        """The user's function of one member, mapped over m points: (2, m) to (1, m)."""
        m = points.shape[1]
        return rate_function(self, 1).map(m)(points, ca.DM.ones(1, m))

    def _evaluate(self, positions: FloatArray, alive: BoolArray) -> FloatArray:
        batch, n, _ = positions.shape
        size = min(1 << max(0, batch.bit_length() - 1), _CHUNK)  # few sizes, each built once
        mapped = _mapped_rates(self, n, size)
        out = np.empty((batch, n))
        for first in range(0, batch, size):
            start = min(first, batch - size)  # the last call overlaps, so that all have one size
            chunk = slice(start, start + size)
            x = positions[chunk].reshape(-1, 2).T
            living = alive[chunk].reshape(1, -1).astype(float)
            out[chunk] = np.asarray(mapped(x, living)).reshape(size, n)
        return out

    def single_agent_lower_bound(self, lower: FloatArray, upper: FloatArray) -> FloatArray | None:
        """Values of `lower_bound` over boxes; None if there is none.

        Raises
        ------
        HazardError
            It returns another shape than (...), or NaN, or exceeds the rate at the centre, at a
            corner or at a random point of some of the boxes.
        """
        lower_bound = self.lower_bound or getattr(self.function, "lower_bound", None)
        if lower_bound is None:
            return None
        try:
            bounds = np.asarray(lower_bound(lower, upper, **self._keywords), dtype=float)
        except USER_ERRORS as error:
            raise HazardError(
                f"lower_bound of {self!r} failed: {failure_text(error)}", hazard=repr(self)
            ) from error
        boxes = np.broadcast_shapes(lower.shape, upper.shape)[:-1]
        if bounds.shape != boxes:
            raise HazardError(
                f"lower_bound of {self!r} returned shape {bounds.shape} for boxes of shape "
                f"{boxes}; expected one number per box",
                hazard=repr(self),
                shape=bounds.shape,
                expected=boxes,
            )
        ends = np.stack(np.broadcast_arrays(lower, upper)).reshape(2, -1, 2)
        self._require_below_rates(bounds.ravel(), *ends)
        return bounds

    def _require_below_rates(
        self, bounds: FloatArray, lower: FloatArray, upper: FloatArray
    ) -> None:
        """Raise HazardError if bounds (m,) of boxes exceed the rate at some points of the boxes."""
        sample = np.linspace(0, bounds.size - 1, min(bounds.size, _CHECKED_BOXES)).astype(int)
        undefined = np.flatnonzero(np.isnan(bounds))[:1]
        sample = undefined if undefined.size else sample
        number = _CHECKED_POINTS // max(len(sample), 1)
        inner = np.random.default_rng(0).random((len(sample), number, 2))
        inner[:, :5] = np.array([[0, 0], [0, 1], [1, 0], [1, 1], [0.5, 0.5]])
        low, high = lower[sample, None], upper[sample, None]
        points = np.where(inner == 1, high, low + inner * (high - low))
        rates = self.single_agent_rates(points)
        wrong = np.argwhere(~(bounds[sample, None] <= rates * (1 + 1e-9)))
        if wrong.size:
            box, point = wrong[0]
            raise HazardError(
                f"lower_bound of {self!r} is not a lower bound: it is {bounds[sample[box]]:g} for "
                f"the box from {_as_text(low[box, 0])} to {_as_text(high[box, 0])}, where the rate "
                f"at {_as_text(points[box, point])} is {rates[box, point]:g}",
                hazard=repr(self),
                bound=float(bounds[sample[box]]),
                rate=float(rates[box, point]),
                position=tuple(points[box, point].tolist()),
            )

    @property
    def _keywords(self) -> dict[str, Any]:
        """Keyword arguments of the user's functions."""
        return dict(self.parameters) | ({"radars": self.radars} if self.radars else {})

    def __repr__(self) -> str:
        return f"hazard {getattr(self.function, '__qualname__', self.function)!r}"


@locked_cache(maxsize=64)
def rate_function(hazard: CustomHazard, n: int) -> Expr:
    """CasADi Function (2, n), (1, n) -> (1, n) of a user's rates, or HazardError."""
    _require_arguments(hazard)
    positions, alive = ca.MX.sym("positions", 2, n), ca.MX.sym("alive", 1, n)
    try:
        returned = hazard.function(positions.T, alive.T, **hazard._keywords)
    except USER_ERRORS as error:
        raise HazardError(
            f"{hazard!r} failed on {counted(n, 'member')} with CasADi arguments: "
            f"{failure_text(error)}",
            hazard=repr(hazard),
            members=n,
        ) from error
    try:
        rates = ca.MX(returned)
    except (NotImplementedError, TypeError):
        raise HazardError(
            f"{hazard!r} returned {returned!r}, a {type(returned).__name__}; "
            "expected a CasADi expression",
            hazard=repr(hazard),
            members=n,
            value=repr(returned),
        ) from None
    if rates.shape not in ((n, 1), (1, n)):
        raise HazardError(
            f"{hazard!r} returned shape {rates.shape} for {counted(n, 'member')}; expected "
            f"({n}, 1)",
            hazard=repr(hazard),
            members=n,
            shape=rates.shape,
            expected=(n, 1),
        )
    return ca.Function("rates", [positions, alive], [ca.reshape(rates, 1, n)])


def _require_arguments(hazard: CustomHazard) -> None:
    """Raise HazardError for keywords that the function does not take."""
    try:
        takes = signature(hazard.function, follow_wrapped=False).parameters
    except (TypeError, ValueError):  # of compiled code
        return
    given = hazard._keywords
    unknown = [name for name in given if name not in takes]
    if not unknown or any(argument.kind is argument.VAR_KEYWORD for argument in takes.values()):
        return
    keys = [name if name == "radars" else f"parameters.{name}" for name in unknown]
    raise HazardError(
        f"{hazard!r} takes {', '.join(takes)}, not {', '.join(unknown)}: remove "
        f"{', '.join(f'hazard.{key}' for key in keys)} from the scenario, where a template may "
        "have left it, or give the function such an argument",
        hazard=repr(hazard),
        value=unknown,
        expected=list(takes),
    )


@locked_cache(maxsize=64)
def _mapped_rates(hazard: CustomHazard, n: int, size: int) -> Expr:
    return rate_function(hazard, n).map(size)


def _as_text(point: FloatArray) -> str:
    return "({:g}, {:g})".format(*point)


def _frozen(value: Any) -> Any:
    if isinstance(value, Mapping):
        return tuple(sorted((key, _frozen(item)) for key, item in value.items()))
    if isinstance(value, (list, tuple, np.ndarray)):
        return tuple(_frozen(item) for item in value)
    return value


ENTRY_POINTS = "casswarm.hazards"
"""Group of entry points by which installed packages offer hazards to scenario files."""


def origin(name: str, folder: Path) -> str | None:
    """Name the code behind ``module:name`` in a scenario file in `folder`; None if there is none.

    Nothing is imported.
    """
    if file := module_file(name, folder):
        return str(file)
    if entry := _entry_point(name):
        package = entry.dist.name if entry.dist else "an unknown package"
        return f"the installed package {package} (entry point {entry.name!r})"
    return None


def user_hazard(
    kind: str | Callable[..., Any],
    folder: Path | None,
    radars: tuple[tuple[float, float], ...],
    parameters: Mapping[str, Any],
) -> Hazard:
    """Hazard of a user's function, or of a class derived from `Hazard`.

    `kind` is the function or class, or its name ``module:name``. With a folder, that of a scenario
    file, the module must lie in it and define what is named, or an installed package must offer
    it as an entry point; without, the module is imported as usual. A class is called with the
    radars and parameters; a function with an argument ``time`` is called with time 0. HazardError
    tells what cannot be imported or called, or fails.
    """
    rates = _named(kind, folder) if isinstance(kind, str) else kind
    if not (isinstance(rates, type) and issubclass(rates, Hazard)):
        start = {"time": 0.0} if _takes_time(rates) else {}
        return CustomHazard(rates, radars, start | dict(parameters))
    try:
        return rates(**{"radars": radars} | dict(parameters))
    except HazardError:
        raise
    except USER_ERRORS as error:
        raise HazardError(
            f"{rates.__name__} cannot be made: {failure_text(error)}", hazard=rates.__name__
        ) from error


def _takes_time(function: Callable[..., Any]) -> bool:
    try:
        return "time" in signature(function, follow_wrapped=False).parameters
    except (TypeError, ValueError):  # of compiled code
        return False


def _named(name: str, folder: Path | None) -> Callable[..., Any]:
    inside = folder is not None and module_file(name, folder) is not None
    entry = None if folder is None or inside else _entry_point(name)
    if folder is not None and not inside and entry is None:
        raise HazardError(missing(name, folder), function=name, folder=folder)
    try:
        found = entry.load() if entry else load(name, folder)
    except ImportError as error:
        raise HazardError(str(error), function=name, folder=folder) from error
    except USER_ERRORS as error:  # of a package that offers it
        raise HazardError(
            f"{name!r} cannot be imported: {failure_text(error)}", function=name, folder=folder
        ) from error
    if not callable(found):
        raise HazardError(f"{name!r} is not a function", function=name)
    is_hazard = isinstance(found, type) and issubclass(found, Hazard)
    if inside and not is_hazard and not is_defined_in(found, folder):  # type: ignore[arg-type]
        raise HazardError(
            f"{name!r} is not defined in the folder {folder}: write a function there that calls it",
            function=name,
            folder=folder,
        )
    return found  # type: ignore[no-any-return]


def missing(name: str, folder: Path) -> str:
    """Text for a name that refers to nothing."""
    file = folder.joinpath(*name.partition(":")[0].split(".")).with_suffix(".py")
    return f"there is no file {file}, and no installed package offers {name!r} ({ENTRY_POINTS})"


def _entry_point(name: str) -> EntryPoint | None:
    """The entry point of an installed package that refers to ``module:name``."""
    offered = entry_points(group=ENTRY_POINTS)
    return next((entry for entry in offered if entry.value == name), None)
