from .acceleration_bound import (
    AccelerationBound,
    AccelerationLimits,
    acceleration_limits,
    bound_with_acceleration,
)
from .belief_bound import MixtureBound, MixtureLevel, mixture_bound
from .level_game import PotentialFamily
from .refinement import Level
from .risk_bound import Certificate, certify
from .success_bound import SuccessBound
from .two_members import PairBound, PairValueFunction, pair_bound, require_pair

__all__ = [
    "AccelerationBound",
    "AccelerationLimits",
    "Certificate",
    "Level",
    "MixtureBound",
    "MixtureLevel",
    "PairBound",
    "PairValueFunction",
    "PotentialFamily",
    "SuccessBound",
    "acceleration_limits",
    "bound_with_acceleration",
    "certify",
    "mixture_bound",
    "pair_bound",
    "require_pair",
]
