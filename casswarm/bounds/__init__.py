"""Proven bounds on the risk of every guide and on the success of every policy; value functions.

The proofs are in ``docs/global-guide.md`` and ``docs/joint.md``.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
