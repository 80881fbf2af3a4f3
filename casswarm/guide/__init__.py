"""Planning: the guide trajectory, joint plans of all members, and proven bounds on both.

Names are imported when they are first used. The functions `plan`, `plan_swarm` and `success_bound`
are in the modules of the same names and at the top of casswarm.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
