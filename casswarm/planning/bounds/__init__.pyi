from .grid import UNIT, Relaxation
from .risk_bound import Certificate, Level, certify, certify_guide
from .success_bound import SuccessBound
from .value_function import CostToGoMap, ValueFunction

__all__ = [
    "UNIT",
    "Certificate",
    "CostToGoMap",
    "Level",
    "Relaxation",
    "SuccessBound",
    "ValueFunction",
    "certify",
    "certify_guide",
]
