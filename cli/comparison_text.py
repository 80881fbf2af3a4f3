"""Tables that casswarm compare prints."""

from __future__ import annotations

from math import isnan
from typing import Any

import casswarm as csw

from .._util.text import counted
from .output import aligned_table


def _percent(value: float) -> str:
    return "" if isnan(value) else f"{100 * value:.0f} %"


def comparison_text(comparison: csw.Comparison) -> str:
    """A table for every family and start."""
    from ..comparison.report import milliseconds

    def interval(row: dict[Any, Any]) -> str:
        ends = row["mean_ms_low"], row["mean_ms_high"]
        return "" if isnan(ends[0]) else " to ".join(map(milliseconds, ends))

    texts = []
    summary = comparison.ranking.merge(comparison.summary.drop(columns="mean_ms"))
    for (family, start), part in summary.groupby(["family", "start"], sort=False):
        rows = [
            {
                "solver": str(row["solver"]),
                "solved": _percent(row["solved"]),
                "best known": _percent(row["best_known"]),
                "mean ms": milliseconds(row["mean_ms"]),
                "95 %": interval(row),
                "rank": f"{row['rank']:g}",
                "probability": _percent(row["probability"]),
            }
            for row in part.to_dict("records")
        ]
        notes = [
            f"{row['solver']}: {counted(row['false_positives'], 'false positive')} (reported as "
            "solved, but not verified)"
            for row in part.to_dict("records")
            if row["false_positives"]
        ]
        problems = counted(int(part["problems"].iloc[0]), "problem")
        title = f"{family}, {start} start, {problems}"
        texts.append("\n".join([title, aligned_table(rows), *notes]))
    return "\n\n".join(texts)
