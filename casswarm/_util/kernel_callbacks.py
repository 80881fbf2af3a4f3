"""Compiled functions that kernels take as arguments.

Numba's `CFunc` is such a function, but its type is built anew, from that of every argument, in each
call that passes it, which takes as long as the decision of a formation.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from numba.core.ccallback import CFunc
from numba.core.typing.typeof import typeof_impl
from numba.experimental.function_type import FunctionType

from .compiled_files import compiled_files
from .kernel_compiler import KernelCompiler, without_collector


class _Callback(CFunc):
    """A compiled function with its type at hand."""

    def __init__(self, *arguments: Any) -> None:
        super().__init__(*arguments)
        self._numba_type_ = FunctionType(self._sig)


@typeof_impl.register(_Callback)
def _type(function: _Callback, context: Any) -> Any:  # noqa: ARG001
    return function._numba_type_


def callback(
    function: Callable[..., Any], signature: Any, options: dict[str, Any], stamp: bytes
) -> Any:
    """Compile a function to one that kernels take as argument, as `numba.cfunc` does."""
    compiled: Any = _Callback(function, signature, {}, options, KernelCompiler)
    compiled._cache = compiled_files(function, stamp)
    with without_collector():
        compiled.compile()
    return compiled
