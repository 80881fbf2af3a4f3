"""README of a reproduction, and its tables as text."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import pandas as pd

from .._util.documents import render
from ..planning.guide import rounded_up
from .paper import PAPER_RUNS
from .reproduce import TABLES, Reproduction


def page(reproduction: Reproduction, suffix: str = "png") -> str:
    """Markdown text that shows every table and figure with its caption.

    Figures are links to files NAME.SUFFIX in its folder.
    """
    tables = reproduction.tables
    guide = tables["guide-convergence"].iloc[-1]
    within = tables["table-2"]["within_paper_interval"]
    last = tables["formation-convergence"].groupby("problems", sort=False).tail(1)
    columns = dict.fromkeys(("gap_median", "gap_largest"), "{:.2g}")
    columns |= dict.fromkeys(("residual_median", "residual_largest"), "{:.1g}")
    return render(
        "reproduction.md",
        titles=TABLES,
        figure=lambda name, caption: f"![{name}]({name}.{suffix})\n\n*{caption}*",
        paper_runs=PAPER_RUNS,
        table_1=table_for_people(reproduction, "table-1"),
        geometry=_formatted(tables["geometry"], {"x": "{:g}", "y": "{:g}"}),
        within=int(within.sum()),
        policies=len(within),
        table_2=table_for_people(reproduction, "table-2"),
        guide_iterations=f"{guide['iteration']:.0f}",
        guide_survival=f"{guide['survival']:.2g}",
        ipopt_survival=f"{reproduction.guide.survival:.2g}",
        convergence=_formatted(last, columns),
        empty_sets=table_for_people(reproduction, "empty-sets"),
        beyond=_with_success_bounds(_formatted(tables["beyond"], {"guide_survival": "{:.4f}"})),
        interpretations=tables["interpretations"],
    )


def table_for_people(reproduction: Reproduction, name: str) -> pd.DataFrame:
    """A table with its intervals and bounds as text."""
    table = reproduction.tables[name]
    if name == "table-1":
        return _formatted(table, {"paper": "{:g}", "casswarm": "{:g}"})
    if name == "table-2":
        return table_2_text(table, reproduction.runs)
    return _with_success_bounds(table) if "success_low" in table else table


def bounds_text(low: float, high: float) -> str:
    """Bounds to four digits, rounded outward so that they remain bounds."""
    slack = 1e-9  # bounds of four digits are not changed
    return f"{math.floor(1e4 * low + slack) / 1e4:.4f} to {rounded_up(high - slack):.4f}"


def table_2_text(table: pd.DataFrame, runs: int) -> pd.DataFrame:
    """Table II for people: numbers with their intervals as text."""
    return pd.DataFrame(
        {
            "policy": row["policy"],
            f"paper, {PAPER_RUNS} runs": _with_interval(row, "paper"),
            "exact": bounds_text(row["exact_low"], row["exact_high"]),
            f"casswarm, {PAPER_RUNS} runs": _with_interval(row, f"runs_{PAPER_RUNS}"),
            f"casswarm, {runs} runs": _with_interval(row, f"runs_{runs}", 4),
        }
        for row in table.to_dict("records")
    )


def _with_interval(row: Mapping[Any, float], name: str, digits: int = 2) -> str:
    low, high, ends = row[f"{name}_low"], row[f"{name}_high"], max(3, digits)
    return f"{row[name]:.{digits}f} ({low:.{ends}f} to {high:.{ends}f})"


def _with_success_bounds(table: pd.DataFrame) -> pd.DataFrame:
    """The table with its bounds of success as one column of text."""
    bounds = zip(table["success_low"], table["success_high"], strict=True)
    success = [bounds_text(low, high) for low, high in bounds]
    shown = table.assign(success_low=success).rename(columns={"success_low": "success"})
    return shown.drop(columns="success_high")


def _formatted(table: pd.DataFrame, formats: Mapping[str, str]) -> pd.DataFrame:
    """The table with columns written in the given formats."""
    return table.assign(**{name: table[name].map(form.format) for name, form in formats.items()})
