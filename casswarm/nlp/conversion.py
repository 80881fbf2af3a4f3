"""Programs and instances of problems in CasADi's forms, and what no problem may have."""

from __future__ import annotations

import re
from collections.abc import Mapping
from itertools import chain
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np

from .._util.text import did_you_mean
from ..errors import ProblemError
from ..typing import FloatArray
from .program import Instances, NamedRows, Nlp

START = "given"
"""Name of the start of a problem that has a single one."""

_PLACE = re.compile(r"^\S*casadi/\S+:\d+: ?")
_EXPRESSIONS = ("x", "p", "f", "g")
_DEFAULTS = {"x0": 0.0, "p": 0.0, "lbx": -np.inf, "ubx": np.inf, "lbg": -np.inf, "ubg": np.inf}


def refusal(name: str, reason: str, **values: Any) -> ProblemError:
    """Error about the problem of a name."""
    return ProblemError(f"problem {name!r}{reason}", problem=name, **values)


def from_dictionary(
    nlp: Mapping[str, Any], arguments: Mapping[str, Any], name: str
) -> tuple[Nlp, dict[str, Instances]]:
    """Program and initial guesses of a dictionary and the arguments of `casadi.nlpsol`.

    Raises
    ------
    ProblemError
        See `casswarm.comparison.Problem.from_casadi`.
    """
    _require_known(name, nlp, _EXPRESSIONS)
    _require_known(name, arguments, _DEFAULTS)
    kind = type(nlp.get("x"))
    if kind not in (ca.SX, ca.MX):
        raise refusal(name, ": x has to be symbols of CasADi, of SX or MX", key="x")
    for key, value in nlp.items():
        if isinstance(value, ca.SX | ca.MX) and type(value) is not kind:
            names = type(value).__name__, kind.__name__
            raise refusal(name, f": {key} is of {names[0]}, but x of {names[1]}", key=key)
    try:
        x, p, f, g = (ca.vec(kind(nlp.get(key, kind(0, 1)))) for key in _EXPRESSIONS)
        program = Nlp.from_expressions(name, x, p, f if "f" in nlp else kind(0), g)
    except (RuntimeError, NotImplementedError, TypeError) as error:
        raise refusal(name, f" cannot be built: {_reason(error)}") from error
    if not program.objective.is_scalar():
        count = program.objective.numel()
        raise refusal(name, f": f has {count} entries; expected a scalar", key="f", value=count)
    return program, _starts(program, arguments, name)


def from_stack(opti: ca.Opti, name: str) -> tuple[Nlp, dict[str, Instances]]:
    """Program and initial guess of an Opti stack.

    Raises
    ------
    ProblemError
        See `casswarm.comparison.Problem.from_opti`.
    """
    advanced = opti.advanced
    for symbol in ca.symvar(opti.x):
        if advanced.get_meta(symbol).domain != ca.OPTI_DOMAIN_REAL:
            raise refusal(name, " has integer variables; only continuous ones are supported")
    try:
        numbers = {
            "x0": opti.debug.value(opti.x, opti.initial()),
            "p": opti.debug.value(opti.p),
            "lbg": opti.debug.value(opti.lbg),
            "ubg": opti.debug.value(opti.ubg),
        }
    except RuntimeError as error:
        raise refusal(name, f" cannot be built: {_reason(error)}") from error
    expressions = {"x": opti.x, "p": opti.p, "f": ca.MX(opti.f), "g": opti.g}
    program, starts = from_dictionary(expressions, numbers, name)
    return program.with_attachments(_constraints(advanced, program)), starts


def _constraints(advanced: Any, program: Nlp) -> NamedRows:
    """The constraints of an Opti stack in order, called by number and line of the user's code."""
    rows, sizes = [], []
    for number, constraint in enumerate(advanced.constraints()):
        meta = advanced.get_meta_con(constraint)
        places = (meta.extra or {}).get("stacktrace") or [{}]
        place = f"{Path(places[0].get('file', '')).name}:{places[0].get('line', '')}".strip(":")
        rows.append(f"constraint {number}" + (f" ({place})" if place else ""))
        sizes.append(int(meta.canon.numel()))
    if sum(sizes) != program.sizes[2]:
        return NamedRows.of(program)
    return NamedRows(tuple(rows), tuple(sizes), program.variable_names)


