"""casswarm: guiding a swarm of agents through a field of hazards.

The public names are declared in ``__init__.pyi`` and imported when they are first used, so that
``import casswarm`` is quick.
"""

from importlib.metadata import version
from pathlib import Path

import lazy_loader

from ._util import display as _display
from ._util import user_code as _user_code
from .comparison.families import register_problems as _register_problems
from .solvers.registry import register_solver as _register_solver

__version__ = version("casswarm")

_FOLDER = Path(__file__).parent
if not (_FOLDER / "problems").exists() and (_FOLDER.parent / "problems").exists():
    # imported from a checkout: there two subpackages stand beside this folder, not in it
    __path__.append(str(_FOLDER.parent))

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)

_user_code.install()  # first of all, since what is unpickled may refer to them
_display.RENDERER = f"{__name__}.results.notebook_display"

for _name, _target, _before in (
    ("auto", "auto:Auto", "interior-point"),
    ("spectral", "projected_gradient:SpectralProjectedGradient", "interior-point"),
    ("projected-gradient", "projected_gradient:ProjectedGradient", None),
):
    _register_solver(_name, f"{__name__}.formation.{_target}", before=_before)

for _name in ("guides", "formations", "quick"):
    _register_problems(_name, f"{__name__}.studies.posed_problems:{_name.upper()}")
