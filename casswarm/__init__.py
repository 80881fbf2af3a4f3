"""casswarm: guiding a swarm of agents through a field of hazards.

The public names are declared in ``__init__.pyi`` and imported when they are first used, so that
``import casswarm`` is quick.
"""

from importlib.metadata import version
from pathlib import Path

import lazy_loader

from ._util import display as _display
from ._util import user_folders as _user_folders

__version__ = version("casswarm")

_FOLDER = Path(__file__).parent
if not (_FOLDER / "problems").exists() and (_FOLDER.parent / "problems").exists():
    # imported from a checkout: there two subpackages stand beside this folder, not in it
    __path__.append(str(_FOLDER.parent))

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)

_user_folders.install()  # first of all, since what is unpickled may refer to them
_display.RENDERER = f"{__name__}.results.display"
