"""Python source from scalar CasADi expressions, for NumPy and Numba.

CasADi evaluates a function at one point at a time; a kernel has to be evaluated at millions of
squared distances. The expression remains the only definition: its instructions are translated to
Python, one line each.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from copy import copy
from dataclasses import fields
from typing import TYPE_CHECKING, Any

import casadi as ca
import numpy as np

from .._util.threads import locked_cache
from ..errors import HazardError
from ..nlp.operations import OPERATIONS, instructions, operation_name
from ..typing import Expr

if TYPE_CHECKING:
    from .kernel_hazard import KernelHazard

_KERNELS = {"source": 1, "density": 1, "collision": 1, "combine": 3, "zone": 2}
"""The kernels of a hazard, and their numbers of arguments."""


def lower_source(name: str, inputs: dict[str, Expr], outputs: Sequence[Expr]) -> str:
    """Python source of a function that returns the values of scalar expressions.

    `inputs` are the symbols of its arguments by name, in order; a column is an argument that is
    indexed. HazardError names an operation that has no counterpart here.
    """
    function = ca.Function(name, list(inputs.values()), [ca.SX(y) for y in outputs])
    scalar = [symbol.is_scalar() for symbol in inputs.values()]
    names = list(inputs)
    lines = [f"def {name}({', '.join(names)}):"]
    divisors = _shared_divisors(function)
    for place, (operation, read, written, constant) in enumerate(instructions(function)):
        target = f"w{written[0]}"
        if place in divisors:
            inverse, first = divisors[place]
            lines += [f"    {inverse} = 1.0 / w{read[-1]}"] if first else []
            dividend = f"w{read[0]} * " if operation == ca.OP_DIV else ""
            lines.append(f"    {target} = {dividend}{inverse}")
            continue
        if operation == ca.OP_CONST:
            value = repr(constant)
        elif operation == ca.OP_INPUT:
            value = names[read[0]] + ("" if scalar[read[0]] else f"[{read[1]}]")
        elif operation == ca.OP_OUTPUT:
            target, value = f"y{written[0]}", f"w{read[0]}"
        elif operation in OPERATIONS and (text := OPERATIONS[operation].array):
            value = text.format(x=f"w{read[0]}", y=f"w{read[-1]}")
        else:
            raise HazardError(
                f"kernel {name!r} uses CasADi's {operation_name(operation)}, which cannot be "
                "evaluated over arrays; write the kernel without it",
                function=name,
                operation=operation_name(operation),
            )
        lines.append(f"    {target} = {value}")
    lines += [f"    y{i} = 0.0" for i, y in enumerate(outputs) if ca.SX(y).nnz() == 0]
    lines.append(f"    return {', '.join(f'y{i}' for i in range(len(outputs)))}")
    return "\n".join(lines) + "\n"


def _shared_divisors(function: Expr) -> dict[int, tuple[str, bool]]:
    """Divisions by numbers that others divide by, too: the inverse's name, and whether it is new.

    An inverse and products take a fraction of the time of several divisions.
    """
    versions: dict[int, int] = {}
    places: dict[tuple[int, int], list[int]] = {}
    for place, (operation, read, written, _) in enumerate(instructions(function)):
        if operation in (ca.OP_DIV, ca.OP_INV):
            divisor = read[-1]
            places.setdefault((divisor, versions.get(divisor, 0)), []).append(place)
        if operation != ca.OP_OUTPUT:
            versions[written[0]] = versions.get(written[0], 0) + 1
    return {
        place: (f"r{divisor}_{version}", place == found[0])
        for (divisor, version), found in places.items()
        if len(found) > 1
        for place in found
    }


def lower(
    kernel: Callable[..., Expr], inputs: int, name: str, order: int = 0
) -> Callable[..., Any]:
    """Elementwise NumPy function of the same expression as `kernel`, of `inputs` scalars.

    With an order of 1 or 2 its derivatives follow the value: see `derivative_source`.
    """
    namespace: dict[str, Any] = {"np": np, "inf": np.inf, "nan": np.nan}
    source = derivative_source(kernel, inputs, name, order)
    exec(compile(source, f"<kernel {name}>", "exec"), namespace)
    lowered: Callable[..., Any] = namespace[name]
    return lowered


def derivative_source(
    kernel: Callable[..., Expr], inputs: int, name: str, order: int, **parameters: Expr
) -> str:
    """Python source of ``name(x0, ..., parameters)``: a kernel and its derivatives up to an order.

    Those of second order are the upper triangle of the Hessian by rows.
    """
    symbols = {f"x{i}": ca.SX.sym(f"x{i}") for i in range(inputs)}
    x = list(symbols.values())
    value = ca.SX(kernel(*x))
    first = [ca.gradient(value, symbol) for symbol in x]
    second = [ca.gradient(first[i], x[j]) for i in range(inputs) for j in range(i, inputs)]
    outputs = [value, *(first if order else []), *(second if order == 2 else [])]
    return lower_source(name, symbols | parameters, outputs)


def lowered_kernels(hazard: KernelHazard, order: int = 0) -> tuple[Callable[..., Any], ...]:
    """NumPy functions (see `lower`) of the kernels' expressions, in the order of `_KERNELS`."""
    return _lowered(hazard.template, order)


@locked_cache(maxsize=64)
def _lowered(hazard: KernelHazard, order: int) -> tuple[Callable[..., Any], ...]:
    kernels = _KERNELS.items()
    return tuple(lower(getattr(hazard, name), inputs, name, order) for name, inputs in kernels)


@locked_cache(maxsize=64)
def differentiated_kernels(hazard: KernelHazard) -> tuple[str, tuple[float, ...]]:
    """Python source of the kernels with their derivatives, and two or more parameters it may read.

    ``density(x0, parameters)`` returns value and derivative, ``second_density`` the second
    derivative too, and so on; where there are several arguments, the upper triangle by rows.

    The numerical fields of the hazard are parameters of the source, but for `structural` ones, so
    that all hazards of a class share compiled code.
    """
    names = [
        f.name
        for f in fields(hazard)
        if isinstance(getattr(hazard, f.name), (int, float)) and f.name not in hazard.structural
    ]
    values = [float(getattr(hazard, name)) for name in names]
    values += [0.0] * (2 - len(values))  # never a scalar: they are indexed
    parameters = ca.SX.sym("parameters", len(values))
    symbolic = copy(hazard)
    for index, name in enumerate(names):
        object.__setattr__(symbolic, name, parameters[index])
    try:
        source = _kernel_sources(symbolic, parameters)
    except HazardError:
        raise
    except Exception:  # a kernel that branches on its numbers
        return _kernel_sources(hazard, parameters), (0.0, 0.0)
    return source, tuple(values)


def _kernel_sources(hazard: KernelHazard, parameters: Expr) -> str:
    return "\n\n".join(
        derivative_source(
            getattr(hazard, name), inputs, f"{prefix}{name}", order, parameters=parameters
        )
        for name, inputs in _KERNELS.items()
        for prefix, order in (("", 1), ("second_", 2))
    )
