"""Compilation of kernels: those that kernels call are linked into them, and optimised once.

By default, Numba optimises a function with all that it calls and generates its machine code, and
does the same in every function that calls it. It also generates wrappers for calls from Python,
which for functions of many arrays take as long as the functions. Here a kernel that kernels call
remains an intermediate representation. The kernel that Python calls is linked with all of them, and
only then optimised and wrapped.

Numba's compiler, code library and dispatcher are subclassed; Numba itself remains as it is. Where
its inside has changed, `casswarm.compiled.plain` has the same functions.
"""

from __future__ import annotations

import gc
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any, ClassVar

import llvmlite.binding as llvm
from numba.core.ccallback import CFunc
from numba.core.codegen import JITCodeLibrary
from numba.core.compiler import Compiler, compile_result
from numba.core.registry import CPUDispatcher
from numba.core.sigutils import normalize_signature
from numba.core.types import FunctionType
from numba.core.types.misc import unliteral
from numba.core.typing.typeof import typeof_impl
from numba.experimental import function_type  # noqa: F401  (how kernels call a callback)

from .cache import CompiledForm, compiled_files

_MANGLED = "_ZN"  # how names of compiled functions begin


class _EntryLibrary(JITCodeLibrary):
    """Machine code of a function, with all that it calls."""

    _linking_libraries: list[Any]

    def _optimize_functions(self, ll_module: Any) -> None:
        ll_module.data_layout = self._codegen._data_layout  # optimised with what it calls

    def finalize(self) -> None:
        libraries = self._linking_libraries
        for library in _linked(libraries):
            self._final_module.link_in(library._final_module, preserve=True)
        self._linking_libraries = [each for each in libraries if not isinstance(each, _Linked)]
        super().finalize()


class _NoEnvironments:
    """A code generator without engine: only wrappers for Python use environments."""

    def set_env(self, name: str, environment: Any) -> None:
        """Nothing is kept."""


class _Linked(JITCodeLibrary):
    """Code of a function that kernels link in; `origin` is its module, name and signature."""

    origin: tuple[str, str, tuple[Any, ...]]
    _linking_libraries: list[Any]
    codegen = _NoEnvironments()

    def _optimize_functions(self, ll_module: Any) -> None:
        ll_module.data_layout = self._codegen._data_layout

    def finalize(self) -> None:
        for library in dict.fromkeys(self._linking_libraries):
            if not isinstance(library, _Linked):  # Numba's own
                self._final_module.link_in(library._get_module_for_linking(), preserve=True)
        self._linking_libraries = list(
            dict.fromkeys(each for each in self._linking_libraries if isinstance(each, _Linked))
        )
        for function in self._final_module.functions:
            if not function.is_declaration and function.linkage == llvm.Linkage.external:
                function.linkage = "linkonce_odr"
        self._finalized = True

    def get_pointer_to_function(self, name: str) -> int:  # noqa: ARG002
        self._ensure_finalized()
        return 0

    def _get_module_for_linking(self) -> Any:
        """With all that it calls, for functions that are no kernels."""
        module = self._final_module.clone()
        for library in _linked(self._linking_libraries):
            module.link_in(library._final_module, preserve=True)
        return module

    def serialize_using_object_code(self) -> tuple[str, str, Any]:
        origins = [library.origin for library in self._linking_libraries]
        return self.name, "linked", (self.origin, self._final_module.as_bitcode(), origins)


def _linked(libraries: list[Any]) -> dict[_Linked, None]:
    """All linked libraries that these call, in order."""
    found: dict[_Linked, None] = {}
    waiting = [library for library in libraries if isinstance(library, _Linked)]
    while waiting:
        library = waiting.pop()
        if library not in found:
            found[library] = None
            waiting.extend(library._linking_libraries)
    return found


def _linked_result(target: Any, payload: Any) -> Any:
    """The compile result of a function that kernels link in, from what the cache keeps of it.

    None if it calls functions by names that they no longer have: names contain a number of the
    process that compiled them, and another process may have compiled them since.
    """
    (name, _, (origin, bitcode, origins)), descriptor, environment, signature = payload[:4]
    library = _Linked(target.codegen(), name)
    library.origin = origin
    library._final_module = llvm.parse_bitcode(bitcode)
    for module, function, arguments in origins:
        called = getattr(sys.modules[module], function).linked
        called.compile(arguments)
        library._linking_libraries.append(called.overloads[arguments].library)
    library._finalized = True
    if _undefined(library):
        return None
    return compile_result(
        typing_context=target.typing_context,
        target_context=target,
        entry_point=target.get_executable(library, descriptor, environment),
        library=library,
        signature=signature,
        fndesc=descriptor,
        environment=environment,
        objectmode=False,
        lifted=(),
        reload_init=(),
    )


