"""Numba: the decorators of compiled functions, and generated modules of them.

Numba is imported when the first of them is compiled or loaded: by `casswarm.compiled.linking`, or
by `casswarm.compiled.plain` where a small kernel shows that the former does not work. Compiled code
is kept beside the file of a function, or in the user's cache folder where that cannot be used: see
`casswarm.compiled.cache`. A generated module must therefore be a file that stays: it is written to
the user's cache folder under the hash of its text.
"""

from __future__ import annotations

import hashlib
import logging
import os
import re
import sys
from collections.abc import Callable, Iterable
from functools import cached_property, lru_cache, update_wrapper
from importlib.util import find_spec
from inspect import getsource
from pathlib import Path
from types import FunctionType, ModuleType
from typing import Any, TypeVar, cast

import numpy as np
from numpy.typing import NDArray

from .._util.files import atomic_write, remove_abandoned, temporary_folder
from .._util.threads import locked_cache
from .folders import cache_folder, private_folder

LOG = logging.getLogger(__name__)

_Function = TypeVar("_Function", bound=Callable[..., Any])
_Array = TypeVar("_Array", bound=NDArray[Any])
_PACKAGE = Path(__file__).parent.parent

_COMPILERS = "kernels.py", "linking.py", "plain.py"
_STAMPED = re.compile(rb"^@(\w*kernel|objective)\b|^class \w+\(NamedTuple\)", re.MULTILINE)

_OPTIONS: dict[str, Any] = {"error_model": "numpy"}
_UNCOUNTED: dict[str, Any] = {"_nrt": False}  # as Numba itself compiles its functions of strings
_REORDERED: dict[str, Any] = {"fastmath": {"reassoc"}}
_OBJECTIVE = "float64(float64[::1], float64[::1], float64[::1], float64[::1], float64[::1])"
_HEADER = """\
# compiled code of this module is kept in files with checksums
from __future__ import annotations

import math

import numpy as np
from math import inf, nan

from casswarm.compiled.kernels import kernel, objective, reordering_kernel


"""


class Kernel:
    """A function that is compiled when it is first called, from Python or from another kernel.

    For calls from Python there is machine code with a wrapper; what other kernels call is linked
    into them (see `casswarm.compiled.linking`).
    """

    def __init__(
        self,
        function: Callable[..., Any],
        options: dict[str, Any],
        compiler: Callable[[], ModuleType],
    ) -> None:
        update_wrapper(self, function)
        self.py_func, self._options, self._compiler = function, _OPTIONS | options, compiler

    def __call__(self, *arguments: Any) -> Any:
        """Call the machine code, which is compiled first where there is none."""
        return self.entry(*arguments)

    @cached_property
    def entry(self) -> Any:
        """Numba's dispatcher for calls from Python."""
        return self._compiler().entry_dispatcher(self.py_func, self._options, _stamp())

    @cached_property
    def linked(self) -> Any:
        """Numba's dispatcher for calls from kernels."""
        return self._compiler().linked_dispatcher(self.py_func, self._options, _stamp())

    @property
    def is_loaded(self) -> bool:
        """True if there is machine code in this process, for calls from Python."""
        return bool(self.entry.overloads)

    @property
    def stats(self) -> Any:
        """Folder of its compiled code, and how often that was used, for calls from Python."""
        return self.entry.stats

    @property
    def _numba_type_(self) -> Any:
        """Type of a kernel in Numba's type inference."""
        return self.linked._numba_type_


def kernel(function: _Function) -> _Function:
    """Compile a function when it is first called; the result is kept on disk.

    A kernel may make views of arrays, but neither allocate nor return them: Numba does without
    reference counts then, which halves the time of small problems.
    """
    return cast("_Function", Kernel(function, _UNCOUNTED, _compiler))


def allocating_kernel(function: _Function) -> _Function:
    """Compile a function like `kernel`, which may also allocate and return arrays."""
    return cast("_Function", Kernel(function, {}, _compiler))


def reordering_kernel(function: _Function) -> _Function:
    """Compile a function like `kernel`, with sums in any order: loops that sum are vectorised."""
    return cast("_Function", Kernel(function, _UNCOUNTED | _REORDERED, _compiler))


def objective(function: _Function) -> _Function:
    """Compile ``f(x, p, constants, gradient, scratch)`` to a value that kernels take as argument.

    The arguments are contiguous vectors. All objectives have one type, so that a solver is compiled
    once for all of them.
    """
    function = getattr(function, "py_func", function)
    compiled = _compiler().callback(function, _OBJECTIVE, _OPTIONS | _UNCOUNTED, _stamp())
    return cast("_Function", compiled)


def specialised(definitions: str, *kernels: Callable[..., Any], reordering: bool = False) -> str:
    """Source text of a module: definitions of functions, and kernels that call them by name.

    Each kernel is thus written once, with functions that stand for these, and compiled for any
    definitions of them; with `reordering`, the sums in its loops may be taken in any order. Whole
    numbers of the kernels' modules keep their values, unless the definitions have others.
    """
    numbers = [
        f"{name} = {value}"
        for name, value in sorted(_whole_numbers(kernels).items())
        if f"\n{name} = " not in definitions
    ]
    copies = "\n\n".join(["\n".join(numbers), *map(getsource, kernels)])
    if reordering:
        copies = copies.replace("@kernel", "@reordering_kernel")
    return f"{definitions}\n\n{copies}"


