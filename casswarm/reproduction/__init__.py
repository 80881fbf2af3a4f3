"""The paper reproduced: its tables and figures once more, and what follows from them."""

from .reproduce import FIGURES, TABLES, Reproduction, reproduce
from .report import page
from .paper import PAPER_RUNS, PAPER_SUCCESS, readings, table_1

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
