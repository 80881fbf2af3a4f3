"""README of a reproduction, and its tables as text."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import pandas as pd

from .._util.documents import render
from .._util.numbers import rounded_up
from .paper_tables import PAPER_RUNS, PAPER_SUCCESS
from .reproduce import TABLES, Reproduction
from .success_tables import METHOD, READING_RUNS, SENSITIVITY_RUNS


def page(reproduction: Reproduction, suffix: str = "png") -> str:
    """Markdown text that shows every table and figure with its caption.

    Figures are links to files NAME.SUFFIX in its folder.
    """
    tables = reproduction.tables
    paths = tables["guide-convergence"].groupby("steps")
    within = tables["table-2"][["method_within", "exact_within"]].sum()
    last = tables["formation-convergence"].groupby(["problems", "steps"], sort=False).tail(1)
    columns = dict.fromkeys(("gap_median", "gap_largest"), "{:.2g}")
    columns |= dict.fromkeys(("residual_median", "residual_largest"), "{:.1g}")
    changes = tables["sensitivity"]
    changes = changes[changes["solver"] == METHOD]
    return render(
        "reproduction.md",
        titles=TABLES,
        figure=lambda name, caption: f"![{name}]({name}.{suffix})\n\n*{caption}*",
        paper_runs=PAPER_RUNS,
        table_1=table_for_people(reproduction, "table-1"),
        geometry=_formatted(tables["geometry"], {"x": "{:g}", "y": "{:g}"}),
        within=within.to_dict(),
        policies=len(tables["table-2"]),
        table_2=table_for_people(reproduction, "table-2"),
        sensitivity_runs=SENSITIVITY_RUNS,
        inside=int((changes["within"] == len(PAPER_SUCCESS)).sum()),
        changes=len(changes),
        guide_iterations=f"{paths['iteration'].max().iloc[0]:.0f}",
        guide_survival=paths["survival"].max().map("{:.2g}".format).to_dict(),
        ipopt_survival=f"{reproduction.guide.survival:.2g}",
        convergence=_formatted(last, columns),
        empty_sets=table_for_people(reproduction, "empty-sets"),
        beyond=_with_success_bounds(_formatted(tables["beyond"], {"guide_survival": "{:.4f}"})),
        interpretations=tables["interpretations"],
        readings=table_for_people(reproduction, "readings"),
        reading_runs=READING_RUNS,
    )


def table_for_people(reproduction: Reproduction, name: str) -> pd.DataFrame:
    """A table with its intervals and bounds as text."""
    table = reproduction.tables[name]
    if name == "table-1":
        return _formatted(table, {"paper": "{:g}", "casswarm": "{:g}"})
    if name == "table-2":
        return table_2_text(table)
    if name == "readings":
        return readings_text(table)
    return _with_success_bounds(table) if "success_low" in table else table


def bounds_text(low: float, high: float) -> str:
    """Bounds to four digits, rounded outward so that they remain bounds."""
    slack = 1e-9  # bounds of four digits are not changed
    return f"{math.floor(1e4 * low + slack) / 1e4:.4f} to {rounded_up(high - slack):.4f}"


def table_2_text(table: pd.DataFrame) -> pd.DataFrame:
    """Table II for people: numbers with their intervals as text."""
    return pd.DataFrame(
        {
            "policy": row["policy"],
            f"paper, {PAPER_RUNS} runs": _with_interval(row, "paper"),
            f"its method, {PAPER_RUNS} runs": _with_interval(row, f"runs_{PAPER_RUNS}"),
            "its method": f"{_bounds_of(row, 'method')} ({row['method_kind']})",
            "Ipopt, proven": _bounds_of(row, "exact"),
        }
        for row in table.to_dict("records")
    )


def readings_text(table: pd.DataFrame) -> pd.DataFrame:
    """Table II under each reading for people: numbers with their intervals as text."""
    shown = table[["location", "question", "answer"]].copy()
    shown["guide survives"] = table["guide_survival"].map("{:.4f}".format)
    for policy in PAPER_SUCCESS:
        shown[policy] = [
            "" if math.isnan(row[policy]) else _with_interval(row, policy, digits=3)
            for row in table.to_dict("records")
        ]
    return shown.assign(within=table["within"])


def _bounds_of(row: Mapping[Any, float], name: str) -> str:
    return bounds_text(row[f"{name}_low"], row[f"{name}_high"])


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
