"""Python source from scalar CasADi expressions, for NumPy and Numba.

CasADi evaluates a function at one point at a time; a kernel has to be evaluated at millions of
squared distances. The expression remains the only definition: its instructions are translated to
Python, one line each.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import casadi as ca
import numpy as np

from ..errors import HazardError
from ..nlp.operations import OPERATIONS, instructions, operation_name
from ..typing import Expr, FloatArray


def lower_source(name: str, inputs: dict[str, Expr], outputs: Sequence[Expr]) -> str:
    """Python source of a function that returns the values of expressions.

    Parameters
    ----------
    name : str
        Name of the function.
    inputs : dict of name to SX
        Symbols of its arguments, in order; a column is an argument that is indexed.
    outputs : sequence of scalar SX

    Raises
    ------
    HazardError
        An operation has no counterpart here (the message names it).
    """
    function = ca.Function(name, list(inputs.values()), [ca.SX(y) for y in outputs])
    scalar = [symbol.is_scalar() for symbol in inputs.values()]
    names = list(inputs)
    lines = [f"def {name}({', '.join(names)}):"]
    for operation, read, written, constant in instructions(function):
        target = f"w{written[0]}"
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


def lower(kernel: Callable[..., Expr], inputs: int, name: str) -> Callable[..., FloatArray]:
    """Elementwise NumPy function of the same expression as `kernel`, of `inputs` scalars."""
    symbols = {f"x{i}": ca.SX.sym(f"x{i}") for i in range(inputs)}
    return _compiled(name, lower_source(name, symbols, [kernel(*symbols.values())]))


def _compiled(name: str, source: str) -> Callable[..., Any]:
    namespace: dict[str, Any] = {"np": np, "inf": np.inf, "nan": np.nan}
    exec(compile(source, f"<kernel {name}>", "exec"), namespace)
    lowered: Callable[..., Any] = namespace[name]
    return lowered


def lower_derivatives(
    kernel: Callable[..., Expr], inputs: int, name: str
) -> Callable[..., tuple[FloatArray, ...]]:
    """Like `lower`: the value, the gradient, and the upper triangle of the Hessian by rows."""
    symbols, outputs = _derivatives(kernel, inputs, order=2)
    return _compiled(name, lower_source(name, symbols, outputs))


def differentiated_source(
    kernel: Callable[..., Expr], inputs: int, name: str, parameters: Expr, order: int = 1
) -> str:
    """Python source of ``name(x0, ..., parameters)``: the kernel and its partial derivatives.

    Those of second order are the upper triangle of the Hessian by rows.
    """
    symbols, outputs = _derivatives(kernel, inputs, order)
    return lower_source(name, symbols | {"parameters": parameters}, outputs)


def _derivatives(
    kernel: Callable[..., Expr], inputs: int, order: int
) -> tuple[dict[str, Expr], list[Expr]]:
    """Symbols of a kernel's arguments, its value, and its derivatives up to an order, 1 or 2."""
    symbols = {f"x{i}": ca.SX.sym(f"x{i}") for i in range(inputs)}
    x = list(symbols.values())
    value = ca.SX(kernel(*x))
    first = [ca.gradient(value, symbol) for symbol in x]
    second = [ca.gradient(first[i], x[j]) for i in range(inputs) for j in range(i, inputs)]
    return symbols, [value, *first, *(second if order == 2 else [])]
