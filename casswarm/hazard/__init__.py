"""Destruction rates of members: kernels, the paper's two hazards, and custom ones."""

from .array_rates import LocalRates, blocked, radar_table, set_rates, unblocked
from .base import Hazard, mean_rates_along, subdivided
from .compiled_rates import compiled_rates, rate_module
from .custom import CustomHazard
from .in_time import HazardInTime, RadarTrack
from .kernel_hazard import KernelHazard, Members, regular
from .mean import MeanHazard
from .rate_bounds import LeastRate
from .saturation import Saturation, SaturationCollision
from .zones import Zone

__all__ = [
    "CustomHazard",
    "Hazard",
    "HazardInTime",
    "KernelHazard",
    "LeastRate",
    "LocalRates",
    "MeanHazard",
    "Members",
    "RadarTrack",
    "Saturation",
    "SaturationCollision",
    "Zone",
    "blocked",
    "compiled_rates",
    "mean_rates_along",
    "radar_table",
    "rate_module",
    "regular",
    "set_rates",
    "subdivided",
    "unblocked",
]
