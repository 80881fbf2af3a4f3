from .nodes import UNIT, Relaxation
from .value_function import CostToGoMap, ValueFunction

__all__ = [
    "UNIT",
    "CostToGoMap",
    "Relaxation",
    "ValueFunction",
]
