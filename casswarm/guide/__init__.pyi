from .frame import Frame
from .guide import Candidate, Guide
from .multistart import GridPath, Multistart, best_homotopy_classes, homotopy_signature
from .plan import certify_guide, initial_velocities, plan_baseline, plan_from

__all__ = [
    "Candidate",
    "Frame",
    "GridPath",
    "Guide",
    "Multistart",
    "best_homotopy_classes",
    "certify_guide",
    "homotopy_signature",
    "initial_velocities",
    "plan_baseline",
    "plan_from",
]