def require_solvable(nlp: Nlp, starts: Mapping[str, Instances], name: str) -> None:
    """Raise ProblemError for a problem that no solver can take, with the reason.

    Numbers that are NaN, bounds that cross or are the same for every variable, or an objective or
    constraint that is not finite at an initial guess.
    """
    for start, instance in starts.items():
        for key in _DEFAULTS:
            wrong = np.flatnonzero(np.isnan(getattr(instance, key)[0]))
            if len(wrong):
                raise refusal(name, f": {key}[{wrong[0]}] is not a number", start=start, key=key)
        for low, high in (("lbx", "ubx"), ("lbg", "ubg")):
            lower, upper = getattr(instance, low)[0], getattr(instance, high)[0]
            crossed = np.flatnonzero((lower > upper) | (lower == np.inf) | (upper == -np.inf))
            if len(crossed):
                i = crossed[0]
                bounds = f"{low}[{i}] = {lower[i]:g} and {high}[{i}] = {upper[i]:g}"
                between = float(lower[i]), float(upper[i])
                raise refusal(name, f": nothing is between {bounds}", start=start, value=between)
        if not nlp.sizes[0]:
            raise refusal(name, " has no variables")
        if not (instance.lbx < instance.ubx).any():
            raise refusal(name, " has no free variable: lbx = ubx everywhere")
        _require_finite(nlp, instance, name, start)


def _require_finite(nlp: Nlp, instance: Instances, problem: str, start: str) -> None:
    where = f", {start} start: "
    if not np.isfinite(instance.x0).all():
        raise refusal(problem, f"{where}x0 is not finite", start=start, key="x0")
    values = nlp.evaluate(instance.x0[0], instance.p[0])
    names = chain(["the objective"], nlp.row_names)
    for name, value in zip(names, np.asarray(ca.vertcat(*values)).ravel(), strict=True):
        if not np.isfinite(value):
            reason = f"{where}{name} is {value:g} at x0, and has to be finite"
            raise refusal(problem, reason, start=start, key=name, value=float(value))


def _starts(nlp: Nlp, arguments: Mapping[str, Any], name: str) -> dict[str, Instances]:
    """Instances by the names of initial guesses."""
    guesses = arguments.get("x0", _DEFAULTS["x0"])
    guesses = guesses if isinstance(guesses, Mapping) else {START: guesses}
    if not guesses:
        raise refusal(name, " has no initial guess: x0 is empty", key="x0")
    variables, parameters, constraints = nlp.sizes
    if constraints and not {"lbg", "ubg"} & arguments.keys():
        raise refusal(name, " has constraints g without bounds; give lbg, ubg or both", key="g")
    if parameters and "p" not in arguments:
        raise refusal(name, " has parameters without values; give p", key="p")
    sizes = {"p": parameters, "lbx": variables, "ubx": variables}
    sizes |= {"lbg": constraints, "ubg": constraints}  # in the order of `Instances`
    vectors: list[Any] = [
        _vector(name, key, arguments.get(key, _DEFAULTS[key]), size) for key, size in sizes.items()
    ]
    starts = {
        start: Instances(_vector(name, "x0", guess, variables), *vectors)
        for start, guess in guesses.items()
    }
    require_solvable(nlp, starts, name)
    return starts


def _vector(name: str, key: str, value: Any, size: int) -> FloatArray:
    """Numbers (1, size) of a scalar or of as many entries, in CasADi's order."""
    try:
        entries = np.asarray(ca.densify(ca.DM(value))).ravel(order="F")
    except (NotImplementedError, RuntimeError, TypeError) as error:
        reason = f": {key} = {value!r} are no numbers"
        raise refusal(name, reason, key=key, value=repr(value)) from error
    if len(entries) not in (1, size):
        reason = f": {key} has {len(entries)} entries; expected one or {size}"
        raise refusal(name, reason, key=key, value=len(entries), expected=size)
    return np.array(np.broadcast_to(entries, size)[None])


def _require_known(name: str, given: Mapping[str, Any], known: Any) -> None:
    for key in given:
        if key not in known:
            raise refusal(name, f": {key!r} is unknown{did_you_mean(key, known)}", key=key)


def _reason(error: Exception) -> str:
    """The lines of CasADi's error that say what is wrong; the others are places in its code."""
    lines = [line.strip() for line in str(error).splitlines() if line.strip()]
    told = [_PLACE.sub("", line) for line in lines if "Assertion" not in line]
    return " ".join([line for line in told if line and not line.startswith("Error in")][:2])
