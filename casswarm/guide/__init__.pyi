from .frame import Frame
from .guide import Candidate, Guide
from .multistart import GridPath, Multistart, best_homotopy_classes, homotopy_signature
from .passes import coarsest_pass
from .plan import certify_guide, initial_velocities, plan_baseline, plan_from

__all__ = [
    "Candidate",
    "Frame",
    "GridPath",
    "Guide",
    "Multistart",
    "best_homotopy_classes",
    "certify_guide",
    "coarsest_pass",
    "homotopy_signature",
    "initial_velocities",
    "plan_baseline",
    "plan_from",
]
