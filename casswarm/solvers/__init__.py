"""Solvers of nonlinear programs: one interface, any number of backends.

Solvers of other rooms are registered (see `register_solver`), and here by the name of their class.
"""

from typing import Any

import lazy_loader

from .registry import SOLVERS, registered_class

_own, _, _names = lazy_loader.attach_stub(__name__, __file__)


def __getattr__(name: str) -> Any:
    if name == "__all__":  # not fixed: others register solvers later
        return __dir__()
    return _own(name) if name in _names else registered_class(name)


def __dir__() -> list[str]:
    registered = {target.partition(":")[2] for target in SOLVERS.targets.values()}
    return sorted({*_names, *registered})
