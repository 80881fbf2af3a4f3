"""Kernels that call kernels: linked, optimised once, and loaded from disk."""

import ast
import gc
import shutil

import numba
import numpy as np
import pytest
from commands import python

from casswarm.compiled import generated_module
from casswarm.compiled.kernels import stamped_files

TEXT = """
@kernel
def power(x, k):
    result = 1.0
    for _ in range(k):
        result *= x
    return result


@kernel
def polynomial(x):
    if x == 0.0:
        raise ValueError("no polynomial at zero")
    return 1.0 + power(x, 1) + power(x, 2)


@kernel
def total(values):
    result = 0.0
    for i in range(values.size):
        result += polynomial(values[i]) + power(values[i], i)
    return result


@kernel
def product(values):
    result = 1.0
    for i in range(values.size):
        result *= polynomial(values[i])
    return result
"""
VALUES = np.array([1.0, 2.0])


@pytest.fixture(scope="module")
def module():
    return generated_module(TEXT)


def test_kernel_equals_its_python_function(module):
    assert module.total(VALUES) == 3.0 + 1.0 + 7.0 + 2.0
    assert module.product(VALUES) == 21.0


def test_called_kernels_have_no_entry_and_no_specialisation_for_literals(tmp_path, monkeypatch):
    monkeypatch.setenv("CASSWARM_CACHE", str(tmp_path))  # compiled here, not loaded
    module = generated_module("# of a module without compiled code\n" + TEXT)
    module.total(VALUES)
    assert "entry" not in vars(module.power)
    assert module.power.linked.signatures == [(numba.float64, numba.int64)]


def test_kernel_is_called_from_python_and_from_kernels(module):
    other = generated_module("@kernel\ndef double(x):\n    return 2.0 * x\n" + TEXT)
    assert other.power(3.0, 2) == 9.0
    assert other.total(VALUES) == module.total(VALUES)


def test_exception_in_called_kernel_is_raised(module):
    with pytest.raises(ValueError, match="no polynomial at zero"):
        module.total(np.zeros(2))


def test_other_compiled_functions_call_kernels(module):
    polynomial = module.polynomial
    called = numba.njit(lambda x: polynomial(x) + 1.0)
    assert called(2.0) == 8.0


@pytest.mark.parametrize("collects", [True, False])
def test_collector_is_as_before_after_compilation(collects):
    fresh = generated_module(f"@kernel\ndef add(x):\n    return x + {int(collects)}\n")
    try:
        if not collects:
            gc.disable()
        fresh.add(1.0)
        assert gc.isenabled() == collects
    finally:
        gc.enable()


def first_use(cache, name, before=""):
    """Hits of the caches of `name` and of the kernels that it calls, in a process of its own."""
    code = (
        "import numpy as np\n"
        "from casswarm.compiled import generated_module, kernel\n"
        f"{before}\n"
        f"module = generated_module({TEXT!r})\n"
        f"module.{name}(np.array([1.0, 2.0]))\n"
        f"of = module.{name}.entry, module.polynomial.linked, module.power.linked\n"
        "print(*(sum(dispatcher.stats.cache_hits.values()) for dispatcher in of))\n"
    )
    return python("-c", code, CASSWARM_CACHE=str(cache)).stdout.strip()


@pytest.mark.slow
def test_called_kernels_are_loaded_by_another_kernel_in_another_process(tmp_path):
    assert first_use(tmp_path, "total") == "0 0 0"
    assert first_use(tmp_path, "product") == "0 1 1"
    assert first_use(tmp_path, "product") == "1 0 0"


@pytest.mark.slow
def test_kernel_whose_called_kernel_was_compiled_by_another_process_is_compiled_again(tmp_path):
    """Processes number their functions differently, and both may write to an empty cache."""
    ours, theirs = tmp_path / "ours", tmp_path / "theirs"
    earlier = "generated_module('@kernel\\ndef other(x):\\n    return x\\n').other(1.0)"
    assert first_use(ours, "total") == "0 0 0"
    assert first_use(theirs, "total", earlier) == "0 0 0"
    replaced = list(theirs.rglob("linked.*.power-*"))
    assert len(replaced) == 2
    for path in replaced:
        shutil.copy(path, ours / path.relative_to(theirs))
    assert first_use(ours, "product") == "0 0 1"
    assert first_use(ours, "product") == "1 0 0"


def kernels_and_imports(path):
    """Names that kernels of a file use, and the modules from which it imports names."""
    tree, used, origins = ast.parse(path.read_text()), set(), {}
    for node in ast.walk(tree):
        decorators = getattr(node, "decorator_list", ())
        if any(getattr(each, "id", "").endswith("kernel") for each in decorators):
            used |= {each.id for each in ast.walk(node) if isinstance(each, ast.Name)}
        if isinstance(node, ast.ImportFrom):
            origins |= {each.name: node.module or "" for each in node.names}
    return used, origins


def test_kernels_take_constants_from_files_whose_change_compiles_them_again():
    hashed = stamped_files()
    kernels = {path: kernels_and_imports(path) for path in hashed}
    assert sum(bool(used) for used, _ in kernels.values()) > 20
    stems = {path.stem for path in hashed}
    for path, (used, origins) in kernels.items():
        for name in used & origins.keys():
            module = origins[name]
            if name.isupper() and module not in ("math", "numpy"):
                assert module.rpartition(".")[2] in stems, (path, name)


def test_type_of_callback_is_built_once():
    text = "@objective\ndef sphere(x, p, constants, gradient, scratch):\n    return x[0] * x[0]\n"
    sphere = generated_module(text).sphere
    assert numba.typeof(sphere) is numba.typeof(sphere)
    assert numba.typeof(sphere).signature == sphere._sig
