"""What `casswarm reproduce` has left in the repository."""

from pathlib import Path

import pandas as pd

CHECKED_IN = Path(__file__).parents[2] / "results" / "paper"


def checked_in(name):
    """A table of results/paper."""
    return pd.read_csv(CHECKED_IN / f"{name}.csv")
