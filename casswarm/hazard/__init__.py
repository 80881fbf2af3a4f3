"""Destruction rates of members: kernels, the paper's two hazards, and custom ones."""

from .base import Hazard
from .custom import CustomHazard
from .kernel_hazard import KernelHazard, regular
from .saturation import Saturation, SaturationCollision

__all__ = [
    "CustomHazard",
    "Hazard",
    "KernelHazard",
    "Saturation",
    "SaturationCollision",
    "regular",
]
