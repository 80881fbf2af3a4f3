from .acceleration_bound import bound_with_acceleration
from .acceleration_limits import AccelerationBound, acceleration_limits
from .grid import UNIT, Relaxation
from .guide_certificate import certify_guide
from .pair_bound import PairBound, pair_bound, require_pair
from .pair_value import PairValueFunction
from .potential import PotentialFamily
from .risk_bound import Certificate, Level, certify
from .success_bound import SuccessBound
from .value_function import CostToGoMap, ValueFunction

__all__ = [
    "UNIT",
    "AccelerationBound",
    "Certificate",
    "CostToGoMap",
    "Level",
    "PairBound",
    "PairValueFunction",
    "PotentialFamily",
    "Relaxation",
    "SuccessBound",
    "ValueFunction",
    "acceleration_limits",
    "bound_with_acceleration",
    "certify",
    "certify_guide",
    "pair_bound",
    "require_pair",
]
