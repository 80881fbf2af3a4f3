"""Hazards: the rates at which members are destroyed."""

from .base import Hazard
from .custom import CustomHazard
from .kernels import KernelHazard, regular
from .saturation import Saturation, SaturationCollision

__all__ = [
    "CustomHazard",
    "Hazard",
    "KernelHazard",
    "Saturation",
    "SaturationCollision",
    "regular",
]