def _undefined(library: _Linked) -> set[str]:
    """Names of compiled functions that a library calls and none that it links defines."""
    defined = {
        each.name
        for one in _linked([library])
        for each in one._final_module.functions
        if not each.is_declaration
    }
    called = {each.name for each in library._final_module.functions if each.is_declaration}
    return {name for name in called - defined if name.startswith(_MANGLED)}


class _Form(CompiledForm):
    """Compiled code in files, of which that of linked functions is an intermediate one."""

    def rebuild(self, target_context: Any, payload: Any) -> Any:
        """The compile result, from what the cache keeps of it."""
        if payload[0][1] == "linked":
            return _linked_result(target_context, payload)
        return super().rebuild(target_context, payload)


class _EntryCompiler(Compiler):
    library: ClassVar[type[JITCodeLibrary]] = _EntryLibrary

    def compile_extra(self, func: Callable[..., Any]) -> Any:
        """Compile a function into a library of its own."""
        library = self.library(self.state.targetctx.codegen(), func.__qualname__)
        library.origin = func.__module__, func.__qualname__, tuple(self.state.args)
        library.enable_object_caching()
        self.state.library = library
        return super().compile_extra(func)


class _LinkedCompiler(_EntryCompiler):
    library = _Linked


class _EntryDispatcher(CPUDispatcher):
    def compile(self, sig: Any) -> Any:
        """Load or compile it."""
        with _without_collector():
            return super().compile(sig)

    def typeof_pyval(self, val: Any) -> Any:
        """Type of an argument that Numba does not know by itself."""
        return val.type if type(val) is _Callback else super().typeof_pyval(val)


class _LinkedDispatcher(CPUDispatcher):
    def get_call_template(self, args: Any, kws: Any) -> Any:
        """Resolve a call, without a specialisation for literal arguments."""
        plain = [unliteral(each) for each in args], {k: unliteral(kws[k]) for k in kws}
        return super().get_call_template(*plain)


class _Callback(CFunc):
    """A compiled function with its type at hand, which Numba's `CFunc` builds anew in each call.

    That takes ten times as long as deciding a formation.
    """

    type: Any = None

    def __wrapper_address__(self) -> int | None:
        """Address at which Numba calls it, without comparing signatures first."""
        return self.address


typeof_impl.register(_Callback, lambda function, _: function.type)


def entry_dispatcher(function: Callable[..., Any], options: dict[str, Any], stamp: bytes) -> Any:
    """Dispatcher of a function for calls from Python."""
    options = {"nopython": True, "nogil": True, "no_cfunc_wrapper": True, **options}
    dispatcher = _EntryDispatcher(function, {}, options, _EntryCompiler)
    dispatcher._cache = compiled_files(function, stamp, _Form)
    return dispatcher


def linked_dispatcher(function: Callable[..., Any], options: dict[str, Any], stamp: bytes) -> Any:
    """Dispatcher of a function for calls from kernels."""
    wrappers = {"no_cpython_wrapper": True, "no_cfunc_wrapper": True}
    dispatcher = _LinkedDispatcher(
        function, {}, {"nopython": True, **wrappers, **options}, _LinkedCompiler
    )
    dispatcher._cache = compiled_files(function, stamp, _Form, "linked.")
    return dispatcher


def callback(
    function: Callable[..., Any], signature: str, options: dict[str, Any], stamp: bytes
) -> Any:
    """Compile a function to one that kernels take as argument, as `numba.cfunc` does."""
    signed = normalize_signature(signature)
    compiled: Any = _Callback(function, signed, {}, options, _EntryCompiler)
    compiled.type = FunctionType(compiled._sig)
    compiled._cache = compiled_files(function, stamp, _Form)
    with _without_collector():
        compiled.compile()
    return compiled


@contextmanager
def _without_collector() -> Iterator[None]:
    """Compile without the garbage collector, which finds little in what is compiled."""
    enabled = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if enabled:
            gc.enable()
