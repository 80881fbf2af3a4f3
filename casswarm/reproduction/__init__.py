"""The paper reproduced: its tables and figures once more, and what follows from them."""

from .paper import PAPER_RUNS, PAPER_SUCCESS, readings, table_1
from .report import page
from .reproduce import FIGURES, TABLES, Reproduction, reproduce

__all__ = [
    "FIGURES",
    "PAPER_RUNS",
    "PAPER_SUCCESS",
    "TABLES",
    "Reproduction",
    "page",
    "readings",
    "reproduce",
    "table_1",
]
