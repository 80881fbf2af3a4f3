from .agent import initial_velocities, plan_from
from .certificate import certify_guide
from .frame import Frame
from .guide import Candidate, Guide
from .mixture import Ambiguity, MixedGuide, plan_mixture
from .multistart import GridPath, Multistart, best_homotopy_classes, homotopy_signature
from .passes import coarsest_pass
from .plan import plan_baseline

__all__ = [
    "Ambiguity",
    "Candidate",
    "Frame",
    "GridPath",
    "Guide",
    "MixedGuide",
    "Multistart",
    "best_homotopy_classes",
    "certify_guide",
    "coarsest_pass",
    "homotopy_signature",
    "initial_velocities",
    "plan_baseline",
    "plan_from",
    "plan_mixture",
]
