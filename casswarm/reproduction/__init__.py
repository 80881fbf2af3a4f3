"""Reproduction of the paper: its tables and figures, and results beyond them."""

from .paper_tables import PAPER_RUNS, PAPER_SUCCESS, interpretations, table_1
from .reproduce import FIGURES, TABLES, Reproduction, page, reproduce

__all__ = [
    "FIGURES",
    "PAPER_RUNS",
    "PAPER_SUCCESS",
    "TABLES",
    "Reproduction",
    "interpretations",
    "page",
    "reproduce",
    "table_1",
]