def _whole_numbers(kernels: Iterable[Any]) -> dict[str, int]:
    """Global whole numbers that the kernels name."""
    functions = [each.py_func for each in kernels]
    named = [
        (name, each.__globals__.get(name)) for each in functions for name in each.__code__.co_names
    ]
    return {name: value for name, value in named if isinstance(value, int)}


def stand_in(*_: Any) -> Any:
    """Stand, in kernels for `specialised`, for a function of the definitions."""
    raise NotImplementedError


@lru_cache(maxsize=1)
def _compiler() -> ModuleType:
    """`linking`; or `plain` where a probe shows that Numba's inside has changed, or on request.

    The environment variable CASSWARM_PLAIN_NUMBA requests it.
    """
    if not os.environ.get("CASSWARM_PLAIN_NUMBA"):
        try:
            _require_linking()
            return _linking()
        except Exception as error:  # any that comes of changed names, arguments and values
            LOG.warning("kernels compile in twice the time: Numba has changed inside (%r)", error)
    from . import plain

    return plain


def _linking() -> ModuleType:
    from . import linking

    return linking


def _require_linking() -> None:
    """Link a kernel with another one, and pass it an objective."""
    square = _linking().callback(_square, _OBJECTIVE, _OPTIONS | _UNCOUNTED, _stamp())
    found = _sum(square, np.array([3.0]))
    if found != 10.5:
        raise ArithmeticError(f"9 + 3 / 2 became {found}")


def _linked(function: _Function) -> _Function:
    return cast("_Function", Kernel(function, _UNCOUNTED, _linking))


def _square(x: Any, p: Any, constants: Any, gradient: Any, scratch: Any) -> Any:  # noqa: ARG001
    return x[0] * x[0]


@_linked
def _half(x: Any) -> Any:
    return 0.5 * x[0]


@_linked
def _sum(function: Any, x: Any) -> Any:
    return function(x, x, x, x, x) + _half(x)


@lru_cache(maxsize=1)
def _stamp() -> bytes:
    """Hash of all kernels and of how they are compiled: a change compiles all of them again."""
    return hashlib.sha256(b"".join(path.read_bytes() for path in stamped_files())).digest()


def stamped_files() -> list[Path]:
    """Files that define kernels, or records that these take, and those of the compiler."""
    problems = find_spec(f"{_PACKAGE.name}.problems")  # in a checkout beside the package
    folders = [_PACKAGE, *map(Path, problems.submodule_search_locations or () if problems else ())]
    files = sorted({path for folder in folders for path in folder.rglob("*.py")})
    compilers = [Path(__file__).with_name(name) for name in _COMPILERS]
    return [path for path in files if _STAMPED.search(path.read_bytes())] + compilers


def contiguous(array: _Array) -> _Array:
    """The array as kernels take it: contiguous and writable, so that one type is compiled."""
    if array.flags.c_contiguous and array.flags.writeable:  # a tenth of the time of the following
        return array
    return cast("_Array", np.require(array, None, ("C", "W")))


def announce(compiled: Any) -> None:
    """Log a warning if a kernel is going to be compiled, which takes seconds."""
    if compiled.is_loaded:
        return
    folder, name = compiled.stats.cache_path, compiled.__module__.rpartition(".")[2]
    if folder is None:  # there is another warning
        return
    if not any(Path(folder).glob(f"{name}.{compiled.__name__}-*.nbi")):
        LOG.warning("compiling once, for some seconds; the result is kept in %s", folder)


@locked_cache(maxsize=64)
def generated_module(source: str) -> ModuleType:
    """Module of a Python text that uses `math`, `np` and the decorators of this module.

    Functions without a decorator become kernels.
    """
    text = _HEADER + source
    name = f"casswarm_{hashlib.sha256(text.encode()).hexdigest()[:24]}"
    path = _file(name, text)
    module = ModuleType(name)
    module.__file__ = str(path)
    sys.modules[name] = module  # where Numba looks for what it loads from disk
    exec(compile(text, path, "exec"), vars(module))  # not imported: a .pyc may be damaged
    for function in [each for each in vars(module).values() if isinstance(each, FunctionType)]:
        if function.__module__ == name:
            setattr(module, function.__name__, kernel(function))
    return module


def _file(name: str, text: str) -> Path:
    """Write the text to the cache folder, or to a temporary one where that is impossible."""
    remove_abandoned()
    try:
        path = private_folder(cache_folder()) / f"{name}.py"
        if not path.exists() or path.read_bytes() != text.encode():
            atomic_write(path, text)
    except OSError as error:
        LOG.warning("%s: compiled code is for this process only", error)
        path = _process_folder() / f"{name}.py"
        atomic_write(path, text)
    return path


@locked_cache(maxsize=1)
def _process_folder() -> Path:
    return temporary_folder()
