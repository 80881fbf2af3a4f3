"""How kernels are compiled: those that kernels call are linked into them, and optimised once.

By default, Numba optimises a function with all that it calls and generates its machine code, and
does the same in every function that calls it. It also generates wrappers for calls from Python,
which for functions of many arrays take as long as the functions. Here a kernel that kernels call
remains an intermediate representation. The kernel that Python calls is linked with all of them, and
only then optimised and wrapped.

Numba's compiler, code library and dispatcher are subclassed; Numba itself remains as it is.
"""

from __future__ import annotations

import gc
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any, ClassVar

import llvmlite.binding as llvm
from numba.core import typed_passes, untyped_passes
from numba.core.codegen import JITCodeLibrary
from numba.core.compiler import Compiler, DefaultPassBuilder, Flags, PassManager, compile_result
from numba.core.registry import CPUDispatcher
from numba.core.types.misc import unliteral

from .cache import compiled_files

_UNUSED = {
    untyped_passes.DeadBranchPrune,
    untyped_passes.InlineClosureLikes,
    untyped_passes.InlineInlinables,
    untyped_passes.LiteralPropagationSubPipelinePass,
    untyped_passes.MakeFunctionToJitFunction,
    untyped_passes.RewriteSemanticConstants,
    untyped_passes.WithLifting,
    typed_passes.InlineOverloads,
    typed_passes.NopythonRewrites,
}
"""Passes for what kernels do not contain: closures, contexts, expressions of whole arrays. They
take a tenth of the time."""

_MANGLED = "_ZN"  # how names of compiled functions begin


class _SharedFlags(Flags):
    """Flags of which there is one instance for equal values, so that they are compared at once.

    Numba compares flags whenever it resolves an operator, for some thousand of them in a solver.
    """

    __slots__ = ()
    __hash__ = object.__hash__
    _instances: ClassVar[list[_SharedFlags]] = []

    def __eq__(self, other: object) -> bool:
        return self is other

    def copy(self) -> _SharedFlags:
        """The instance with these values."""
        for flags in self._instances:
            if flags._values == self._values:
                return flags
        self._instances.append(_SharedFlags(self))
        return self._instances[-1]


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

    def serialize_using_object_code(self) -> tuple[str, str, Any]:
        """Machine code and the names of its functions, without their code: nothing links them."""
        self._ensure_finalized()
        names = [each.name for each in self.get_defined_functions()]
        module = llvm.parse_assembly(
            "".join(f'define void @"{n}"() {{ ret void }}\n' for n in names)
        )
        return self.name, "object", (self._get_compiled_object(), module.as_bitcode())


class _NoEnvironments:
    """A code generator without engine: only wrappers for Python use environments."""

    names: ClassVar[set[str]] = set()

    def set_env(self, name: str, environment: Any) -> None:  # noqa: ARG002
        """Note an environment that is not used."""
        self.names.add(name)


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


def reduced(payload: Any) -> Any:
    """What the cache keeps of a compile result, without environments that are not used."""
    *rest, environments = payload
    used = (each for each in environments if each.env_name not in _NoEnvironments.names)
    return *rest, tuple(used)


def is_linked(payload: Any) -> bool:
    """Whether the cache keeps the result of a function that kernels link in."""
    return bool(payload[0][1] == "linked")


def linked_result(target: Any, payload: Any) -> Any:
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


class KernelCompiler(Compiler):
    """Numba's compiler without passes that kernels do not need."""

    library: ClassVar[type[JITCodeLibrary]] = _EntryLibrary

    def __init__(self, *arguments: Any) -> None:
        super().__init__(*arguments)
        self.state.flags = _SharedFlags(self.state.flags)

    def compile_extra(self, func: Callable[..., Any]) -> Any:
        """Compile a function into a library of its own."""
        library = self.library(self.state.targetctx.codegen(), func.__qualname__)
        library.origin = func.__module__, func.__qualname__, tuple(self.state.args)
        library.enable_object_caching()
        self.state.library = library
        return super().compile_extra(func)

    def define_pipelines(self) -> list[PassManager]:
        """Make the passes of nopython mode, without `_UNUSED`."""
        manager = PassManager("kernel")
        default = DefaultPassBuilder.define_nopython_pipeline(self.state)
        manager.passes.extend(each for each in default.passes if each[0] not in _UNUSED)
        manager.finalize()
        return [manager]


class _LinkedCompiler(KernelCompiler):
    library = _Linked


class _EntryDispatcher(CPUDispatcher):
    def _compilation_chain_init_hook(self) -> None:
        """Nothing: arguments are arrays, numbers and tuples, not types of Numba's extensions."""

    def compile(self, sig: Any) -> Any:
        """Load or compile it."""
        with without_collector():
            return super().compile(sig)


class _LinkedDispatcher(CPUDispatcher):
    def get_call_template(self, args: Any, kws: Any) -> Any:
        """Resolve a call, without a specialisation for literal arguments."""
        plain = [unliteral(each) for each in args], {k: unliteral(kws[k]) for k in kws}
        return super().get_call_template(*plain)


def entry_dispatcher(function: Callable[..., Any], options: dict[str, Any], stamp: bytes) -> Any:
    """Dispatcher of a function for calls from Python."""
    options = {"nopython": True, "nogil": True, "no_cfunc_wrapper": True, **options}
    dispatcher = _EntryDispatcher(function, {}, options, KernelCompiler)
    dispatcher._cache = compiled_files(function, stamp)
    return dispatcher


def linked_dispatcher(function: Callable[..., Any], options: dict[str, Any], stamp: bytes) -> Any:
    """Dispatcher of a function for calls from kernels."""
    wrappers = {"no_cpython_wrapper": True, "no_cfunc_wrapper": True}
    dispatcher = _LinkedDispatcher(
        function, {}, {"nopython": True, **wrappers, **options}, _LinkedCompiler
    )
    dispatcher._cache = compiled_files(function, stamp, "linked.")
    return dispatcher


@contextmanager
def without_collector() -> Iterator[None]:
    """Compile without the garbage collector, which finds little in what is compiled."""
    enabled = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if enabled:
            gc.enable()
