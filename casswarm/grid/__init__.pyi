from .dynamic_programming import StageCosts, costs_to_come, costs_to_go, least_cost, rounding
from .nodes import UNIT, CellBlock, Grid, NodeBlock, Relaxation, box_extremum, node_count
from .value_function import CostToGoMap, ValueFunction, value_grid

__all__ = [
    "UNIT",
    "CellBlock",
    "CostToGoMap",
    "Grid",
    "NodeBlock",
    "Relaxation",
    "StageCosts",
    "ValueFunction",
    "box_extremum",
    "costs_to_come",
    "costs_to_go",
    "least_cost",
    "node_count",
    "rounding",
    "value_grid",
]
