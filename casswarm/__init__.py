"""casswarm: guiding a swarm of agents through a field of hazards.

The public names are declared in ``__init__.pyi`` and imported when they are first used, so that
``import casswarm`` is quick.
"""

from pathlib import Path as _Path

import lazy_loader as _lazy_loader

from ._util import display as _display
from ._util import registry as _registry
from ._util import user_code as _user_code

_FOLDER = _Path(__file__).parent
if not (_FOLDER / "problems").exists() and (_FOLDER.parent / "problems").exists():
    # imported from a checkout: there two subpackages stand beside this folder, not in it
    __path__.append(str(_FOLDER.parent))

_public, __dir__, __all__ = _lazy_loader.attach_stub(__name__, __file__)

_user_code.install()  # first of all, since what is unpickled may refer to them
_display.RENDERER = f"{__name__}.results.notebook_display"

for _name, _target in {
    "auto": "auto:Auto",
    "spectral": "projected_gradient:SpectralProjectedGradient",
}.items():
    _registry.announce("solver", _name, f"{__name__}.formation.{_target}", "interior-point")
_registry.announce(
    "solver", "projected-gradient", f"{__name__}.formation.projected_gradient:ProjectedGradient"
)
for _name in ("guides", "formations", "quick"):
    _registry.announce("family", _name, f"{__name__}.studies.posed_problems:{_name.upper()}")


def __getattr__(name: str) -> object:
    if name != "__version__":
        return _public(name)
    from importlib.metadata import version  # slower than all the rest

    return version(__name__)
