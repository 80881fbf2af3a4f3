from .guide import Candidate, Guide, rounded_up
from .homotopy import GridPath, best_homotopy_classes, homotopy_signature
from .kinematics import integrate, remaining_distance, resample
from .multistart import Multistart
from .plan import initial_velocities, plan_from

__all__ = [
    "Candidate",
    "GridPath",
    "Guide",
    "Multistart",
    "best_homotopy_classes",
    "homotopy_signature",
    "initial_velocities",
    "integrate",
    "plan_from",
    "remaining_distance",
    "resample",
    "rounded_up",
]
