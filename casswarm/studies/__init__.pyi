from .evaluation import evaluate
from .simulation import PAPER_POLICIES
from .tables import count_notes, paired_texts, summary_texts, trajectory_table

__all__ = [
    "PAPER_POLICIES",
    "count_notes",
    "evaluate",
    "paired_texts",
    "summary_texts",
    "trajectory_table",
]
