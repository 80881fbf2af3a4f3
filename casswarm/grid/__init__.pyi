from .dynamic_programming import StageCosts, costs_to_come, costs_to_go, least_cost, rounding
from .node_blocks import NodeBlock, box_extremum
from .nodes import UNIT, CellBlock, Grid, Relaxation, node_count
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
