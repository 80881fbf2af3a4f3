from .certificate import certify_guide
from .frame import Frame
from .guide import Candidate, Guide
from .homotopy import GridPath, best_homotopy_classes, homotopy_signature
from .multistart import Multistart
from .plan import initial_velocities, plan_baseline, plan_from

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
