"""CasADi expressions evaluated over batches, without a Python loop over their entries."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import casadi as ca
import numpy as np

from .._util.threads import one_at_a_time
from ..optimization.solvers.interior_point.tape import MAX_ARGUMENTS, Tape, scalar
from ..typing import Expr, FloatArray

CHUNK = 1024  # entries of a batch that are evaluated at once: bounds memory

_Call = Callable[..., list[FloatArray]]


@dataclass(frozen=True, eq=False)
class BatchFunction:
    """A function of up to three columns, some of whose results are dense columns.

    Functions of scalar operations are evaluated by a compiled loop over them; others, such as those
    that call external code, by ``Function.map``.
    """

    call: _Call

    @classmethod
    @one_at_a_time
    def of(cls, arguments: Sequence[Expr], outputs: Sequence[Expr]) -> BatchFunction:
        """Function of MX columns `arguments` with the values of MX columns `outputs`."""
        assert len(arguments) <= MAX_ARGUMENTS
        dense = [ca.densify(output) for output in outputs]
        function = ca.Function("batch", list(arguments), dense)
        symbols = [ca.SX.sym("v", argument.numel()) for argument in arguments]
        try:
            tape = Tape.of(symbols, list(scalar(function).call(symbols)))
        except NotImplementedError:
            return cls(_mapped(function))
        return cls(tape)

    def __call__(self, *arguments: FloatArray) -> list[FloatArray]:
        """Outputs (m, B) at arguments (k, B); at (k,), an argument is the same for all."""
        batch = next(a.shape[1] for a in arguments if a.ndim == 2)
        parts = []
        for first in range(0, batch, CHUNK):
            size = min(CHUNK, batch - first)
            chunk = slice(first, first + size)
            columns = (
                a[:, chunk] if a.ndim == 2 else np.repeat(a[:, None], size, axis=1)
                for a in arguments
            )
            parts.append(self.call(*map(np.ascontiguousarray, columns)))
        return [np.concatenate(outputs, axis=1) for outputs in zip(*parts, strict=True)]


def _mapped(function: Expr) -> _Call:
    """Evaluation by ``Function.map``, of batches of up to `CHUNK` entries, built for few sizes."""
    maps: dict[int, Expr] = {}

    def call(*arguments: FloatArray) -> list[FloatArray]:
        batch = arguments[0].shape[1]
        size = min(CHUNK, 1 << max(0, batch - 1).bit_length())
        if size not in maps:
            maps[size] = one_at_a_time(function.map)(size)
        padded = (np.pad(a, ((0, 0), (0, size - batch)), mode="edge") for a in arguments)
        outputs = maps[size].call(list(padded))
        return [np.asarray(output)[:, :batch] for output in outputs]

    return call
