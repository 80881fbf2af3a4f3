from .nodes import UNIT, Relaxation
from .value_function import CostToGoMap, ValueFunction, value_grid

__all__ = [
    "UNIT",
    "CostToGoMap",
    "Relaxation",
    "ValueFunction",
    "value_grid",
]
