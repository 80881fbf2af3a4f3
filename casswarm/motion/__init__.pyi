from .kinematics import integrate, remaining_distance, resample
from .planar import PlanarSets
from .step import Motion, Step

__all__ = [
    "Motion",
    "PlanarSets",
    "Step",
    "integrate",
    "remaining_distance",
    "resample",
]
