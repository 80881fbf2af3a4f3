"""Compiled functions that kernels take as arguments.

Numba's `CFunc` is such a function, but its type is built anew, from that of every argument, in each
call that passes it, which takes ten times as long as deciding a formation.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from numba.core.ccallback import CFunc
from numba.core.types import FunctionType
from numba.core.typing.typeof import typeof_impl
from numba.experimental import function_type  # noqa: F401  (how kernels call such an argument)

from .cache import compiled_files
from .linking import KernelCompiler, without_collector


class _Callback(CFunc):
    """A compiled function with its type at hand."""

    type: Any = None

    def __wrapper_address__(self) -> int | None:
        """Where Numba calls it, without comparing signatures first."""
        return self.address


typeof_impl.register(_Callback, lambda function, _: function.type)


def callback(
    function: Callable[..., Any], signature: Any, options: dict[str, Any], stamp: bytes
) -> Any:
    """Compile a function to one that kernels take as argument, as `numba.cfunc` does."""
    compiled: Any = _Callback(function, signature, {}, options, KernelCompiler)
    compiled.type = FunctionType(compiled._sig)
    compiled._cache = compiled_files(function, stamp)
    with without_collector():
        compiled.compile()
    return compiled
