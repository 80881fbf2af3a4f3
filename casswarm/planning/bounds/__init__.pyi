from .grid import UNIT, Relaxation
from .pair_bound import PairBound, pair_bound, require_pair
from .pair_value import PairValueFunction
from .risk_bound import Certificate, Level, certify, certify_guide
from .success_bound import SuccessBound
from .value_function import CostToGoMap, ValueFunction

__all__ = [
    "UNIT",
    "Certificate",
    "CostToGoMap",
    "Level",
    "PairBound",
    "PairValueFunction",
    "Relaxation",
    "SuccessBound",
    "ValueFunction",
    "certify",
    "certify_guide",
    "pair_bound",
    "require_pair",
]
